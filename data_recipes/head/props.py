"""Display-only things: they ride along in pictures and are no part of the approximated mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Prop:
    name: str


def build_props(recipe, layout, x, curves):
    return ()
