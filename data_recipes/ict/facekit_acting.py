"""The animation of a face in ICT-FaceKit's format: our invented acting, in its controls' names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data_recipes.acting.arkit_names import in_their_words, name_pairs
from data_recipes.acting.procedural_acting import DECIMALS, Acting, act
from data_recipes.controls import Control, control_groups


def perform(controls: Sequence[Control], acting: Acting) -> list[tuple[str, np.ndarray]]:
    """Return clips (name, (t, m) float32) for these controls, as `procedural_acting.act` does for ours.

    Ours act, those that have a counterpart; so expressions ease, speak, blink and look as on our own faces.
    """
    names = {name for name, *_ in name_pairs()}
    ours = [control for group in control_groups().values() for control in group if control.name in names]
    words, theirs = [control.name for control in ours], [control.name for control in controls]
    return [
        (name, np.round(in_their_words(words, theirs, values), DECIMALS).astype(np.float32))
        for name, values in act(ours, acting)
    ]
