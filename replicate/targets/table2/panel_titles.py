"""How figures name what they show: a method's title, or the ground truth."""

from replicate.methods.method_registry import method_named
from replicate.report.pose_record import TRUTH


def panel_title(method: str) -> str:
    """Return a method's title, with the mark of its note, or that of the truth."""
    return "Ground truth" if method == TRUTH else method_named(method).title


def plain_name(method: str) -> str:
    """Return the same without the mark."""
    return "Ground truth" if method == TRUTH else method_named(method).label
