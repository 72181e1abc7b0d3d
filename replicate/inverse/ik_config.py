"""The numbers of inverse kinematics: the IK networks and their training (§4.2)."""

from dataclasses import dataclass, replace
from typing import Literal

from replicate.config import TrainingConfig
from replicate.engine.schema import Checked, number
from replicate.inverse.control_points import IMAGE_PLANE, SPACE

STEPS = {"quick": 200, "laptop": 4_000, "paper": 70_000}
TRAINING = {
    "paper": TrainingConfig(),
    "laptop": TrainingConfig("one_cycle", STEPS["laptop"], 16, "uniform", peak_rate=2e-3, largest_gradient=1.0),
}


@dataclass(frozen=True)
class InverseConfig(Checked):
    """How the IK networks are trained (§4.2). axes: "xy" for points in the image plane (§5.3.1), "xyz" in space."""

    hidden: tuple[int, ...] = number((256, 256), 1, 65_536)
    leaky_slope: float = number(0.2, 0.0, 1.0)
    axes: Literal["xy", "xyz"] = "xy"
    noise_mm: float = number(4.5, 0.0, 1e3)  # δ: each coordinate of a control point moves by U(−δ, δ)
    regularisation: float = number(0.02, 0.0, 1e6)  # λ_reg of Eq. 8, in mm: the paper names no value
    training: TrainingConfig = TRAINING["laptop"]

    @property
    def coordinates(self) -> int:
        """How many coordinates of a control point count."""
        return IMAGE_PLANE if self.axes == "xy" else SPACE


def own(profile: str) -> InverseConfig:
    """Return the section `[inverse]` of a profile's configuration."""
    training = TRAINING.get(profile, TRAINING["laptop"])
    return InverseConfig(training=replace(training, steps=STEPS[profile]))
