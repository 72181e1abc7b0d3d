"""The posing page of one face: its approximation, its IK networks, what it checks itself by, and hair and eyes."""

from collections.abc import Callable

import numpy as np

from replicate.poser.check_poses import check_contents
from replicate.poser.contents import PosedFace, face_contents
from replicate.poser.display_parts import display_contents
from replicate.poser.page import page


def face_page(face: PosedFace, rng: np.random.Generator, progress: Callable, made_by: str) -> str:
    """Return the HTML of a face's page. rng: draws the poses that it checks itself by.

    progress: as `StageContext.progress`. made_by: where it comes from, in a sentence.
    """
    header, arrays = {}, {}
    for words, values in (face_contents(face), check_contents(face, rng), display_contents(face.rig, progress)):
        header |= words
        arrays |= values
    return page(header, arrays, made_by)
