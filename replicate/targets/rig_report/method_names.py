"""What the rig report calls its fits."""

from collections.abc import Callable

LABELS = {
    "neutral": "neutral pose",
    "linear": "p, a straight line",
    "squares": "p, abs(p), p²",
    "products": "p, abs(p), p², products",
    "basis": "the basis alone",
}


def features_text(value: Callable[[str, str], float | None]) -> str:
    """Return how many features each fit has, as a sentence. value: (method, metric) → a number or None."""
    counts = {LABELS[name]: value(name, "features") for name in ("linear", "squares", "products")}
    return "; ".join(f"{label}: {count:,.0f} features" for label, count in counts.items() if count is not None) + "."
