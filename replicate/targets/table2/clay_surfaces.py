"""What a method has of a pose, as surfaces in clay: its skin, and brows and eyeballs with it."""

from replicate.drawing.prop_surfaces import carry_props, prop_surfaces
from replicate.drawing.scene import Surface
from replicate.report.pose_record import TRUTH, PoseRecord


def clay_surfaces(record: PoseRecord, method: str) -> list[Surface]:
    """Return the surfaces of a pose as one of the record's methods has it."""
    vertices = record.vertices[method]
    props = carry_props(record.props, record.vertices[TRUTH], vertices)
    return [Surface(vertices, record.faces), *prop_surfaces(props)]
