"""The posing page as a browser shows it while points are dragged, as a strip of pictures.

Each picture is of the page opened with a link that keeps a pose, so that the browser's command line is enough.
"""

import base64
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np
from jaxtyping import Float, UInt8

from replicate.base.exceptions import RunError
from replicate.drawing.panels import Words, panel_grid
from replicate.inverse.control_points import control_points, targets_of_drags
from replicate.poser.contents import PosedFace
from replicate.poser.face_page import posed_vertices

if TYPE_CHECKING:
    import matplotlib.figure

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
GRAPHICS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")  # without a graphics card
SIZE, COLUMNS = (880, 640), 2  # of the window, px; pictures side by side
FINER = 2  # the browser draws this many pixels for one of the picture, for smooth edges
PAGE_MS, PATIENCE_S = 3_000, 300  # of the browser's clock until the picture; of waiting for it
LINK_STEPS, LINK_MM = 32_767, 0.01  # as front/pose_files.js has them
# What is dragged in turn, on all points whose names begin so: (outwards, up) mm.
DRAGS = (
    ("mouth_corner", "corners of the mouth", (9.0, 7.0)),
    ("brow", "brows", (0.0, 9.0)),
    ("chin", "chin", (0.0, -16.0)),
)


def browser() -> str | None:
    """Return the path of this machine's browser, None where there is none."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def pose_link(face: PosedFace, params: Float[np.ndarray, " m"], targets: Float[np.ndarray, "c 3"]) -> str:
    """Return the end of a page's address that keeps a pose: parameters, and where the control points are wanted."""
    rig = face.rig
    points = control_points(rig, face.influence)
    shares = LINK_STEPS * (params - rig.lower) / (rig.upper - rig.lower)
    moved = (targets - rig.mesh.neutral[points.vertices]) / LINK_MM
    values = np.rint(np.concatenate([shares, moved.ravel()])).clip(-LINK_STEPS, LINK_STEPS).astype("<i2")
    return f"{quote(rig.name, safe='')}.{base64.urlsafe_b64encode(values.tobytes()).decode().rstrip('=')}"


def strip(face: PosedFace, page: Path, program: str) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): the page at rest, and after each of some drags; None where none fits the face's points.

    page: the file. program: the browser. Raises RunError where the browser makes no picture.
    """
    titles, links = zip(*_poses(face), strict=True)
    if len(links) == 1:
        return None
    pictures = [picture(page, link, program) for link in links]
    missing = -len(pictures) % COLUMNS
    pictures += [np.full_like(pictures[0], 255)] * missing
    titles, drags, whose = [*titles, *[""] * missing], "; then ".join(titles[1:]), face.rig.name
    starts = range(0, len(pictures), COLUMNS)
    figure = panel_grid(*([parts[i : i + COLUMNS] for i in starts] for parts in (pictures, titles)))
    return figure, Words(
        f"The page to pose the {whose} in, as a browser shows it: at rest; then {drags}. Sliders go with the points.",
        f"The page that `make poser` writes, in a browser, while control points of the {whose} are dragged, one drag "
        "upon the other. Blue: controls that are no longer at rest.",
    )


def _poses(face: PosedFace) -> Iterator[tuple[str, str]]:
    """Yield a title and a link for the face at rest and after each drag."""
    points, params = control_points(face.rig, face.influence), np.array(face.rig.default, np.float32)
    targets = posed_vertices(face, params[None])[0, points.vertices]
    yield "at rest", pose_link(face, params, targets)
    for beginning, title, (outwards, up) in DRAGS:
        names = [name for name in points.names if name.startswith(beginning)]
        if names:
            side = {name: float(np.sign(targets[points.names.index(name), 0])) for name in names}
            after = targets_of_drags(targets, points.names, [(name, (side[name] * outwards, up)) for name in names])
            params, targets = face.dragged(params, targets, after), after
            yield f"{title} dragged {'up' if up > 0 else 'down'}", pose_link(face, params, targets)


def picture(page: Path, link: str, program: str) -> UInt8[np.ndarray, "h w 3"]:
    """Return what a browser shows of a page that is opened with a link. Raises RunError where it shows nothing."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "page.png"
        call = [program, "--headless", "--no-first-run", "--hide-scrollbars", "--disable-gpu", *GRAPHICS]
        call += ["--no-sandbox"] if os.geteuid() == 0 else []  # root can't have one
        call += [f"--user-data-dir={folder}/profile", f"--window-size={SIZE[0]},{SIZE[1]}", f"--screenshot={file}"]
        call += [f"--force-device-scale-factor={FINER}"]
        call += [f"--virtual-time-budget={PAGE_MS}", f"{page.resolve().as_uri()}#{link}"]
        try:
            subprocess.run(call, capture_output=True, timeout=PATIENCE_S, check=True)
            with Image.open(file) as image:
                return np.asarray(image.convert("RGB").reduce(FINER))
        except (OSError, subprocess.SubprocessError) as error:
            raise RunError(f"{program} made no picture of {page.name}: {error}") from error
