"""How captions name a character whose segments they show: with the charts that its face lies in."""

import re
from collections.abc import Sequence


def with_layout(character: str, segment_names: Sequence[str]) -> str:
    """Return a character's name as results have it and in how many charts its face lies: "teen (face in 4 charts)".

    segment_names: those of its mesh; charts of the face are called face, or face_1, face_2 … (D21). The name alone
    where there are none.
    """
    charts = sum(bool(re.fullmatch(r"face(_\d+)?", name)) for name in segment_names)
    layout = {0: "", 1: " (face in one chart)"}.get(charts, f" (face in {charts} charts)")
    return character + layout
