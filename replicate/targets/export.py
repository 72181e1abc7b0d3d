"""Poses and clips for other programs."""

import argparse
import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from data_recipes.catalogue import as_alembic, check_blender, expression_poses, read_clip
from data_recipes.rig import Rig, frames_per_second
from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.base.schema import either, shown
from replicate.base.user_files import as_whole_number, check_output_file
from replicate.cli.options import characters
from replicate.export import usd
from replicate.export.animation import Track, animated_glb, tracks_of
from replicate.export.files import Part, by_material, glb, moving_parts, obj, posed_parts, write_whole
from replicate.methods import artefacts
from replicate.poser.saved_pose import read_pose


def run(options: argparse.Namespace) -> None:
    """Write a pose or a clip of every character."""
    request = Request(options.pose, options.clip, options.params, options.to, options.tolerance)
    names = characters(options)
    if request.to is not None and len(names) > 1:
        raise InputError(f"{len(names)} characters can't all be written to {request.to}: name one, or leave out to")
    for character in names:
        files, about = export(artefacts.rig_of(character), request)
        print(f"written to {', '.join(paths.display_path(file.absolute()) for file in files)}: {about}")


# What `make export` does: choose a pose or a clip of a character by name, and write it to a file.

ALEMBIC = ".abc"
ENDINGS = (".glb", ".obj", *usd.ENDINGS, ALEMBIC)
TOLERANCE_MM = 0.05
LEAST_TOLERANCE_MM = 0.001
EXACT = 0.0  # the tolerance of a point cache


@dataclass(frozen=True)
class Request:
    """What to export: one of `pose`, `clip` and `params`, or none of them for the neutral pose.

    pose: an expression's name
    clip: a clip's name or number
    params: a CSV file of control values, a row a frame, or a pose that the posing page saved, as .json
    to: the file to write, else one in results/runs/export
    tolerance_mm: how far a vertex of a clip may be off; 0 for a USD with the points of every frame

    Raises InputError for more than one of the three, a file that can't be written, or a bad tolerance.
    """

    pose: str | None = None
    clip: str | None = None
    params: str | None = None
    to: str | None = None
    tolerance_mm: float = TOLERANCE_MM

    def __post_init__(self) -> None:
        sources = [name for name in ("pose", "clip", "params") if getattr(self, name) is not None]
        if len(sources) > 1:
            raise InputError(f"expected one of pose, clip and params, got {' and '.join(sources)}")
        is_usd = self.to is not None and Path(self.to).suffix.lower() in usd.ENDINGS
        is_exact = is_usd and self.tolerance_mm == EXACT
        if not (is_exact or LEAST_TOLERANCE_MM <= self.tolerance_mm < float("inf")):
            exact = ", or 0 for every frame's points in a USD" if is_usd else ""
            raise InputError(
                f"tolerance: expected a number of at least {LEAST_TOLERANCE_MM} mm{exact}, got {self.tolerance_mm}"
            )
        if self.to is not None:
            _check_file(paths.with_home(self.to, "to"))
            if self.clip is not None and Path(self.to).suffix.lower() == ".obj":
                raise InputError(f"{self.to} can hold one pose and not a clip: name a .glb or .usdc file")


def _check_file(file: Path) -> None:
    if file.suffix.lower() not in ENDINGS:
        raise InputError(f"{file}: expected a name that ends in {either(ENDINGS)}")
    if file.suffix.lower() in (*usd.ENDINGS, ALEMBIC):
        usd.check_usd()
    if file.suffix.lower() == ALEMBIC:
        check_blender()
    check_output_file(file)
    if not file.absolute().parent.is_dir():
        raise InputError(f"there is no folder {file.absolute().parent} to write {file.name} to: make it first")


def export(rig: Rig, request: Request) -> tuple[list[Path], str]:
    """Write a rig's pose or clip; return the files and what is in them, in words. Files appear whole or not at all.

    Raises InputError for an unknown pose or clip, or a bad file of parameters.
    """
    name, poses = requested_poses(rig, request)
    file = paths.with_home(request.to, "to") if request.to else paths.run_folder("export") / f"{rig.name}_{name}.glb"
    file.parent.mkdir(parents=True, exist_ok=True)
    about = {"character": rig.name, "pose": name}
    if file.suffix.lower() in usd.ENDINGS:
        return [file], _export_usd(rig, poses, request, file, about)
    if file.suffix.lower() == ALEMBIC:
        return _export_alembic(rig, poses, file)
    if len(poses) > 1:
        if file.suffix.lower() == ".obj":
            raise InputError(f"{file} can hold one pose, and {name} has {len(poses)}: name a .glb or .usdc file")
        rest, frames = moving_parts(rig, poses)
        about |= {"clip": about.pop("pose"), "frames_per_second": frames_per_second(rig)}
        data, tracks = animated_glb(rest, frames, about, request.tolerance_mm, frames_per_second(rig))
        write_whole(file, data)
        return [file], _summary(poses, tracks, len(data), frames_per_second(rig))
    head, *props = posed_parts(rig, poses[0])
    words = f"{len(head.vertices):,} vertices and {len(props)} props"
    if file.suffix.lower() == ".glb":
        write_whole(file, glb([head, *props], about))
        return [file], words
    material = file.with_suffix(".mtl")
    text, materials = obj([*by_material(rig, head), *props], f"{rig.name}, {name}", material.name)
    write_whole(material, materials.encode())
    write_whole(file, text.encode())
    return [file, material], words


def _export_usd(rig: Rig, poses: Float32[np.ndarray, "t m"], request: Request, file: Path, about: dict) -> str:
    """Write a pose or a clip as USD; return what is in it, in words."""
    controls, rate = usd.ControlTrack(rig.controls, poses), frames_per_second(rig)
    made = lambda parts: usd.usd(parts, about, file.suffix.lower(), rate, controls)  # noqa: E731
    if len(poses) == 1:
        head, *props = posed_parts(rig, poses[0])
        write_whole(file, made(_usd_parts(rig, [head, *props], [{}] * (1 + len(props)))))
        return f"{len(head.vertices):,} vertices and {len(props)} props"
    rest, frames = moving_parts(rig, poses)
    if request.tolerance_mm == EXACT:
        data = made(_usd_parts(rig, rest, [{"frames": positions} for positions in frames]))
        write_whole(file, data)
        return f"{len(poses)} frames at {rate:g} a second, the points of each; {len(data) / 1e6:.1f} MB"
    tracks = tracks_of(rest, frames, request.tolerance_mm)
    moved = [{"shapes": usd.track_shapes(track), "weights": track.weights} for track in tracks]
    data = made(_usd_parts(rig, rest, moved))
    write_whole(file, data)
    return _summary(poses, tracks, len(data), rate, "blend shapes")


def _export_alembic(rig: Rig, poses: Float32[np.ndarray, "t m"], file: Path) -> tuple[list[Path], str]:
    """Write a head's points in the neutral pose, frame 0, and in poses, and a table of the controls beside them."""
    poses, rate, table = np.concatenate([rig.default[None], poses]), frames_per_second(rig), file.with_suffix(".csv")
    (head, *_), (positions, *_) = moving_parts(rig, poses)
    made = usd.usd([usd.UsdPart(head, rig.mesh, frames=positions)], {}, ".usdc", rate)
    text = io.StringIO()
    names = [control.name for control in rig.controls]
    csv.writer(text, lineterminator="\n").writerows([names, *([repr(float(x)) for x in pose] for pose in poses)])
    data = as_alembic(made, rate)
    write_whole(table, text.getvalue().encode())
    write_whole(file, data)
    words = f"the head in its neutral pose and in {len(poses) - 1} more, at {rate:g} a second; {len(data) / 1e6:.1f} MB"
    return [file, table], words


def _usd_parts(rig: Rig, parts: list[Part], moved: list[dict]) -> list[usd.UsdPart]:
    """Return the head, with the rig's segments, and the props. moved: how each part moves, as fields."""
    meshes = [rig.mesh, *[None] * (len(parts) - 1)]
    return [
        usd.UsdPart(part, mesh, is_prop=mesh is None, **how)
        for part, mesh, how in zip(parts, meshes, moved, strict=True)
    ]


def _summary(poses: np.ndarray, tracks: list[Track], size_bytes: int, rate: float, what: str = "morph targets") -> str:
    head, worst = len(tracks[0].shapes), max(track.error_mm for track in tracks)
    return (
        f"{len(poses)} frames at {rate:g} a second; {head} {what} for the head, "
        f"no vertex more than {worst:.3f} mm off; {size_bytes / 1e6:.1f} MB"
    )


def requested_poses(rig: Rig, request: Request) -> tuple[str, Float32[np.ndarray, "t m"]]:
    """Return the name and the parameters (t, m) of the requested pose or clip; a pose has one row."""
    if request.params is not None:
        file = Path(request.params)
        is_pose = file.suffix.lower() == ".json"
        return file.stem, read_pose(file, rig)[0][None] if is_pose else read_clip(rig, file)
    if request.clip is not None:
        clip = _clip(rig, request.clip)
        return clip.name, np.asarray(clip.values, np.float32)
    poses = expression_poses(rig)
    name = request.pose if request.pose is not None else "neutral"
    if name not in poses:
        raise InputError(f"{rig.name} has no pose {shown(name)}; it has {', '.join(poses)}")
    return name, poses[name][None]


def _clip(rig, name: str):
    clips = {clip.name: clip for clip in rig.clips or ()}
    if name in clips:
        return clips[name]
    if not clips:
        raise InputError(f"{rig.name} has no clips: choose a pose, or a file of parameters")
    number = as_whole_number(name)
    if number is not None and number < len(clips):
        return list(clips.values())[number]
    choices = f"{', '.join(clips)}, numbered from 0 to {len(clips) - 1}"
    raise InputError(f"{rig.name} has no clip {shown(name)}; it has {choices}")
