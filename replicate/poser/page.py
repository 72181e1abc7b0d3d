"""The page to pose in (§5.3.1): one HTML file with style, script and data, which opens from disk and loads nothing."""

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template

import numpy as np

from replicate.poser.pack import as_text, packed

FRONT = Path(__file__).parent / "front"
TEMPLATE, STYLES = FRONT / "page.html", (FRONT / "poser.css", FRONT / "page.css")
SCRIPTS = tuple(
    FRONT / f"{name}.js"
    for name in (
        "packed", "networks", "regional", "maps", "face", "display", "pose", "pose_files", "drags", "view", "points",
        "panel", "poser",
    )
)  # fmt: skip
CHECKS = FRONT / "self_test.js"
SOURCES = (TEMPLATE, *STYLES, *SCRIPTS, CHECKS)  # what a page depends on beside its data
ABOUT = (
    "Drag a red dot: small networks (inverse kinematics, §4 of Fast and Deep Facial Deformations) find values of "
    "{controls} controls, and an approximation of the rig, {approximation}, turns these into {vertices:,} "
    "vertices. Nothing leaves this page."
)


def page(header: Mapping[str, object], arrays: Mapping[str, np.ndarray], provenance: str) -> str:
    """Return the HTML of a page to pose a face in.

    header, arrays: its contents. provenance: where it comes from, in a sentence.
    """
    counts = {"controls": len(header["controls"]), "vertices": len(arrays["neutral"])}
    about = ABOUT.format(approximation=header["approximation"], **counts)
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=html.escape(f"Pose the {header['character']}"),
        about=html.escape(about),
        provenance=html.escape(provenance),
        style=joined(STYLES),
        packed=as_text(packed(header, arrays)),
        script=joined((*SCRIPTS, CHECKS)),
    )


def joined(files: Sequence[Path]) -> str:
    """Return the text of some files, one after the other: of `SCRIPTS`, `mountPoser` and all that it needs."""
    return "\n".join(file.read_text(encoding="utf-8") for file in files)
