"""The animation of a face in ICT-FaceKit's format: our invented acting, translated to its controls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data_recipes.acting.arkit_names import in_their_words, name_pairs
from data_recipes.acting.procedural_acting import DECIMALS, Acting, act
from data_recipes.controls import Control, control_groups


def perform(controls: Sequence[Control], acting: Acting) -> list[tuple[str, np.ndarray]]:
    """Return clips (name, (t, m) float32) for these controls.

    Those of our controls that have a counterpart among them act as on our own faces (`procedural_acting.act`).
    """
    names = {name for name, *_ in name_pairs()}
    ours = [control for group in control_groups().values() for control in group if control.name in names]
    our_names, their_names = [control.name for control in ours], [control.name for control in controls]
    return [
        (name, np.round(in_their_words(our_names, their_names, values), DECIMALS).astype(np.float32))
        for name, values in act(ours, acting)
    ]
