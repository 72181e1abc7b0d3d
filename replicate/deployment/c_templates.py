"""The C99 files before a face is put into them: what is arithmetic stands there as C, what is a face's as $words."""

from collections.abc import Mapping
from pathlib import Path
from string import Template

FOLDER = Path(__file__).parent / "c"
TEMPLATES = (FOLDER / "face.h", FOLDER / "face.c")


def filled(stem: str, words: Mapping[str, object]) -> dict[str, str]:
    """Return the texts of the header and of the source by their names, stem.h and stem.c."""
    return {f"{stem}{file.suffix}": Template(file.read_text(encoding="ascii")).substitute(words) for file in TEMPLATES}
