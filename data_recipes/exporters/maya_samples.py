"""Write a rig of a Maya scene as a folder of samples: a mesh, its controls, and poses with their vertices (§3.5).

This one file needs Maya's Python (2023 or newer) with numpy (`mayapy -m pip install numpy`). UNTRIED: it was written
from Maya's reference without a Maya to run it in. The part that it shares with `blender_samples.py` is tested.

    mayapy maya_samples.py face.mb --mesh head --controls "*_ctrl" --out myface

or in the script editor, on the open scene, which loses its animation by it (save it first):

    import maya_samples; maya_samples.main(["--mesh", "head", "--controls", "*_ctrl", "--out", "myface"])

Controls are the keyable attributes, neither locked nor driven, of the nodes that --controls names, blendShape nodes
included. Weights with the same name in several blendShape nodes are one control; one that moves no vertex is left out.
The animation is the timeline, or the parts of it that --clip names: all frames are written, then poses drawn from them
by Eq. 5. If no control has keys, poses are drawn in which few controls move at a time, within limits, which all
controls must have then. A second call goes on where the first one stopped.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import sys
import time
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


TRANSFORMS = {  # attribute of a transform → the flags of `transformLimits` that query its limits and their switches
    f"{attribute}{axis}": (f"{flag}{axis}", f"enable{flag[0].upper()}{flag[1:]}{axis}")
    for attribute, flag in (("translate", "translation"), ("rotate", "rotation"), ("scale", "scale"))
    for axis in "XYZ"
}
FRAMES_PER_SECOND = {"game": 15.0, "film": 24.0, "pal": 25.0, "ntsc": 30.0, "show": 48.0, "palf": 50.0, "ntscf": 60.0}


def find_meshes(names: Sequence[str]) -> list:
    """Return Maya's mesh functions for the named shapes. Raises Refusal for a name that isn't that of one mesh."""
    from maya import cmds
    from maya.api import OpenMaya

    meshes = []
    for name in names:
        shapes = cmds.ls(name, type="mesh") or cmds.listRelatives(name, shapes=True, type="mesh", path=True) or []
        shapes = [shape for shape in shapes if not cmds.getAttr(f"{shape}.intermediateObject")]
        if len(shapes) != 1:
            raise Refusal(f"--mesh {name}: expected one mesh, got {len(shapes)}: give a longer path")
        found = OpenMaya.MSelectionList()
        found.add(shapes[0])
        meshes.append(OpenMaya.MFnMesh(found.getDagPath(0)))
    return meshes


def limits_of(node: str, attribute: str) -> tuple[float, float] | None:
    """Return both limits of an attribute, or None if it lacks one."""
    from maya import cmds

    if attribute in TRANSFORMS and cmds.objectType(node, isAType="transform"):
        limit, enabled = TRANSFORMS[attribute]
        if not all(cmds.transformLimits(node, query=True, **{enabled: True})):
            return None
        lower, upper = cmds.transformLimits(node, query=True, **{limit: True})
        return (lower, upper) if lower < upper else None
    if cmds.objectType(node) == "blendShape":
        return 0.0, 1.0
    asked = {"node": node, "minExists": True}, {"node": node, "maxExists": True}
    if not all(cmds.attributeQuery(attribute, **flags) for flags in asked):
        return None
    lower = cmds.attributeQuery(attribute, node=node, minimum=True)[0]
    upper = cmds.attributeQuery(attribute, node=node, maximum=True)[0]
    return (lower, upper) if lower < upper else None


def is_driven(plug: str) -> bool:
    """Tell whether something other than keys of the timeline sets an attribute, such as driven keys."""
    from maya import cmds

    return any(not cmds.objectType(node).startswith("animCurveT") for node in cmds.listConnections(plug, d=False) or [])


def find_controls(patterns: Sequence[str]) -> tuple[list[Control], list[str], list[tuple[str, str] | None]]:
    """Return the controls of the nodes that match, their plugs, and the name and node of those that weigh a shape.

    Raises Refusal for a pattern without a match.
    """
    from maya import cmds

    controls, plugs, weighed = [], [], []
    for pattern in patterns:
        nodes = cmds.ls(pattern)
        if not nodes:
            raise Refusal(f"--controls: no node matches '{pattern}'")
        for node in nodes:
            shapes = cmds.objectType(node) == "blendShape"
            names = cmds.listAttr(f"{node}.w", multi=True) if shapes else None
            names = names or cmds.listAttr(node, keyable=True, unlocked=True, scalar=True) or []
            for attribute in names:
                plug = f"{node}.{attribute}"
                if attribute == "visibility" or cmds.getAttr(plug, lock=True) or is_driven(plug):
                    continue
                default = 0.0 if shapes else float(cmds.attributeQuery(attribute, node=node, listDefault=True)[0])
                limits = limits_of(node, attribute)
                lower, upper = limits or (default, default)
                whole = cmds.getAttr(plug, type=True) in ("long", "short", "byte", "bool", "enum")
                control = Control(plug, min(lower, default), default, max(upper, default), limits is not None, whole)
                if plug not in plugs:
                    controls.append(control)
                    plugs.append(plug)
                    weighed.append((attribute, node) if shapes and "[" not in attribute else None)
    return controls, plugs, weighed


def read_clips(plugs: Sequence[str], ranges: Sequence[str]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the animation of attributes as clips, none if they have no keys.

    ranges: as "name=first:last"; without any, the whole timeline is a clip.
    """
    from maya import cmds

    if not any(cmds.keyframe(plug, query=True, keyframeCount=True) for plug in plugs):
        return {}
    if not ranges:
        first, last = (cmds.playbackOptions(query=True, **{end: True}) for end in ("minTime", "maxTime"))
        ranges = [f"timeline={round(first)}:{round(last)}"]
    clips = {}
    for text in ranges:
        match = re.fullmatch(r"([^=]+)=(-?\d+):(-?\d+)", text)
        if not match or int(match[3]) < int(match[2]):
            raise Refusal(f"--clip: expected name=first:last, got {text}")
        frame_numbers = np.arange(int(match[2]), int(match[3]) + 1)
        values = [[float(cmds.getAttr(plug, time=frame)) for plug in plugs] for frame in frame_numbers.tolist()]
        clips[match[1]] = frame_numbers, np.array(values)
    return clips


def in_use(control: Control, i: int, clips: dict) -> Control:
    """Return a control, one without limits with the range of its values in the clips."""
    if control.limited:
        return control
    values = [control.default, *(v for _, clip in clips.values() for v in (clip[:, i].min(), clip[:, i].max()))]
    return control._replace(lower=float(min(values)), upper=float(max(values)))


class Scene:
    """The meshes of a scene, posed by values of attributes."""

    def __init__(self, meshes: Sequence, plugs: Sequence[str], columns: np.ndarray):
        """Take the scene over: keys are disconnected from the attributes.

        columns: of the control that sets each attribute.
        """
        from maya import cmds

        self.meshes, self.plugs, self.columns = meshes, plugs, columns
        cmds.undoInfo(state=False)
        for plug in plugs:
            for source in cmds.listConnections(plug, d=False, plugs=True) or []:
                cmds.disconnectAttr(source, plug)

    def __call__(self, params: np.ndarray) -> np.ndarray:
        """Return the vertices (n, 3) of a pose in the world, in Maya's centimetres."""
        from maya import cmds
        from maya.api import OpenMaya

        for plug, value in zip(self.plugs, params[self.columns].tolist()):  # noqa: B905
            cmds.setAttr(plug, value)
        points = [np.array(mesh.getPoints(OpenMaya.MSpace.kWorld), dtype=np.float64)[:, :3] for mesh in self.meshes]
        return np.concatenate(points)


def read_faces(meshes: Sequence) -> tuple[list[tuple[str, str, list[int], list[int] | None]], np.ndarray]:
    """Return the polygons of all meshes with groups and materials, and their UVs."""
    from maya.api import OpenMaya

    faces, uvs, first, first_uv = [], [], 0, 0
    counted = [mesh.getAssignedUVs() for mesh in meshes]
    has_uvs = all(len(ids) and all(counts) for counts, ids in counted)
    for mesh, (_, ids) in zip(meshes, counted):  # noqa: B905
        shaders, of_face = mesh.getConnectedShaders(0)
        names = [OpenMaya.MFnDependencyNode(shader).name().replace(" ", "_") for shader in shaders]
        corner = 0
        for i in range(mesh.numPolygons):
            corners = [first + v for v in mesh.getPolygonVertices(i)]
            uv_rows = [first_uv + ids[corner + k] for k in range(len(corners))] if has_uvs else None
            material = names[of_face[i]] if of_face[i] >= 0 else "none"
            faces.append((mesh.name().replace(" ", "_"), material, corners, uv_rows))
            corner += len(corners)
        if has_uvs:
            uvs.append(np.stack([np.array(column) for column in mesh.getUVs()], axis=1))
            first_uv += len(uvs[-1])
        first += mesh.numVertices
    return faces, np.concatenate(uvs) if uvs else np.zeros((0, 2))


def read_rig(options: argparse.Namespace) -> SampledRig:
    """Return the rig of the open scene that the options name. Raises Refusal."""
    from maya import cmds

    meshes = find_meshes(options.mesh)
    faces, uvs = read_faces(meshes)
    found, plugs, shapes = find_controls(options.controls)
    controls, columns, clips, remarks = join(found, shapes, read_clips(plugs, options.clip))
    controls = [in_use(control, i, clips) for i, control in enumerate(controls)]
    kept = [i for i, control in enumerate(controls) if control.lower < control.upper]
    if not clips and len(kept) < len(controls):
        lost = next(control.name for control in controls if control.lower == control.upper)
        raise Refusal(f"there are no keys, and {lost} has no limits: set limits, key it, or leave it out of --controls")
    clips = {name: (frame_numbers, values[:, kept]) for name, (frame_numbers, values) in clips.items()}
    controls, new_names = renamed([controls[i] for i in kept])
    plugs = [plug for plug, column in zip(plugs, columns) if column in kept]  # noqa: B905
    columns = np.searchsorted(kept, [column for column in columns if column in kept])
    evaluate = Scene(meshes, plugs, columns)
    neutral = evaluate(np.array([control.default for control in controls]))
    rate = cmds.currentUnit(query=True, time=True)
    per_second = FRAMES_PER_SECOND.get(rate) or float(rate[:-3] if rate.endswith("fps") else 24)
    up = cmds.upAxis(query=True, axis=True)
    unit, remarks = options.unit or "cm", (*remarks, *new_names)
    return SampledRig(neutral, faces, uvs, controls, clips, evaluate, unit, up, per_second, remarks)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options of a command line."""
    parser = argparse.ArgumentParser("maya_samples.py", description=__doc__.split("\n\n")[0])
    parser.add_argument("file", nargs="?", help="a scene to open (default: the one that is open)")
    parser.add_argument("--mesh", action="append", required=True, help="a mesh, or its transform; again for more")
    parser.add_argument("--controls", action="append", required=True, help="nodes by name, * for anything; again …")
    parser.add_argument("--clip", action="append", default=[], help="a part of the timeline, as nod=1:100; again …")
    add_options(parser)
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Export what the arguments name, and return the exit code."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        try:
            from maya import cmds
        except ImportError:
            raise Refusal("this Python has no maya.cmds: run the script by mayapy or in Maya") from None
        if arguments is None:
            import maya.standalone

            maya.standalone.initialize()
        if options.file:
            if not Path(options.file).is_file():
                raise Refusal(f"there is no file {options.file}")
            cmds.file(str(Path(options.file).resolve()), open=True, force=True)
        rig = read_rig(options)
        check(rig, options)
        export(without_idle(rig), options)
    except (Refusal, OSError, RuntimeError) as error:
        say(f"error: {str(error).strip()}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
