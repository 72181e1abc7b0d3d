"""A rig as a folder of samples, the format in which rigs of other programs are read (data_recipes/sampled).

The poses are those of §3.5: every frame of the clips, and poses that Eq. 5 draws from the training frames of a split,
each with the frame that it was drawn from. Read with the same seed, split and configuration, they give the same
training, validation and test poses as the rig itself.
"""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int

from data_recipes.rig import Rig
from data_recipes.sampled.control_file import CONTROL_FILE, HEADER
from data_recipes.sampled.face_file import FACE_FILE
from data_recipes.sampled.importing import EYES_MM
from data_recipes.sampled.shards import FOLDER, UNFINISHED
from replicate.approximation.samples import PARTS, choose_poses, evaluate
from replicate.config import SamplesConfig
from replicate.engine.atomic_files import write_text
from replicate.engine.exceptions import InputError
from replicate.engine.stage import stream_rng
from replicate.geometry.mesh import Mesh

POSES_A_SHARD = 256
MESH_FILE = "mesh.obj"
STAGE = "samples"  # whose random streams the poses are drawn from


def write_sample_folder(
    rig: Rig, folder: Path, config: SamplesConfig, seed: int, progress: Callable | None = None
) -> int:
    """Write a rig as a folder of samples; return the number of its poses.

    folder: empty, or not there yet. progress: (total, label) → a context manager with update(k). `face.toml` goes last:
    a folder without it is not whole. Raises InputError for a folder with anything in it.
    """
    check_empty(folder)
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    write_text(folder / MESH_FILE, _obj(rig.mesh))
    write_text(folder / CONTROL_FILE, _controls(rig))
    total, shards = _poses(rig, config, seed)
    with progress(total, "poses") if progress else nullcontext() as bar:
        for number, arrays in enumerate(shards, start=1):
            for rows, vertices in evaluate(rig, arrays["params"]):
                arrays.setdefault("vertices", np.empty((len(arrays["params"]), *vertices.shape[1:]), np.float32))
                arrays["vertices"][rows] = vertices
            file = folder / FOLDER / f"{number:05d}.npz"
            with open(f"{file}{UNFINISHED}", "wb") as stream:
                np.savez(stream, **arrays)
            Path(f"{file}{UNFINISHED}").rename(file)
            if bar is not None:
                bar.update(len(arrays["params"]))
    write_text(folder / FACE_FILE, _face(rig))
    return total


def check_empty(folder: Path) -> None:
    """Raise InputError for a place with anything in it, where a folder is to be written."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} is there already: allowed is an empty folder, or a name that is free")


def _poses(rig: Rig, config: SamplesConfig, seed: int) -> tuple[int, Iterator[dict[str, np.ndarray]]]:
    """Return the number of poses, and the arrays of each shard without its vertices."""
    parts = choose_poses(rig, config, lambda stream: stream_rng(seed, STAGE, stream))
    if rig.clips is None:
        every = np.concatenate([parts[part] for part in PARTS])
        return len(every), _in_shards({"params": every})
    clips = [np.asarray(clip.values, np.float32) + np.float32(0) for clip in rig.clips]
    frames = np.concatenate(clips)
    names = np.repeat([clip.name for clip in rig.clips], [len(values) for values in clips])
    numbers = np.concatenate([np.arange(len(values)) for values in clips])
    drawn = parts["training"]
    source = _sources(frames, parts, config, seed)
    acted = {"params": frames, "clip": names, "frame": numbers}
    random = {"params": drawn, "clip": names[source], "frame": numbers[source], "drawn": np.ones(len(drawn), bool)}
    return len(frames) + len(drawn), (shard for arrays in (acted, random) for shard in _in_shards(arrays))


def _sources(
    frames: Float32[np.ndarray, "a m"], parts: dict[str, np.ndarray], config: SamplesConfig, seed: int
) -> Int[np.ndarray, " count"]:
    """Return which frame each training pose was drawn from.

    Eq. 5 takes the frames first thing from its stream, out of the animation less what is held out: the same draw again.
    """
    held_out = {pose.tobytes() for part in PARTS[1:] for pose in parts[part]}
    kept = np.flatnonzero([pose.tobytes() not in held_out for pose in frames])
    return kept[stream_rng(seed, STAGE, "augment").integers(len(kept), size=len(parts["training"]))]


def _in_shards(arrays: dict[str, np.ndarray]) -> Iterator[dict[str, np.ndarray]]:
    for first in range(0, len(arrays["params"]), POSES_A_SHARD):
        yield {name: array[first : first + POSES_A_SHARD] for name, array in arrays.items()}


def _face(rig: Rig) -> str:
    regions: dict[str, list[int]] = {}
    for vertex, region in zip(rig.control_points.tolist(), rig.control_point_regions, strict=True):
        regions.setdefault(region, []).append(vertex)
    lines = [
        f'name = "{rig.name}"',
        'unit = "mm"',
        'up = "y"',
        f'mesh = "{MESH_FILE}"',
        'segments = "groups"',
        f"eyes = {list(EYES_MM)}",
        'source = "written by make export-samples"',
        "",
        "[points]",
        f"landmarks = {rig.landmarks.tolist()}",
        "",
        "[points.control_points]",
        *(f"{region} = {vertices}" for region, vertices in regions.items()),
    ]
    return "\n".join(lines) + "\n"


def _controls(rig: Rig) -> str:
    rows = ([c.name, repr(c.lower), repr(c.default), repr(c.upper), c.region] for c in rig.controls)
    return "".join(",".join(row) + "\n" for row in (HEADER, *rows))


def _obj(mesh: Mesh) -> str:
    """Return the mesh as OBJ: a group a segment, which names its vertices by point elements too."""
    lines = ["# the neutral pose in mm; each vertex's texture coordinates are those of its own segment's chart"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.neutral.tolist()]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in mesh.uv.tolist()]
    for k, name in enumerate(mesh.segment_names):
        lines.append(f"g {name}")
        lines.append("p " + " ".join(str(vertex + 1) for vertex in np.flatnonzero(mesh.segment == k)))
        own = mesh.faces[mesh.face_segment == k] + 1
        lines += ["f " + " ".join(f"{vertex}/{vertex}" for vertex in face) for face in own.tolist()]
    return "\n".join(lines) + "\n"
