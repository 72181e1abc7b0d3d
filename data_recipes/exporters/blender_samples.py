"""Write a rig of a Blender file as a folder of samples: a mesh, its controls, and poses with their vertices (§3.5).

This one file needs Blender (4.2 or newer) or the `bpy` package, and numpy; copy it wherever you like.

    blender --background face.blend --python blender_samples.py -- --mesh Head --out myface
    python blender_samples.py face.blend --mesh Head --out myface

Controls are channels of pose bones, values of shape keys, and custom properties with limits. Choose them by patterns
with --bones, --collections, --shape-keys and --properties; without any of these they are all that some action moves.
Shape keys with the same name on several meshes are one control; a control that moves no vertex is left out.
Actions are clips: all their frames are written, then poses drawn from them by Eq. 5. Without actions, poses are drawn
in which few controls move at a time, within limits. A second call goes on where the first one stopped.
"""

from __future__ import annotations

import argparse
import fnmatch
import hashlib
import json
import os
import re
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

# ---- The same text in every exporter, from here to the next such line: poses are drawn, and a folder is written. ----
SHARD = 250  # poses in a file
LOW, HIGH = 0.25, 3.0  # Eq. 5
GESTURES = (0.35, 0.3, 0.2, 0.1, 0.05)  # without animation: how often a pose has one, two, … of them
TOGETHER = 0.7  # how often both sides of a pair move alike
LONGEST = 200  # bytes of a control's name
STILL = 1e-6  # of the mesh's size: a control that moves no vertex farther has no effect
TRIES = 8  # poses in which controls without effect at rest are tried again
UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
REGIONS = {  # beginnings of words in a control's name → its region; the first that fits is taken
    "brow|eyebrow|forehead": "brows",
    "lid|eyelid|upperlid|lowerlid|blink|eye|squint": "eyes",
    "nose|nostril|nasal|sneer": "nose",
    "tongue": "tongue",
    "lip|upperlip|lowerlip|mouth|smile|frown|pucker|teeth|tooth": "mouth",
    "jaw|chin": "jaw",
    "cheek|puff": "cheeks",
    "ears?(?![a-z])": "ears",
    "neck|head": "neck",
}
SIDE = re.compile(r"(?i:(?<![a-z])(left|right|l|r)(?![a-z]))|(Left|Right)|(?<=[a-z])([LR])$")
MIDDLE = ("jaw", "mouth", "tongue", "head", "neck", "chin", "nose")  # of which left is a direction and no side
OPPOSITES = (
    ("up", "down"),
    ("in", "out"),
    ("left", "right"),
    ("open", "close"),
    ("wide", "blink"),
    ("wide", "squint"),
    ("smile", "frown"),
    ("upper", "lower"),
    ("raise", "lower"),
    ("pucker", "stretch"),
    ("puff", "suck"),
)


class Refusal(Exception):
    """The export can't be done, for the reason in the sentence."""


class Control(NamedTuple):
    """A control with its limits, or if it is not `limited`, the range of its use; `whole`: of whole numbers."""

    name: str
    lower: float
    default: float
    upper: float
    limited: bool = True
    whole: bool = False


class SampledRig(NamedTuple):
    """A rig as a program gives it, with n vertices and m controls.

    faces: (group, material, vertices of the corners, rows of `uvs` of the corners or None).
    clips: name → (numbers of the frames, parameters (t, m)).
    evaluate: parameters (m,) → vertices (n, 3).
    unit, up: of the vertices.
    remarks: sentences on what was joined, renamed or left out, for the end.
    """

    neutral: np.ndarray
    faces: list[tuple[str, str, Sequence[int], Sequence[int] | None]]
    uvs: np.ndarray
    controls: list[Control]
    clips: dict[str, tuple[np.ndarray, np.ndarray]]
    evaluate: Callable[[np.ndarray], np.ndarray]
    unit: str
    up: str
    frames_per_second: float
    remarks: tuple[str, ...] = ()


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that all exporters share."""
    parser.add_argument("--out", required=True, help="the folder that is written, or that goes on growing")
    parser.add_argument("--name", help="the character's name (default: the folder's)")
    parser.add_argument("--poses", type=int, default=10_000, help="poses to draw, beside all frames (default: 10000)")
    parser.add_argument("--seed", type=int, default=0, help="where random numbers start (default: 0)")
    parser.add_argument("--share", default="1/1", help="do a part, as 1/2 and 2/2 in two processes (default: 1/1)")
    parser.add_argument("--unit", choices=list(UNITS_MM), help="what one unit of the scene is")
    parser.add_argument("--segments", choices=["groups", "materials", "islands"], help="what a segment of the mesh is")
    parser.add_argument("--source", default="", help="a line on whose rig this is")
    parser.add_argument("--licence", default="", help="a line on its licence")
    parser.add_argument("--points", help="a file of TOML, [points] and so on, that is added to face.toml")


def region(name: str) -> str:
    """Return the region of the face that a control belongs to, by its name."""
    words = re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower()
    return next((found for starts, found in REGIONS.items() if re.search(f"(?<![a-z])(?:{starts})", words)), "face")


def names_of_controls(names: Sequence[str]) -> list[str]:
    """Return different names of at most LONGEST printable bytes without commas and quotes, for a CSV table."""
    taken: list[str] = []
    for name in names:
        clean = "".join(c if c.isprintable() and c not in ',"' else "_" for c in name).strip() or "control"
        k, chosen = 1, clean.encode()[:LONGEST].decode(errors="ignore")
        while chosen in taken:
            k += 1
            chosen = clean.encode()[: LONGEST - 1 - len(str(k))].decode(errors="ignore") + f"~{k}"
        taken.append(chosen)
    return taken


def renamed(controls: Sequence[Control]) -> tuple[list[Control], tuple[str, ...]]:
    """Return the controls with names for a CSV table, and a remark if that isn't what they are called."""
    names = names_of_controls([control.name for control in controls])
    changed = [f"'{c.name}' to '{name}'" for c, name in zip(controls, names) if name != c.name]  # noqa: B905
    reason = f"names occur once, have at most {LONGEST} bytes, no commas and no quotes"
    remarks = (f"controls renamed, since in controls.csv {reason}: {listed(changed)}",) if changed else ()
    return [c._replace(name=name) for c, name in zip(controls, names)], remarks  # noqa: B905


def listed(names: Sequence[str], most: int = 30) -> str:
    """Return names as a list in a sentence, the number of those beyond the first ones instead of their names."""
    return ", ".join(names[:most]) + (f" and {len(names) - most:,} more" if len(names) > most else "")


def join(
    controls: Sequence[Control],
    shapes: Sequence[tuple[str, str] | None],
    clips: dict[str, tuple[np.ndarray, np.ndarray]],
) -> tuple[list[Control], np.ndarray, dict[str, tuple[np.ndarray, np.ndarray]], tuple[str, ...]]:
    """Return one control for shapes that have one name on several meshes: controls, columns, clips and remarks.

    A joined control goes as far as any of its shapes. In a clip it moves as the first of them that moves there.
    Columns are those of the new controls, for each former one.

    shapes: for each control the name and the mesh of the shape whose weight it is, or None.
    """
    groups: dict[object, list[int]] = {}
    for i, shape in enumerate(shapes):
        groups.setdefault(shape[0] if shape else i, []).append(i)
    columns = np.zeros(len(controls), int)
    joined, differ, of_meshes = [], [], {}
    moved = {name: np.zeros((len(values), len(groups))) for name, (_, values) in clips.items()}
    for column, (name, group) in enumerate(groups.items()):
        columns[group] = column
        parts = [controls[i] for i in group]
        default = min((part.default for part in parts), key=abs)
        limits = min(part.lower for part in parts), default, max(part.upper for part in parts)
        joined.append(parts[0] if len(group) == 1 else Control(name, *limits))
        if len(group) > 1:
            of_meshes.setdefault(", ".join(shapes[i][1] for i in group), []).append(name)
        for clip, (_, values) in clips.items():
            moving = [i for i in group if np.abs(values[:, i] - controls[i].default).max() > 1e-6]
            moved[clip][:, column] = values[:, (moving or group)[0]]
            if any(np.abs(values[:, i] - values[:, moving[0]]).max() > 1e-3 for i in moving[1:]):
                differ.append(f"{name} in {clip}")
    clips = {name: (frame_numbers, moved[name]) for name, (frame_numbers, _) in clips.items()}
    remarks = ()
    if of_meshes:
        which = "; ".join(f"{listed(names)} ({meshes})" for meshes, names in of_meshes.items())
        remarks += (f"shapes with one name on several meshes, now one control each: {which}",)
    if differ:
        remarks += (f"of these, animated differently on several meshes, so as on the first: {listed(differ)}",)
    return joined, columns, clips, remarks


def without_effect(rig: SampledRig) -> list[int]:
    """Return the columns of the controls that move no vertex between their limits.

    They are tried from rest, and again from poses in which all controls are anywhere, for some act only with others.
    Many are tried at once, by amounts of their own so that opposites don't cancel, and halved while something moves.
    """
    lower, default, upper = (np.array([c[i] for c in rig.controls]) for i in (1, 2, 3))
    whole = np.array([c.whole for c in rig.controls])
    least = STILL * np.ptp(rig.neutral, axis=0).max()
    generator = np.random.default_rng(0)

    def posed(params: np.ndarray) -> np.ndarray:
        return rig.evaluate(np.where(whole, np.round(params), params).astype(np.float32))

    def moving(base: np.ndarray, at_base: np.ndarray, goal: np.ndarray, columns: list[int]) -> list[int]:
        params = base.copy()
        params[columns] = goal[columns]
        if np.abs(posed(params) - at_base).max() <= least:  # False for NaN
            return []
        if len(columns) == 1:
            return columns
        halves = columns[: len(columns) // 2], columns[len(columns) // 2 :]
        return [i for half in halves for i in moving(base, at_base, goal, half)]

    share = generator.uniform(0.5, 1.0, len(default))
    tries = [(default, default + share * (end - default)) for end in (upper, lower)]
    tries += [(default, upper), (default, lower)]
    for _ in range(TRIES):
        anywhere, elsewhere = generator.uniform(lower, upper), generator.uniform(lower, upper)
        tries += [(anywhere, default), (anywhere, elsewhere)]
    still = list(range(len(default)))
    for base, goal in tries:
        if still:
            found = set(moving(base, posed(base), goal, still))
            still = [i for i in still if i not in found]
    return still


def without_idle(rig: SampledRig) -> SampledRig:
    """Return the rig without controls that have no effect, and without clips that move only these.

    Raises Refusal if no control has an effect.
    """
    say(f"trying what each of {len(rig.controls)} controls moves")
    idle = without_effect(rig)
    if not idle:
        return rig
    kept = np.delete(np.arange(len(rig.controls)), idle)
    names = listed([rig.controls[i].name for i in idle])
    if not len(kept):
        raise Refusal(f"no control is left: no vertex of the meshes moves by {names}")
    default = np.array([c.default for c in rig.controls])

    def evaluate(params: np.ndarray) -> np.ndarray:
        every = default.astype(np.float32)
        every[kept] = params
        return rig.evaluate(every)

    away = {name: np.abs(values - default).max(axis=0) > 1e-6 for name, (_, values) in rig.clips.items()}
    lost = [name for name, moves in away.items() if moves.any() and not moves[kept].any()]
    clips = {name: (numbers, v[:, kept]) for name, (numbers, v) in rig.clips.items() if name not in lost}
    remark = f"controls left out, since they move no vertex of the meshes between their limits: {names}"
    remark += f"; clips left out, since they move only these: {listed(lost)}" if lost else ""
    controls = [rig.controls[i] for i in kept]
    return rig._replace(controls=controls, clips=clips, evaluate=evaluate, remarks=(*rig.remarks, remark))


def mirrored_pairs(names: Sequence[str]) -> list[list[int]]:
    """Return the controls by their places, left and right of a pair together, in the order of their first."""
    groups: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        side = (None, *SIDE.finditer(name))[-1]
        if side:
            before, after = name[: side.start()], name[side.end() :]
            if re.sub("[^a-z]", "", re.split("[.|:]", before.rstrip(".|:"))[-1].lower()) not in MIDDLE or after:
                name = f"{before}*{after}"
        groups.setdefault(name, []).append(place)
    return list(groups.values())


def opposite(first: str, second: str) -> bool:
    """Tell whether two names differ by one word and its opposite, such as jawLeft and jawRight, or up and down."""
    a, b = (re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", name) for name in (first, second))
    different = [{x.lower(), y.lower()} for x, y in zip(a, b) if x.lower() != y.lower()]  # noqa: B905
    return len(a) == len(b) and len(different) == 1 and any(different[0] == set(pair) for pair in OPPOSITES)


def sparse_pose(controls: Sequence[Control], generator: np.random.Generator) -> np.ndarray:
    """Return a pose of few gestures, each a control or a pair of them, between their defaults and their limits."""
    values = np.array([control.default for control in controls], dtype=float)
    pairs = mirrored_pairs([control.name for control in controls])
    count = 1 + int(generator.choice(len(GESTURES), p=GESTURES))
    chosen: list[int] = []
    for group in generator.permutation(len(pairs)):
        members = pairs[group]
        if len(members) > 1 and generator.random() > TOGETHER:
            members = [members[int(generator.integers(len(members)))]]
        if any(opposite(controls[a].name, controls[b].name) for a in members for b in chosen):
            continue
        amount = generator.beta(2.0, 1.3)
        up = generator.random() < 0.5
        for k in members:
            c = controls[k]
            goes_up = c.upper > c.default and (up or c.lower >= c.default)
            limit = c.upper if goes_up else c.lower
            values[k] = c.default + amount * generator.uniform(0.85, 1.0) * (limit - c.default)
        chosen += members
        count -= 1
        if not count:
            break
    return values


def draw_pose(controls: Sequence[Control], frames: np.ndarray, seed: int, index: int) -> tuple[np.ndarray, int]:
    """Return the parameters of a drawn pose and its frame of origin (Eq. 5), or a sparse pose and -1 without frames.

    frames: (a, m). A frame's distances from the defaults are multiplied by random factors; limits hold where controls
    have them. A seed and an index always give the same pose, whatever was drawn before.
    """
    generator = np.random.default_rng([seed, index])
    lower, default, upper = (np.array([c[i] for c in controls]) for i in (1, 2, 3))
    if len(frames):
        source = int(generator.integers(len(frames)))
        params = default + generator.uniform(LOW, HIGH, len(controls)) * (frames[source] - default)
        limited = np.array([c.limited for c in controls])
        params = np.where(limited, np.clip(params, lower, upper), params)
    else:
        source, params = -1, sparse_pose(controls, generator)
    return np.where([c.whole for c in controls], np.round(params), params).astype(np.float32), source


def pieces_to_write(names: Sequence[str], kind: str, total: int, share: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """Yield (first pose, end) of each file that is still to be written, at most SHARD poses each.

    names: of the files that are there. They stay; if the last of them is shorter than SHARD, its rest becomes one more
    file.
    share: (i, k) for every k-th file, from the i-th.
    """
    pattern = re.compile(rf"{kind}-(\d+)-(\d+)\.npz")
    there = [(int(m[1]), int(m[2])) for m in map(pattern.fullmatch, names) if m]
    for start in range(0, total, SHARD):
        done = max((last for first, last in there if first // SHARD == start // SHARD), default=start)
        end = min(start + SHARD, total)
        if start // SHARD % share[1] == share[0] - 1 and done < end:
            yield done, end


def write_whole(path: Path, write: Callable) -> None:
    """Write a file under a name that ends in .part and rename it when it is complete."""
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    with open(part, "wb") as file:
        write(file)
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, path)


def mesh_text(rig: SampledRig, name: str) -> str:
    """Return the neutral mesh as an OBJ with UVs, groups and materials."""
    lines = [f"# {name}"] + [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in rig.neutral.tolist()]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in rig.uvs.tolist()]
    group = material = None
    for of_group, of_material, corners, uvs in rig.faces:
        if of_group != group:
            group = of_group
            lines.append(f"g {group}")
        if of_material != material:
            material = of_material
            lines.append(f"usemtl {material}")
        at = [f"{v + 1}" for v in corners] if uvs is None else [f"{v + 1}/{t + 1}" for v, t in zip(corners, uvs)]  # noqa: B905
        lines.append("f " + " ".join(at))
    return "\n".join(lines) + "\n"


def face_text(rig: SampledRig, options: argparse.Namespace, name: str) -> str:
    """Return the text of face.toml."""
    groups, materials = ({face[i] for face in rig.faces} for i in (0, 1))
    segments = options.segments or ("materials" if len(materials) > 1 else "groups" if len(groups) > 1 else "islands")
    if segments == "islands" and not len(rig.uvs):
        segments = "groups"
    values = {"name": name, "unit": rig.unit, "up": rig.up, "mesh": "mesh.obj", "segments": segments}
    lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in values.items()]
    lines += [f"frames_per_second = {rig.frames_per_second:g}"] if rig.clips else []
    lines += [f"{k} = {json.dumps(v, ensure_ascii=False)}" for k in ("source", "licence") if (v := getattr(options, k))]
    return "\n".join(lines) + "\n" + (Path(options.points).read_text("utf-8") if options.points else "")


def controls_text(controls: Sequence[Control]) -> str:
    """Return the text of controls.csv."""
    rows = [f"{c.name},{c.lower:.9g},{c.default:.9g},{c.upper:.9g},{region(c.name)}" for c in controls]
    return "\n".join(["name,lower,default,upper,region", *rows]) + "\n"


def check(rig: SampledRig, options: argparse.Namespace) -> tuple[str, tuple[int, int]]:
    """Return the character's name, and the share of the work, (i, k), that --share names.

    Raises Refusal for options or a rig that don't fit.
    """
    name = options.name or Path(options.out).resolve().name
    share = re.fullmatch(r"([1-9]\d*)/([1-9]\d*)", options.share)
    if not share or int(share[1]) > int(share[2]):
        raise Refusal(f"--share: expected a part such as 1/2 or 2/2, got {options.share}")
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,40}", name):
        raise Refusal(f"--name: expected 1 to 40 letters, digits, _ and -, got '{name}'")
    if not rig.controls:
        raise Refusal("no control is left: the patterns match none that is free to move")
    if options.poses < 0 or options.seed < 0:
        raise Refusal(f"--poses and --seed: expected numbers of at least 0, got {options.poses} and {options.seed}")
    if not rig.clips and options.poses < 20:
        raise Refusal(f"--poses: expected at least 20, since the rig has no animation, got {options.poses}")
    size = np.ptp(rig.neutral, axis=0).max() * UNITS_MM[rig.unit]
    if not 50 <= size <= 1000:
        raise Refusal(
            f"the mesh is {size:,.0f} mm large, expected 50 to 1,000 mm: give the unit of the scene by --unit"
        )
    if options.points and not Path(options.points).is_file():
        raise Refusal(f"--points: there is no file {options.points}")
    return name, (int(share[1]), int(share[2]))


def begin(rig: SampledRig, folder: Path, options: argparse.Namespace, name: str) -> None:
    """Write the files that describe the rig. Raises Refusal for a folder of another rig or of something else."""
    frames = b"".join(n.tobytes() + p.astype(np.float32).tobytes() for n, p in rig.clips.values())
    texts = {"mesh": repr(rig.faces), "controls": controls_text(rig.controls), "clips": repr(list(rig.clips))}
    record = {key: hashlib.sha256(text.encode()).hexdigest() for key, text in texts.items()}
    record |= {"frames": hashlib.sha256(frames).hexdigest(), "seed": options.seed, "poses in a file": SHARD}
    record |= {} if rig.clips else {"draws": "few controls at a time"}
    mark = folder / ".export.json"
    foreign = folder.exists() and any(not path.name.startswith(".") for path in folder.iterdir())
    if mark.exists():  # looked for after other files, for another process that begins now writes the mark first
        there = json.loads(mark.read_text("utf-8"))
        other = [key for key in record if record[key] != there.get(key)]
        if other:
            raise Refusal(f"{folder} holds an export with other {', '.join(other)}: name another folder, or remove it")
    elif foreign:
        raise Refusal(f"{folder} has files that no exporter wrote: name another folder")
    folder.mkdir(parents=True, exist_ok=True)
    files = {mark.name: json.dumps(record, indent=1), "mesh.obj": mesh_text(rig, name)}
    files |= {"controls.csv": texts["controls"], "face.toml": face_text(rig, options, name)}
    for file, text in files.items():
        if not (folder / file).exists():
            write_whole(folder / file, lambda handle, text=text: handle.write(text.encode()))
    (folder / "poses").mkdir(exist_ok=True)


def check_unchanged(rig: SampledRig, shards: Sequence[Path]) -> None:
    """Raise Refusal if the rig gives other vertices now for a pose that is there."""
    for path in shards[:1]:
        with np.load(path) as there:
            far = np.abs(rig.evaluate(there["params"][-1]) - there["vertices"][-1]).max()
        if not far <= 1e-3 * np.ptp(rig.neutral, axis=0).max():
            raise Refusal(f"the rig has changed: it gives another last pose than {path} has; name another folder")


def export(rig: SampledRig, options: argparse.Namespace) -> None:
    """Write the folder, file by file, or go on where an earlier call stopped. Raises Refusal."""
    folder = Path(options.out)
    name, share = check(rig, options)
    begin(rig, folder, options, name)
    frames = np.concatenate([np.zeros((0, len(rig.controls)))] + [values for _, values in rig.clips.values()])
    origin = [(clip, int(number)) for clip, (frame_numbers, _) in rig.clips.items() for number in frame_numbers]
    shards = sorted((folder / "poses").glob("*.npz"))
    check_unchanged(rig, shards)
    names = [path.name for path in shards]
    work = [("frames", *piece) for piece in pieces_to_write(names, "frames", len(frames), share)]
    work += [("drawn", *piece) for piece in pieces_to_write(names, "drawn", options.poses, share)]
    total, done, started = sum(end - start for _, start, end in work), 0, time.monotonic()
    say(
        f"{len(rig.neutral):,} vertices, {len(rig.controls)} controls, {len(rig.clips)} clips of {len(frames):,} frames"
    )
    for kind, start, end in work:
        drawn = kind == "drawn"
        poses = [
            draw_pose(rig.controls, frames, options.seed, i) if drawn else (frames[i].astype(np.float32), i)
            for i in range(start, end)
        ]
        vertices = np.stack([rig.evaluate(params).astype(np.float32) for params, _ in poses])
        if not np.isfinite(vertices).all():
            bad = start + int(np.argmin(np.isfinite(vertices).all(axis=(1, 2))))
            raise Refusal(
                f"pose {bad} of the {kind}: expected finite vertices, got others: the rig breaks in this pose"
            )
        arrays = {"params": np.stack([params for params, _ in poses]), "vertices": vertices}
        if origin:
            clips, frame_numbers = zip(*(origin[source] for _, source in poses))  # noqa: B905
            arrays |= {"clip": np.array(clips), "frame": np.array(frame_numbers), "drawn": np.full(end - start, drawn)}
        path = folder / "poses" / f"{kind}-{start:07d}-{end:07d}.npz"
        write_whole(path, lambda file, arrays=arrays: np.savez(file, **arrays))
        done += end - start
        rate = done / (time.monotonic() - started)
        say(f"{done:,} of {total:,} poses, {rate:.3g} a second, {(total - done) / rate / 60:.1f} minutes left")
    for remark in rig.remarks:
        say(remark)
    say(f"{folder} has all of its poses" if not total else f"written to {folder}")


def say(sentence: str) -> None:
    """Print a line on standard error."""
    print(sentence, file=sys.stderr, flush=True)


# ---- The end of the text that is the same in every exporter. ----


AXES = "xyz"
REACH = {"rotation": 15.0, "scale": 0.1}  # of channels without limits, about the default; location: see `bone_controls`
SUBDIVIDE = ("SUBSURF", "MULTIRES")
PARTS = {"QUATERNION": 4, "AXIS_ANGLE": 4}  # of a rotation; Euler angles have three
CUT = range(60, 64)  # bytes of a name that Blender may have cut: it keeps whole letters, of up to four bytes


class Channel(NamedTuple):
    """The value that a control sets.

    kind: location, rotation, scale, key or property.
    block: the data block.
    owner: a bone, a shape key, or the block itself.
    item: an axis, or the name of a key or property.
    """

    kind: str
    block: object
    owner: object
    item: str | int

    def curves(self) -> list[tuple[str, int]]:
        """Return path and index of all curves that move it: each part of a quaternion turns a bone about all axes."""
        base = "" if self.owner == self.block else self.owner.path_from_id()
        if self.kind == "key":
            return [(f"{base}.value", 0)]
        if self.kind == "property":
            return [(f"{base}[{json.dumps(self.item, ensure_ascii=False)}]", 0)]
        if self.kind != "rotation":
            return [(f"{base}.{self.kind}", self.item)]
        if turns_by_euler(self.owner):
            return [(f"{base}.rotation_euler", self.item)]
        mode = self.owner.rotation_mode
        return [(f"{base}.rotation_{mode.lower()}", i) for i in range(PARTS[mode])]


def turns_by_euler(bone: object) -> bool:
    """Tell whether a bone turns by Euler angles."""
    return bone.rotation_mode not in PARTS


def pick_meshes(options: argparse.Namespace) -> list:
    """Return the mesh objects of --mesh, ready to be evaluated. Raises Refusal for an unknown or hidden one."""
    import bpy

    every = [o.name for o in bpy.context.view_layer.objects if o.type == "MESH"]
    chosen = []
    for name in options.mesh:
        if name not in every:
            raise Refusal(f"there is no mesh '{name}' in the view layer: there are {', '.join(every[:20]) or 'none'}")
        chosen.append(bpy.data.objects[name])
    for obj in chosen:
        obj.hide_viewport, obj.show_only_shape_key = False, False
        obj.hide_set(False)
        if not obj.visible_get():
            raise Refusal(f"the mesh '{obj.name}' is in a hidden collection, where nothing is evaluated: show it")
        for modifier in obj.modifiers:
            if modifier.type in SUBDIVIDE and modifier.show_viewport:
                modifier.show_viewport = False
                say(f"{obj.name}: its modifier {modifier.name} is switched off, since it makes new vertices")
    return chosen


def pick_armatures(options: argparse.Namespace, meshes: Sequence) -> list:
    """Return the armatures of --armature, else those that move the meshes, else all."""
    import bpy

    every = [o for o in bpy.context.view_layer.objects if o.type == "ARMATURE"]
    if options.armature:
        missing = [name for name in options.armature if name not in [o.name for o in every]]
        if missing:
            raise Refusal(
                f"there is no armature '{missing[0]}': there are {', '.join(o.name for o in every) or 'none'}"
            )
        every = [o for o in every if o.name in options.armature]
    else:
        move = {m.object for o in meshes for m in o.modifiers if m.type == "ARMATURE"} | {o.parent for o in meshes}
        every = [o for o in every if o in move] or every
    for armature in every:
        armature.data.pose_position = "POSE"
    return every


def matches(name: str, patterns: Sequence[str]) -> bool:
    """Tell whether a name matches one of some patterns, in which * stands for anything and [ for itself."""
    return any(fnmatch.fnmatchcase(name, pattern.replace("[", "[[]")) for pattern in patterns)


def driven(block: object) -> set[tuple[str, int]]:
    """Return path and index of all values of a data block that drivers set; these can't be controls."""
    data = getattr(block, "animation_data", None)
    return {(curve.data_path, curve.array_index) for curve in data.drivers} if data else set()


def bone_controls(armature: object, options: argparse.Namespace, every: bool) -> Iterator[tuple[Control, Channel]]:
    """Yield the free channels of the bones that the options name, or of every bone, with limits from constraints."""
    taken = driven(armature)
    for bone in armature.pose.bones:
        collections = [collection.name for collection in bone.bone.collections]
        named = matches(bone.name, options.bones) or any(matches(name, options.collections) for name in collections)
        if not (named or every):
            continue
        limits = {c.type: c for c in bone.constraints if c.type.startswith("LIMIT_") and c.owner_space == "LOCAL"}
        for kind in options.channels.split(","):
            for axis in range(3):
                channel = Channel(kind, armature, bone, axis)
                if getattr(bone, f"lock_{kind}")[axis] or not taken.isdisjoint(channel.curves()):
                    continue
                default = 1.0 if kind == "scale" else 0.0
                reach = REACH.get(kind, 0.25 * bone.length) * options.reach
                lower, upper, limited = default - reach, default + reach, False
                limit = limits.get(f"LIMIT_{kind.upper()}")
                if limit is not None and not limit.mute:
                    lower, upper, limited = limit_of(limit, kind, axis) or (lower, upper, False)
                name = f"{bone.name}.{kind}_{AXES[axis]}"
                yield Control(name, min(lower, default), default, max(upper, default), limited), channel


def limit_of(limit: object, kind: str, axis: int) -> tuple[float, float, bool] | None:
    """Return (lower, upper, True) where a constraint limits a channel on both sides, else None."""
    letter, degrees = AXES[axis], kind == "rotation"
    below = getattr(limit, f"use_limit_{letter}" if degrees else f"use_min_{letter}")
    above = getattr(limit, f"use_limit_{letter}" if degrees else f"use_max_{letter}")
    sides = [getattr(limit, f"{side}_{letter}") for side in ("min", "max")]
    if not (below and above and sides[0] < sides[1]):
        return None
    return *(float(np.degrees(side)) if degrees else side for side in sides), True


def key_controls(keys: object, options: argparse.Namespace, every: bool) -> Iterator[tuple[Control, Channel]]:
    """Yield the shape keys that the options name, or every one, unless they are muted or driven."""
    taken = driven(keys)
    for key in keys.key_blocks[1:]:
        channel = Channel("key", keys, key, key.name)
        named = matches(key.name, options.shape_keys) or every
        if named and not key.mute and taken.isdisjoint(channel.curves()):
            lower, upper = key.slider_min, key.slider_max
            yield Control(key.name, lower, min(max(0.0, lower), upper), upper), channel


def property_controls(block: object, options: argparse.Namespace, every: bool) -> Iterator[tuple[Control, Channel]]:
    """Yield the custom properties of an object and its bones that have limits and are named, or all; none driven."""
    taken = driven(block)
    for owner in (block, *(block.pose.bones if block.type == "ARMATURE" else ())):
        for name, value in owner.items():
            if not isinstance(value, (int, float)):
                continue
            channel = Channel("property", block, owner, name)
            full = name if owner == block else f"{owner.name}.{name}"
            about = owner.id_properties_ui(name).as_dict() | ({"min": 0, "max": 1} if isinstance(value, bool) else {})
            lower, upper, default = (float(about.get(key, 0.0)) for key in ("min", "max", "default"))
            named = matches(name, options.properties) or matches(full, options.properties) or every
            if named and taken.isdisjoint(channel.curves()) and lower < upper and upper - lower < 1e6:
                default = min(max(default, lower), upper)
                yield Control(full, lower, default, upper, whole=not isinstance(value, float)), channel


def curves_of(action: object) -> Iterator[tuple[str, str, object]]:
    """Yield (kind of block, name of the slot or "", curve) of an action, before and after Blender had layers."""
    if getattr(action, "slots", None) is None:
        yield from ((action.id_root, "", curve) for curve in action.fcurves)
        return
    for layer in action.layers:
        for strip in layer.strips:
            for slot in action.slots:
                bag = strip.channelbag(slot)
                yield from ((slot.target_id_type, slot.name_display, curve) for curve in (bag.fcurves if bag else ()))


def read_action(action: object, channels: Sequence[Channel]) -> dict[int, dict[int, object]]:
    """Return the curves of an action that move channels: the channel's column → index → curve."""
    moved: dict[tuple, list[int]] = {}
    for column, channel in enumerate(channels):
        for path, index in channel.curves():
            moved.setdefault((channel.block.id_type, path, index), []).append(column)
    found: dict[int, dict[int, object]] = {}
    for kind, slot, curve in curves_of(action):
        columns = moved.get((kind, curve.data_path, curve.array_index), ())
        of_slot = [column for column in columns if channels[column].block.name == slot] or columns
        for column in () if curve.mute else of_slot:
            found.setdefault(column, {})[curve.array_index] = curve
    return found


def value_at(channel: Channel, curves: dict[int, object], frame: float) -> float:
    """Return a channel's value in a frame; of a rotation degrees, of a quaternion those of its rotation vector."""
    if channel.kind != "rotation":
        return next(iter(curves.values())).evaluate(frame)
    if turns_by_euler(channel.owner):
        return float(np.degrees(curves[channel.item].evaluate(frame)))
    from mathutils import Quaternion

    by_quaternion = channel.owner.rotation_mode == "QUATERNION"
    parts = [1.0, 0.0, 0.0, 0.0] if by_quaternion else [0.0, 0.0, 1.0, 0.0]
    parts = [curves[i].evaluate(frame) if i in curves else part for i, part in enumerate(parts)]
    turn = Quaternion(parts) if by_quaternion else Quaternion(parts[1:], parts[0])
    return float(np.degrees(rotation_vector(turn)[channel.item]))


def rotation_vector(turn: object) -> np.ndarray:
    """Return a quaternion's rotation vector of at most half a turn, radians."""
    turn = turn.normalized()
    turn = -turn if turn.w < 0 else turn
    return np.array(turn.to_exponential_map())


def read_clips(
    controls: Sequence[Control], channels: Sequence[Channel], options: argparse.Namespace
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], set[int]]:
    """Return the actions as clips, and the columns of the controls that some action moves."""
    import bpy

    clips, keyed = {}, set()
    default = np.array([c.default for c in controls])
    for action in sorted(bpy.data.actions, key=lambda action: action.name):
        if not matches(action.name, options.actions):
            continue
        curves = read_action(action, channels)
        if not curves:
            continue
        first, last = (round(float(end)) for end in action.frame_range)
        frame_numbers = np.arange(first, last + 1)
        values = np.tile(default, (len(frame_numbers), 1))
        for column, of_channel in curves.items():
            values[:, column] = [value_at(channels[column], of_channel, frame) for frame in frame_numbers.tolist()]
        clips[action.name] = frame_numbers, np.where([c.whole for c in controls], np.round(values), values)
        keyed |= {column for column in curves if np.abs(values[:, column] - default[column]).max() > 1e-6}
    return clips, keyed


def without_repeats(
    clips: dict[str, tuple[np.ndarray, np.ndarray]], default: np.ndarray
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], tuple[str, ...]]:
    """Return the clips without those that move nothing but what another one moves alike, and a remark on them.

    Such is the action of the teeth's shape keys, where another has those of the whole face in the same frames.
    """
    kept = dict(clips)
    for name, (numbers, values) in clips.items():
        moves = np.abs(values - default).max(axis=0) > 1e-6
        for other, (others, of_other) in kept.items():
            at = numbers - others[0]
            if other != name and moves.any() and at[0] >= 0 and at[-1] < len(others):
                if np.abs(of_other[at][:, moves] - values[:, moves]).max() <= 1e-6:
                    del kept[name]
                    break
    repeats = [name for name in clips if name not in kept]
    remarks = (f"clips left out, since all that they move is in another one: {listed(repeats)}",) if repeats else ()
    return kept, remarks


def find_controls(meshes: Sequence, options: argparse.Namespace) -> tuple[list[Control], list, np.ndarray, dict, tuple]:
    """Return the controls, all channels, the column of the control that sets each, the clips, and remarks.

    Raises Refusal if no option and no action names a control.
    """
    any_named = any((options.bones, options.collections, options.shape_keys, options.properties))
    armatures, found = pick_armatures(options, meshes), []
    for armature in armatures:
        found += bone_controls(armature, options, not any_named)
    mesh_of = {}
    for mesh in meshes:
        if mesh.data.shape_keys:
            mesh_of.setdefault(mesh.data.shape_keys, mesh.name)
    for keys in mesh_of:
        found += key_controls(keys, options, not any_named)
    for block in dict.fromkeys((*armatures, *meshes)):
        found += property_controls(block, options, not any_named)
    controls, channels = [list(column) for column in zip(*found)] or ([], [])  # noqa: B905
    clips, keyed = read_clips(controls, channels, options)
    shapes = [(c.item, mesh_of[c.block]) if c.kind == "key" else None for c in channels]
    controls, columns, clips, remarks = join(controls, shapes, clips)
    cut = [c.name for i, c in enumerate(controls) if (columns == i).sum() > 1 and len(c.name.encode()) in CUT]
    if cut:
        reason = f"Blender cuts names after {CUT[-1]} bytes, so several may have become one here"
        remarks += (f"{reason}; shorten them in the file to keep them apart: {listed(cut)}",)
    keyed = set(columns[sorted(keyed)].tolist())
    if not any_named and not keyed:
        raise Refusal("no action moves anything, so say what the controls are: --bones, --collections, --shape-keys …")
    if keyed and (options.keyed or not any_named):
        kept = sorted(keyed)
        controls = [controls[i] for i in kept]
        channels = [channel for channel, column in zip(channels, columns) if column in keyed]  # noqa: B905
        columns = np.searchsorted(kept, [column for column in columns if column in keyed])
        clips = {name: (frame_numbers, values[:, kept]) for name, (frame_numbers, values) in clips.items()}
    clips, repeats = without_repeats(clips, np.array([control.default for control in controls]))
    controls, new_names = renamed([in_use(control, i, clips) for i, control in enumerate(controls)])
    return controls, channels, columns, clips, (*remarks, *repeats, *new_names)


def in_use(control: Control, i: int, clips: dict) -> Control:
    """Return a control, one without limits with the range of its values in the clips if these move it."""
    values = [control.default, *(v for _, clip in clips.values() for v in (clip[:, i].min(), clip[:, i].max()))]
    if control.limited or min(values) == max(values):
        return control
    return control._replace(lower=float(min(values)), upper=float(max(values)))


class Scene:
    """The meshes of a scene, posed by values of channels."""

    def __init__(self, meshes: Sequence, channels: Sequence[Channel], columns: np.ndarray):
        """Take the scene over: the controls' data blocks no longer play their animation.

        columns: of the control that sets each channel.
        """
        import bpy

        self.meshes, self.channels, self.columns = meshes, channels, columns
        self.turning = {}  # a bone's path → (bone, axis → column of the control that turns it about this axis)
        for column, channel in zip(columns.tolist(), channels):  # noqa: B905
            if channel.kind == "rotation":
                self.turning.setdefault(channel.owner.path_from_id(), (channel.owner, {}))[1][channel.item] = column
            data = channel.block.animation_data
            if data and data.action:
                data.action = None
            for track in data.nla_tracks if data else ():
                track.mute = True
        self.graph = bpy.context.evaluated_depsgraph_get()

    def __call__(self, params: np.ndarray) -> np.ndarray:
        """Return the vertices (n, 3) of a pose, in the axes of the scene."""
        import bpy

        for channel, value in zip(self.channels, params[self.columns].tolist()):  # noqa: B905
            if channel.kind in ("location", "scale"):
                getattr(channel.owner, channel.kind)[channel.item] = value
            elif channel.kind == "key":
                channel.owner.value = value
            elif channel.kind == "property":
                whole = isinstance(channel.owner[channel.item], int)
                channel.owner[channel.item] = type(channel.owner[channel.item])(round(value) if whole else value)
        for block in {channel.block for channel in self.channels}:
            block.update_tag()
        for bone, axes in self.turning.values():
            turn_bone(bone, np.radians([params[axes[i]] if i in axes else 0.0 for i in range(3)]))
        bpy.context.view_layer.update()
        return np.concatenate([self.vertices(obj) for obj in self.meshes])

    def vertices(self, obj: object) -> np.ndarray:
        """Return a posed mesh's vertices. Raises Refusal if modifiers have changed their number."""
        evaluated = obj.evaluated_get(self.graph)
        count = len(evaluated.data.vertices)
        if count != len(obj.data.vertices):
            raise Refusal(
                f"{obj.name} has {len(obj.data.vertices)} vertices, and {count} behind its modifiers "
                f"({', '.join(m.name for m in obj.modifiers if m.show_viewport)}): switch off what makes new ones"
            )
        flat = np.empty(3 * count, np.float32)
        evaluated.data.vertices.foreach_get("co", flat)
        world = np.array(evaluated.matrix_world, dtype=np.float64)
        return flat.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]


def turn_bone(bone: object, angles: np.ndarray) -> None:
    """Turn a bone by Euler angles if that is its mode, else by a rotation vector; radians."""
    from mathutils import Quaternion, Vector

    if turns_by_euler(bone):
        bone.rotation_euler = angles
        return
    turn = Quaternion(Vector(angles)) if np.any(angles) else Quaternion()
    if bone.rotation_mode == "QUATERNION":
        bone.rotation_quaternion = turn
    else:
        axis, angle = turn.to_axis_angle()
        bone.rotation_axis_angle = (angle, *axis)


def read_faces(meshes: Sequence) -> tuple[list[tuple[str, str, list[int], list[int] | None]], np.ndarray]:
    """Return the polygons of all meshes with groups and materials, and their UVs. Raises Refusal for loose vertices."""
    faces, uvs, first, corner = [], [], 0, 0
    has_uvs = all(obj.data.uv_layers.active for obj in meshes)
    for obj in meshes:
        mesh = obj.data
        used = np.zeros(len(mesh.vertices), dtype=bool)
        names = ["_".join(slot.name.split()) or "none" for slot in obj.material_slots] or ["none"]
        for polygon in mesh.polygons:
            corners = list(polygon.vertices)
            used[corners] = True
            loops = [corner + i for i in polygon.loop_indices] if has_uvs else None
            material = names[min(polygon.material_index, len(names) - 1)]
            faces.append(("_".join(obj.name.split()), material, [first + v for v in corners], loops))
        if not used.all():
            raise Refusal(f"{obj.name} has {int((~used).sum())} vertices without a face: delete them (loose geometry)")
        if has_uvs:
            flat = np.empty(2 * len(mesh.loops), np.float32)
            mesh.uv_layers.active.data.foreach_get("uv", flat)
            uvs.append(flat.reshape(-1, 2))
        first, corner = first + len(mesh.vertices), corner + len(mesh.loops)
    return faces, np.concatenate(uvs) if uvs else np.zeros((0, 2), np.float32)


def read_rig(options: argparse.Namespace) -> SampledRig:
    """Return the rig of the open file that the options name. Raises Refusal."""
    import bpy

    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    meshes = pick_meshes(options)
    faces, uvs = read_faces(meshes)
    controls, channels, columns, clips, remarks = find_controls(meshes, options)
    scale = bpy.context.scene.unit_settings.scale_length
    unit = options.unit or next((unit for unit, mm in UNITS_MM.items() if abs(mm / 1000 / scale - 1) < 1e-4), None)
    if unit is None:
        raise Refusal(f"a unit of this scene is {scale:g} m: give the unit to use by --unit")
    evaluate = Scene(meshes, channels, columns)
    neutral = evaluate(np.array([control.default for control in controls]))
    render = bpy.context.scene.render
    per_second = render.fps / render.fps_base
    return SampledRig(neutral, faces, uvs, controls, clips, evaluate, unit, "z", per_second, remarks)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options of a command line."""
    parser = argparse.ArgumentParser("blender_samples.py", description=__doc__.split("\n\n")[0])
    parser.add_argument("file", nargs="?", help="a .blend file (default: what Blender has opened)")
    parser.add_argument("--mesh", action="append", required=True, help="a mesh object; again for more of them")
    parser.add_argument("--armature", action="append", default=[], help="whose bones (default: what moves the meshes)")
    for kind in ("bones", "collections", "shape-keys", "properties"):
        text = f"{kind.replace('-', ' ')} that are controls, by name; * stands for anything; again for more"
        parser.add_argument(f"--{kind}", action="append", default=[], metavar="PATTERN", help=text)
    parser.add_argument("--channels", default="location,rotation,scale", help="of bones (default: all three)")
    parser.add_argument("--keyed", action="store_true", help="of these, only what some action moves")
    parser.add_argument(
        "--actions", action="append", metavar="PATTERN", help="the actions that are clips (default: all)"
    )
    parser.add_argument("--reach", type=float, default=1.0, help="how far bones without limits go, without animation")
    add_options(parser)
    options = parser.parse_args(arguments)
    options.actions = options.actions or ["*"]
    if not set(options.channels.split(",")) <= {"location", "rotation", "scale"}:
        parser.error(f"--channels: expected location, rotation and scale, with commas between, got {options.channels}")
    return options


def main() -> int:
    """Export what the command line names, and return the exit code."""
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    options = parse(arguments)
    try:
        try:
            import bpy
        except ImportError:
            raise Refusal("this Python has no bpy: run the script in Blender, or after pip install bpy") from None
        if options.file:
            if not Path(options.file).is_file():
                raise Refusal(f"there is no file {options.file}")
            bpy.ops.wm.open_mainfile(filepath=str(Path(options.file).resolve()))
        rig = read_rig(options)
        check(rig, options)
        export(without_idle(rig), options)
    except (Refusal, OSError, RuntimeError) as error:
        say(f"error: {str(error).strip()}")
        return 2
    return 0


if __name__ == "__main__":
    try:
        code = main()
    except SystemExit as end:  # of argparse
        code = end.code if isinstance(end.code, int) else 2
    except KeyboardInterrupt:
        say("stopped: run the same command again to go on from here")
        code = 130
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code or 0)  # without the clean-up of bpy, which complains of blocks that are still there
