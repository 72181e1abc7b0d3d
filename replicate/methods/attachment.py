"""The rigid step alone: the true mesh, except for its rigid segments, which are placed by attachments (§3.4)."""

from collections.abc import Callable, Mapping
from pathlib import Path

from replicate.approximation.rigid import Attachments
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.methods.method import Method, Metric


def placing_attachments(method: Method, attachments: Attachments) -> Attachments:
    """Return the attachments by which a method places rigid segments (§3.4); none for a method without that step."""
    if method.rigid_step:
        return attachments
    return Attachments(**{name: array[:0] for name, array in vars(attachments).items()})


def load(inputs: Mapping[str, Path], settings: None) -> Callable:
    """Return (parameters, truth) → truth; the rigid step then replaces its rigid segments."""
    return lambda params, truth: truth


def facts(inputs: Mapping[str, Path], mesh: Mesh) -> list[Metric]:
    """Return how many rigid segments there are, how rigid they are, and how well the worst of them is placed."""
    attachments = artefacts.load_attachments(inputs)
    count: list[Metric] = [("rigid_segments", "count", len(attachments.segment))]
    if not len(attachments.segment):
        return count
    return [
        *count,
        ("rigid_error_max", "mm", float(attachments.rigid_error_mm.max())),
        ("least_second_spread", "mm", float(attachments.spread_mm[:, 1].min())),
    ]


METHOD = Method(
    "attachment",
    "Attached rigid segments",
    lambda plan: (),
    load,
    place=90,
    oracle=True,
    note="An oracle: the true mesh, but for the rigid segments, which are placed by their attachment vertices (§3.4).",
    mark="¶",
    in_figures=False,
    in_charts=False,
    facts=facts,
)
