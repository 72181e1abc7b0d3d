"""What a method has of a pose, as surfaces in clay: its skin, and brows and eyeballs with it; and the view of them."""

from replicate.drawing.prop_surfaces import carry_props, prop_surfaces
from replicate.drawing.scene import Camera, Surface, camera_for, forehead_camera, frame_surfaces
from replicate.report.pose_record import TRUTH, PoseRecord


def clay_surfaces(record: PoseRecord, method: str) -> list[Surface]:
    """Return the surfaces of a pose as one of the record's methods has it."""
    vertices = record.vertices[method]
    props = carry_props(record.props, record.vertices[TRUTH], vertices)
    return [Surface(vertices, record.faces), *prop_surfaces(props)]


def view_of(record: PoseRecord, camera: str, aspect: float) -> Camera:
    """Return a named camera for the panels of a pose, whose width is so many times their height.

    From the front the whole head fills the panel, wherever the pose has moved it; the camera on the forehead follows
    that. Other views are fixed.
    """
    if camera == "forehead":
        return forehead_camera(record.neutral, record.faces, record.vertices[TRUTH])
    view = camera_for(camera, record.neutral)
    return frame_surfaces(view, clay_surfaces(record, TRUTH), aspect) if camera == "front" else view
