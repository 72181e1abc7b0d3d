"""The colours of a glTF's vertices, for pictures: its materials' factors and textures of base colour."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from jaxtyping import Float

from data_recipes.gltf.document import Document, read_view, reals, reference, table_of
from data_recipes.gltf.scene import Part, attribute
from replicate.base.exceptions import InputError

TEXELS = 256  # a side: a texture is made so small first, so that a vertex has the mean colour around it
MOST_PIXELS = 70_000_000
WEBP, TRANSFORM = "EXT_texture_webp", "KHR_texture_transform"


def read_colours(document: Document, parts: list[Part], n: int) -> Float[np.ndarray, "n 3"] | None:
    """Return each vertex's red, green and blue, from 0 to 1; None where no material says any.

    Textures count where they are in the file itself, in a format that Pillow reads.
    """
    colours, any_colour = np.ones((n, 3)), False
    for part in parts:
        index = reference(document, part.primitive, "material", part.place, "materials")
        if index is None:
            continue
        place = f"materials[{index}].pbrMetallicRoughness"
        table = table_of(document.tree["materials"][index], "pbrMetallicRoughness", f"materials[{index}]")
        colours[part.rows] = reals(table, "baseColorFactor", place, [1.0] * 4)[:3]
        any_colour |= "baseColorFactor" in table
        info = table_of(table, "baseColorTexture", place)
        uv = attribute(document, part, f"TEXCOORD_{info.get('texCoord', 0)}", "VEC2") if info else None
        texels = None if uv is None else _texels(document, info, f"{place}.baseColorTexture")
        if texels is not None:
            column, row = np.floor(uv % 1.0 * TEXELS).astype(int).clip(0, TEXELS - 1).T
            colours[part.rows] *= texels[row, column]
            any_colour = True
    return colours if any_colour else None


def _texels(document: Document, info: dict[str, Any], place: str) -> Float[np.ndarray, "t t 3"] | None:
    """Return a texture made small, row by row from the top, None if it can't be read or is moved about."""
    from PIL import Image

    texture = reference(document, info, "index", place, "textures")
    if texture is None or TRANSFORM in table_of(info, "extensions", place):
        return None
    entry, place = document.tree["textures"][texture], f"textures[{texture}]"
    webp = table_of(table_of(entry, "extensions", place), WEBP, f"{place}.extensions")
    image = reference(document, webp or entry, "source", place, "images")
    view = None if image is None else document.tree["images"][image].get("bufferView")
    if view is None:
        return None
    try:
        view = reference(document, document.tree["images"][image], "bufferView", f"images[{image}]", "bufferViews")
        with Image.open(io.BytesIO(bytes(read_view(document, view)[0]))) as picture:
            if picture.width * picture.height > MOST_PIXELS:
                return None
            small = picture.convert("RGB").resize((TEXELS, TEXELS), Image.Resampling.BOX)
    except InputError:
        raise
    except Exception:  # whatever Pillow stumbles over: only pictures are less colourful
        return None
    return np.asarray(small, np.float64) / 255
