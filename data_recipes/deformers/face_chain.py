"""The chains of our own faces: the deformers of `face.py` in full, and the steps of a ladder that has fewer of them.

1: a target for each control, its soft limit and rigid teeth. 2: + targets half-way and for combinations. 3: + what
turns: jaw, lids and the head's shape. 4: + sliding on the skull, contact of lips and teeth, flesh. 5: + wrinkles, the
whole face. 6: wrinkles of half the wave length.
"""

from data_recipes.deformers.face import NODES
from data_recipes.deformers.node_chain import Chain, Node
from data_recipes.deformers.posed_props import pose
from data_recipes.deformers.shape_targets import add_targets, rivet_teeth

STEPS = 6
WHOLE = 5  # the step of the face in full
SHORT_WAVES = 6
CONTACT = ("skull_slide", "lip_contact", "teeth_contact", "flesh")


def _without(*names: str) -> tuple[Node, ...]:
    return tuple(node for node in NODES if node.name not in names)


_TARGETS = (
    NODES[0],
    Node("targets", add_targets, ("neutral", "targets")),
    Node("rivets", rivet_teeth, ("rivets",)),
)
FACE = Chain("face", NODES, pose)
TARGETS = Chain("face_targets", _TARGETS, pose)  # of steps 1 and 2, which differ by their targets
ROTATIONS = Chain("face_rotations", _without(*CONTACT, "wrinkles"), pose)
SMOOTH = Chain("face_smooth", _without("wrinkles"), pose)
LADDER = {1: TARGETS, 2: TARGETS, 3: ROTATIONS, 4: SMOOTH, 5: FACE, 6: FACE}
