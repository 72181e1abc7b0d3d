"""Where the control points of a character shall go: as its file of drags says, or as a script draws them (§5.3.1)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from data_recipes.recipe_paths import drags_file
from data_recipes.rig import Rig
from replicate.engine.stage import stream_rng
from replicate.inverse.control_points import ControlPoints
from replicate.inverse.drags import COUNT, read_drags, scripted_drags, targets_of


def files_of(character: str) -> tuple[Path, ...]:
    """Return the file of a character's drags, in a tuple of its own; an empty one where there is none."""
    file = drags_file(character)
    return (file,) if file.is_file() else ()


def configurations(
    rig: Rig, points: ControlPoints, files: Sequence[Path] = (), stream: str = "table4", count: int = COUNT
) -> Float32[np.ndarray, "k c 3"]:
    """Return where the control points shall go, (k, c, 3) mm, a configuration each.

    files: as of `files_of`. Without one a script draws `count` configurations from the random stream of that name.
    Raises InputError, naming the file, for one of anything else than this rig's drags.
    """
    if files:
        drags = read_drags(files[0], points.names)
    else:
        drags = scripted_drags(points.names, stream_rng(0, stream, "drags"), count)
    return targets_of(rig.mesh.neutral[points.vertices], points.names, drags)
