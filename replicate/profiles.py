"""The profiles: how many samples and steps a run takes, as overrides of the paper's values."""

from replicate.engine.exceptions import InputError
from replicate.engine.schema import shown

BEST = {"schedule": "one_cycle", "peak_rate": 5e-3, "draws": "uniform", "largest_gradient": 1.0}  # DEVIATIONS D6


def _one_cycle(steps: int) -> dict:
    return {"training": BEST | {"steps": steps}}


PROFILES: dict[str, dict] = {
    "quick": {
        "samples": {"count": 1_500, "uniform_test": 200},
        "coarse": _one_cycle(800),
        "refinement": {"poses": 200, **_one_cycle(500)},
        "dense": _one_cycle(600),
        "rigid": {"poses": 100},
        "lbs": {"samples": 200, "relaxed": 10, "iterations": 15, "refit_sweeps": 40},
        "driven": _one_cycle(400),
        "evaluation": {"test_poses": 200, "floor_poses": 50},
        "rig_report": {"pairs": {"count": 500}, "maps": {"poses": 50}},
    },
    "laptop": {
        "samples": {"count": 10_000, "uniform_test": 1_000},
        "coarse": _one_cycle(22_000),
        "refinement": _one_cycle(10_000),
        "dense": _one_cycle(16_000),
        "driven": _one_cycle(8_000),
    },
    "paper": {},
}


def check_profile(profile: str) -> None:
    """Raise InputError for an unknown profile."""
    if profile not in PROFILES:
        raise InputError(f"profile {shown(profile)} is unknown: allowed are {', '.join(PROFILES)}")
