"""The posing page of the stand-in face."""

import numpy as np
from posed_face import posed_face

from replicate.base.progress import progress
from replicate.poser.contents import face_contents
from replicate.poser.display_parts import display_contents
from replicate.poser.face_page import check_contents
from replicate.poser.pack import page


def contents_of(face):
    """Return (header, arrays): all that the page of a face carries."""
    parts = face_contents(face), check_contents(face, np.random.default_rng(0)), display_contents(face.rig, progress)
    return tuple({k: v for part in parts for k, v in part[side].items()} for side in (0, 1))


def page_of(damage=lambda arrays: None, model=None):
    """Return the page as HTML. damage: changes what it carries. model: the approximation, as ours where it is None."""
    header, arrays = contents_of(posed_face(model))
    damage(arrays)
    return page(header, arrays, "a test & nothing else")
