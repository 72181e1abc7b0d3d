"""How figures name what they show: a method's title, or the ground truth; and by which rule a pose was chosen."""

from collections.abc import Iterable

from replicate.methods.method_registry import in_order, method_named
from replicate.methods.typical_poses import MEDIAN, WORST
from replicate.report.pose_record import FOLDED, TRUTH, PoseRecord


def panel_title(method: str) -> str:
    """Return a method's title, with the mark of its note, or that of the truth."""
    return "Ground truth" if method == TRUTH else method_named(method).title


def plain_name(method: str) -> str:
    """Return the same without the mark."""
    return "Ground truth" if method == TRUTH else method_named(method).label


def marks_in_words(methods: Iterable[str]) -> str:
    """Return the notes of the marks that some methods' titles have, each once, as sentences."""
    notes = [method_named(name) for name in in_order(set(methods) - {TRUTH})]
    return " ".join(dict.fromkeys(f"{method.mark} {method.note}" for method in notes if method.mark))


def pose_in_words(record: PoseRecord) -> str:
    """Return which test pose a record holds, whose, and by which rule it was chosen."""
    rules = {
        FOLDED: "the one whose forehead folds most",
        MEDIAN: f"the median of the mean normal errors of “{plain_name(record.ranked_by)}”",
        WORST: f"the one with the largest mean normal error of “{plain_name(record.ranked_by)}”",
    }
    return f"test pose {record.pose} of {record.character}, {rules[record.choice]}"
