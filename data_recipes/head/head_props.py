"""Display-only things: eyeballs, brows, lashes, hair, horns and a bust.

They ride along in pictures and are no part of the approximated mesh.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.brows import brow
from data_recipes.head.bust import bust
from data_recipes.head.eyeballs import eyeball, lashes
from data_recipes.head.hair import hair
from data_recipes.head.horns import horns
from data_recipes.head.prop_mesh import Prop, mirror_prop
from data_recipes.head.topology import Layout
from data_recipes.recipe.reading import Recipe

__all__ = ["Prop", "build_props"]


def build_props(recipe: Recipe, layout: Layout, x: Float[np.ndarray, "n 3"]) -> tuple[Prop, ...]:
    """Return a head's props; `x` are the head's vertices."""
    styles, left = recipe.props, eyeball(recipe)
    if styles.brows != "none":
        left.append(brow(recipe))
    if styles.lashes != "none":
        left.append(lashes(recipe, layout, x))
    props = [side for prop in left for side in (prop, mirror_prop(prop))]
    if styles.hair != "none":
        props.append(hair(recipe, x))
    if styles.horns != "none":
        props += horns(recipe)
    if styles.bust != "none":
        props.append(bust(recipe))
    return tuple(props)
