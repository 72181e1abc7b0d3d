"""What a look at a face shows before anything is trained: what its controls move, whether its poses fit its mesh.

Each number is a `Finding`. What makes results meaningless has that verdict, what makes them worse has the other; a
finding of the whole face then says in a sentence which controls or segments it is about, and what helps.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from data_recipes.rig import Rig, frames_per_second, has_function
from replicate.approximation.influence import FLOOR_MM, THRESHOLD_MM
from replicate.approximation.samples import SampleSet, evaluate
from replicate.engine.store import read_manifest
from replicate.methods import artefacts

OK, WORSE, MEANINGLESS = "ok", "worse", "meaningless"
FACE, CONTROL, SEGMENT = "face", "control", "segment"
POSES = 1000  # training poses that are looked at, at most
NEAR_REST = 16  # of them, those nearest to rest, that say whether a segment is in its place
SEAM_POSES = 64
UNMOVED = 1e-6  # of a control's range
NEVER = 0.1  # share of the controls that never move in training, above which results say nothing
NARROW = 0.1  # of a control's limits: training in less of them is worth a word
EFFECT_MM = 1e-3
ALIKE = 0.999  # correlation of two controls' shapes, above which they have one effect
OFF_MM, OFF = 2.0, 0.25  # how far, in mm and in its size, a segment's poses may lie from its place in the mesh
SEAM_MM, TOGETHER_MM = 1e-3, 0.02  # vertices so near at rest and so near in all poses are one
FACE_MM = (150.0, 400.0)
TEXELS = 1.0  # a vertex
FEW_POSES = 3  # training poses a control
BEYOND, FAR, OUTSIDE = 0.1, 2.0, 0.05  # share of test poses; in distances of training poses; in ranges
SHOWN = 6  # names in a sentence
RIDGE = 1e-6  # in mean squares of a column, which are 1
CHUNK = 64
EXPECTED = ("bad_texels_a_vertex",)  # of any large face, those of the paper too: before training no word is said of it


@dataclass(frozen=True)
class Finding:
    """A number about a face, a control or a segment, by its name, and what it means.

    name: "" for the whole face, but for its size, which has how the unit is known.
    value: None where it can't be known. verdict: one of OK, WORSE and MEANINGLESS. sentence: "" unless it has a remedy.
    """

    kind: str
    name: str
    metric: str
    unit: str
    value: float | None
    verdict: str = OK
    sentence: str = ""


@dataclass(frozen=True)
class Face:
    """A face with its samples, before training.

    influence: (n, m), which control moves which vertex.
    rigid: indices of the segments that others carry.
    misplaced_mm: how far the closest vertices misplace those that move rigidly and follow nothing, by their names.
    unit: how its unit is known, in words.
    influence_mm: from how far on a control counts as moving a vertex; None where the author says which do.
    map_size: of the coarse maps, texels along a side.
    """

    rig: Rig
    samples: SampleSet
    influence: np.ndarray
    rigid: tuple[int, ...] = ()
    misplaced_mm: Mapping[str, float] | None = None
    unit: str = "mm"
    influence_mm: float | None = THRESHOLD_MM
    map_size: int = 32

    @cached_property
    def some(self) -> Int[np.ndarray, " k"]:
        """Indices of the training poses that are looked at."""
        return np.unique(np.linspace(0, len(self.samples) - 1, POSES).astype(int))

    @cached_property
    def ranges(self) -> Float[np.ndarray, " m"]:
        """The width of each control's limits."""
        return np.asarray(self.rig.upper, float) - self.rig.lower

    @cached_property
    def line(self) -> Float[np.ndarray, "k l"]:
        """A ridge regression of some training poses: mm per unit of each control, and what the default pose is off."""
        samples, some = self.samples, self.some
        away = np.asarray(samples.params[some], float) - self.rig.default
        size = np.sqrt((away**2).mean(axis=0))
        scale = np.where(size > 0, size, np.inf)  # a control that never moves has no slope
        design = np.concatenate([away / scale, np.ones((len(some), 1))], axis=1)
        products = np.zeros((design.shape[1], 3 * samples.quantised.shape[1]))
        for first in range(0, len(some), CHUNK):
            rows = some[first : first + CHUNK]
            products += design[first : first + CHUNK].T @ samples.offsets(rows).reshape(len(rows), -1)
        gram = design.T @ design + RIDGE * len(some) * np.diag([*np.ones(len(size)), 0.0])
        return np.linalg.solve(gram, products) / np.append(scale, 1.0)[:, None]

    @cached_property
    def moved(self) -> Bool[np.ndarray, " m"]:
        """Which controls leave their default in some training pose."""
        return _leaves(self, self.samples.params)


def load_face(inputs: Mapping[str, Path], unit: str, map_size: int) -> Face:
    """Return the face of the artefacts "rig", "samples", "influence" and "rigid". unit, map_size: as for `Face`."""
    rig, attachments = artefacts.load_rig(inputs), artefacts.load_attachments(inputs)
    known, tried = (read_manifest(inputs[name]).get("notes", {}) for name in ("rigid", "influence"))
    influence_mm = THRESHOLD_MM if has_function(rig) else None if tried.get("stated") else FLOOR_MM
    return Face(
        rig, artefacts.load_samples(inputs), artefacts.load_influence(inputs), tuple(attachments.segment.tolist()),
        known.get("misplaced_mm", {}), unit, influence_mm, map_size,
    )  # fmt: skip


def look(face: Face, tries: bool = True) -> list[Finding]:
    """Return all findings about a face: of the whole, of each control in its order, of each segment in its order.

    tries: False for a glance that evaluates no rig, so that what its controls move isn't known, but for samples.
    """
    if tries or not has_function(face.rig):
        shapes, rest = effects(face)
        straight = list(line_findings(face))
    else:
        straight = []
        shapes, rest = np.zeros((len(face.rig.controls), 1, 3), np.float32), np.zeros_like(face.rig.mesh.neutral)
    controls, segments = list(control_findings(face, shapes)), list(segment_findings(face, rest))
    whole = [*facts(face), *straight, *pose_findings(face), *alike_findings(face, shapes), *seam_findings(face)]
    return [*whole, *summaries(face, controls, segments), *controls, *segments]


def warnings(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings of the whole face that have a sentence, those that make results meaningless first."""
    said = [finding for finding in findings if finding.kind == FACE and finding.sentence]
    return sorted(said, key=lambda finding: finding.verdict != MEANINGLESS)


def listed(names: Sequence[str]) -> str:
    """Return names for a sentence, and how many more there are."""
    more = len(names) - SHOWN
    return ", ".join(names[:SHOWN]) + (f" and {more} more" if more > 0 else "")


def _leaves(face: Face, params: np.ndarray) -> np.ndarray:
    away = np.abs(np.asarray(params, float) - face.rig.default)
    return (away > UNMOVED * face.ranges).any(axis=0) if len(params) else np.zeros(len(face.ranges), bool)


# The whole face.


def facts(face: Face) -> Iterator[Finding]:
    """Yield counts and the size of a face, and how many poses there are."""
    rig, samples = face.rig, face.samples
    size = float(np.ptp(rig.mesh.neutral, axis=0).max())
    counts = {
        "vertices": len(rig.mesh.neutral), "faces": len(rig.mesh.faces), "controls": len(rig.controls),
        "segments": len(rig.mesh.segment_names), "training_poses": len(samples),
        "validation_poses": len(samples.validation_params), "test_poses": len(samples.test_params),
    }  # fmt: skip
    for name, count in counts.items():
        yield Finding(FACE, "", name, "count", count)
    yield Finding(FACE, "", "frames_per_second", "1/s", frames_per_second(rig))
    yield Finding(FACE, "", "influence_threshold", "mm", face.influence_mm)
    odd = (
        f"its largest side is {size:.4g} mm, and those of faces are {FACE_MM[0]:g} to {FACE_MM[1]:g}: errors in mm "
        f"and thresholds mean something else then; is the unit right ({face.unit})?"
    )
    is_odd = not FACE_MM[0] <= size <= FACE_MM[1]
    yield Finding(FACE, face.unit, "size", "mm", size, WORSE if is_odd else OK, odd if is_odd else "")
    test = np.unique(np.linspace(0, len(samples.test_offsets) - 1, POSES).astype(int))
    finite = all(np.isfinite(part).all() for part in (samples.test_offsets[test], samples.validation_offsets))
    finite = finite and bool(np.isfinite(samples.steps_mm).all())
    broken = "some poses have vertices that are not finite: write them anew"
    yield Finding(FACE, "", "finite", "", float(finite), OK if finite else MEANINGLESS, "" if finite else broken)


def pose_findings(face: Face) -> Iterator[Finding]:
    """Yield how many training poses there are a control, and how many test poses lie beyond them."""
    samples, m = face.samples, len(face.rig.controls)
    share = len(samples) / m
    few = f"{len(samples)} training poses for {m} controls are few, {FEW_POSES} a control the least: sample more"
    is_few = share < FEW_POSES
    yield Finding(FACE, "", "poses_a_control", "ratio", share, WORSE if is_few else OK, few if is_few else "")
    beyond = beyond_training(np.asarray(samples.params), np.asarray(samples.test_params), face.ranges)
    far = (
        f"{beyond.mean():.0%} of the {len(beyond)} test poses lie outside what training has seen, so their errors are "
        "those of extrapolation: sample more poses of their kind"
    )
    is_far = bool(beyond.mean() > BEYOND)
    verdict, sentence = (WORSE, far) if is_far else (OK, "")
    yield Finding(FACE, "", "test_poses_beyond", "ratio", float(beyond.mean()), verdict, sentence)


def beyond_training(
    training: Float[np.ndarray, "a m"], test: Float[np.ndarray, "t m"], limits: Float[np.ndarray, " m"]
) -> Bool[np.ndarray, " t"]:
    """Return which test poses lie outside the ranges of training, or far from each of its poses.

    limits: the width of each control's limits, for those that don't move in training. Distances are in ranges of the
    training poses; far is more than `FAR` times what all but one in a hundred of these have to the nearest other.
    """
    low, high = training.min(axis=0), training.max(axis=0)
    width = np.where(high - low > UNMOVED * limits, high - low, limits)
    outside = ((test < low - OUTSIDE * width) | (test > high + OUTSIDE * width)).any(axis=1)
    some = training[np.unique(np.linspace(0, len(training) - 1, POSES).astype(int))] / width
    own = cdist(some, some)
    np.fill_diagonal(own, np.inf)
    apart = own.min(axis=1) if len(some) > 1 else np.zeros(1)
    return outside | (cdist(test / width, some).min(axis=1) > FAR * np.quantile(apart, 0.99))


def seam_findings(face: Face) -> Iterator[Finding]:
    """Yield how many pairs of vertices lie in one place and move alike, and how many networks would tear."""
    mesh, samples = face.rig.mesh, face.samples
    pairs = cKDTree(mesh.neutral).query_pairs(SEAM_MM, output_type="ndarray")
    poses = face.some[np.unique(np.linspace(0, len(face.some) - 1, SEAM_POSES).astype(int))]
    if len(pairs):
        one, other = (samples.vertices_subset(poses, pairs[:, side]) for side in (0, 1))
        pairs = pairs[np.abs(one - other).max(axis=(0, 2)) < TOGETHER_MM]
    first, second = mesh.segment[pairs[:, 0]], mesh.segment[pairs[:, 1]]
    carried = np.isin(first, face.rigid) & (first == second)
    apart = (np.abs(mesh.uv[pairs[:, 0]] - mesh.uv[pairs[:, 1]]) > 0).any(axis=1) | (first != second)
    torn = int((apart & ~carried).sum())
    of_two = int((first != second).sum())
    sentence = (
        f"{torn} pairs of vertices lie in one place and move alike, as at a texture's seam, {of_two} of them in two "
        "segments; networks tear them apart by about their errors: merge them before you write mesh and poses"
    )
    yield Finding(FACE, "", "seam_pairs", "count", len(pairs))
    yield Finding(FACE, "", "seam_pairs_of_two_segments", "count", of_two)
    yield Finding(FACE, "", "torn_pairs", "count", torn, WORSE if torn else OK, sentence if torn else "")


# Controls: what each moves, by how much, and how far training moves it.


def effects(face: Face) -> tuple[Float[np.ndarray, "m n 3"], Float[np.ndarray, "n 3"]]:
    """Return each control's shape, and how far the poses near rest are from the mesh, in mm.

    A shape is what the control moves from the default pose to the end of its limits that moves more. Of a rig that is
    known by its samples it is the slope of a ridge regression, times the farthest that training goes.
    """
    rig, neutral = face.rig, face.rig.mesh.neutral
    m = len(rig.controls)
    if has_function(rig):
        trials = np.repeat(np.asarray(rig.default, np.float32)[None], 2 * m, axis=0)
        trials[np.arange(2 * m), np.tile(np.arange(m), 2)] = np.concatenate([rig.lower, rig.upper])
        shapes, reach = np.zeros((m, *neutral.shape), np.float32), np.zeros(m)
        for rows, vertices in evaluate(rig, trials):
            for row, offset in zip(range(rows.start, rows.stop), vertices - neutral, strict=True):
                if (far := float(np.abs(offset).max())) > reach[row % m]:
                    shapes[row % m], reach[row % m] = offset, far
        return shapes, np.zeros_like(neutral)
    return _regressed(face)


def _regressed(face: Face) -> tuple[np.ndarray, np.ndarray]:
    """Return shapes by ridge regression, and the median, over the poses nearest to rest, of what it leaves there."""
    samples, some = face.samples, face.some
    away, slopes = np.asarray(samples.params[some], float) - face.rig.default, face.line[:-1]
    near = np.argsort(np.abs(away / face.ranges).sum(axis=1), kind="stable")[:NEAR_REST]
    left = samples.offsets(some[near]).reshape(len(near), -1) - away[near] @ slopes
    shapes = (slopes * np.abs(away).max(axis=0)[:, None]).reshape(len(slopes), -1, 3)
    return shapes.astype(np.float32), np.median(left, axis=0).reshape(-1, 3)


def line_findings(face: Face) -> Iterator[Finding]:
    """Yield how far held-out poses are, at most, from a straight line that was fitted to training poses, in mm."""
    samples = face.samples
    away = np.asarray(samples.validation_params, float) - face.rig.default
    line = (away @ face.line[:-1] + face.line[-1]).reshape(len(away), -1, 3)
    off = np.linalg.norm(samples.validation_offsets - line, axis=2).max(initial=0.0)
    yield Finding(FACE, "", "straight_line_off", "mm", float(off))


def control_findings(face: Face, shapes: Float[np.ndarray, "m n 3"]) -> Iterator[Finding]:
    """Yield how far each control goes in training, how often, what it moves and by how much."""
    rig, samples = face.rig, face.samples
    low, high = samples.params.min(axis=0), samples.params.max(axis=0)
    away = np.abs(np.asarray(samples.params, float) - rig.default) > UNMOVED * face.ranges
    used, reach = away.mean(axis=0), np.linalg.norm(shapes, axis=2).max(axis=1)
    never = ~face.moved
    verdict = MEANINGLESS if _untrained(face).mean() > NEVER else WORSE
    idle = ~face.influence.any(axis=0) & (reach <= EFFECT_MM)
    known = has_function(rig) | face.moved
    for k, control in enumerate(rig.controls):
        row = Finding(CONTROL, control.name, "", "", None)
        span = float((high[k] - low[k]) / face.ranges[k])
        narrow = bool(face.moved[k] and span < NARROW)
        yield replace(row, metric="training_low", value=float(low[k]))
        yield replace(row, metric="training_high", value=float(high[k]))
        yield replace(row, metric="training_of_limits", unit="ratio", value=span, verdict=WORSE if narrow else OK)
        bad = verdict if never[k] else OK
        yield replace(row, metric="used_in_training", unit="ratio", value=float(used[k]), verdict=bad)
        bad = WORSE if idle[k] and known[k] else OK
        yield replace(row, metric="reach", unit="mm", value=float(reach[k]) if known[k] else None, verdict=bad)
        yield replace(row, metric="vertices", unit="count", value=int(face.influence[:, k].sum()))


def _untrained(face: Face) -> Bool[np.ndarray, " m"]:
    """Return which controls never move in training, but do in held-out poses."""
    held_out = [face.samples.validation_params, face.samples.test_params]
    return ~face.moved & np.any([_leaves(face, params) for params in held_out], axis=0)


def alike_findings(face: Face, shapes: Float[np.ndarray, "m n 3"]) -> Iterator[Finding]:
    """Yield how many controls move the face as an earlier one does."""
    flat = shapes.reshape(len(shapes), -1)
    length = np.linalg.norm(flat, axis=1)
    moves = np.abs(flat).max(axis=1) > EFFECT_MM
    unit = flat / np.where(moves, length, 1.0)[:, None]
    same = np.triu((unit @ unit.T > ALIKE) & moves & moves[:, None], 1)
    names = [control.name for control in face.rig.controls]
    pairs = [f"{names[i]} and {names[j]}" for i, j in np.argwhere(same)]
    sentence = (
        f"{len(pairs)} pair{'s' * (len(pairs) > 1)} of controls move the face alike, or always together in training "
        f"({listed(pairs)}): nothing can tell them apart; leave one of each out"
    )
    yield Finding(FACE, "", "pairs_alike", "count", len(pairs), WORSE if pairs else OK, sentence if pairs else "")


# Segments: whether their poses fit the mesh, how they move, what networks see of them.


def segment_findings(face: Face, rest: Float[np.ndarray, "n 3"]) -> Iterator[Finding]:
    """Yield for each segment its size, its controls, its texels, and how far its poses lie from its place."""
    mesh, misplaced, crowd = face.rig.mesh, face.misplaced_mm or {}, vertices_a_texel(face)
    for k, name in enumerate(mesh.segment_names):
        members = np.flatnonzero(mesh.segment == k)
        row, neutral = Finding(SEGMENT, name, "", "", None), mesh.neutral[members]
        size = float(np.linalg.norm(np.ptp(neutral, axis=0)))
        yield replace(row, metric="vertices", unit="count", value=len(members))
        off = float(np.median(np.linalg.norm(rest[members], axis=1)))
        is_off = off > max(OFF_MM, OFF * size)
        where = nearest_segment(face, k, rest) if is_off else name
        words = f"its poses lie where {where} is in the mesh" if where != name else ""
        bad = MEANINGLESS if is_off else OK
        yield replace(row, metric="off_its_place", unit="mm", value=off, verdict=bad, sentence=words)
        yield replace(row, metric="rigid", value=float(k in face.rigid or name in misplaced))
        for metric, is_it in (("misplaced", k not in face.rigid), ("attached_yet_misplaced", k in face.rigid)):
            left = misplaced.get(name) if is_it else None
            yield replace(row, metric=metric, unit="mm", value=left, verdict=OK if left is None else WORSE)
        seen = int(face.influence[members].any(axis=0).sum())
        bad = OK if seen or k in face.rigid else WORSE
        yield replace(row, metric="controls", unit="count", value=seen, verdict=bad)
        if k not in face.rigid:
            texels = face.map_size**2 / len(members)
            bad = WORSE if texels < TEXELS else OK
            yield replace(row, metric="texels_a_vertex", unit="ratio", value=texels, verdict=bad)
            yield replace(row, metric="vertices_a_texel_max", unit="count", value=int(crowd[members].max()))


def nearest_segment(face: Face, segment: int, rest: Float[np.ndarray, "n 3"]) -> str:
    """Return the name of the segment whose place in the mesh is nearest to where one's poses near rest lie."""
    mesh = face.rig.mesh
    centres = [mesh.neutral[mesh.segment == k].mean(axis=0) for k in range(len(mesh.segment_names))]
    members = mesh.segment == segment
    away = np.linalg.norm(np.array(centres) - (mesh.neutral[members] + rest[members]).mean(axis=0), axis=1)
    return mesh.segment_names[int(away.argmin())]


def vertices_a_texel(face: Face) -> Int[np.ndarray, " n"]:
    """Return how many vertices of its segment lie in each vertex's texel; 0 in segments that have no map."""
    mesh, size = face.rig.mesh, face.map_size
    texel = np.minimum((mesh.uv * size).astype(int), size - 1)
    place = (mesh.segment * size + texel[:, 1]) * size + texel[:, 0]
    _, inverse, counts = np.unique(place, return_inverse=True, return_counts=True)
    return np.where(np.isin(mesh.segment, face.rigid), 0, counts[inverse.ravel()])


# What all controls or segments with the same verdict are told in one sentence.


def summaries(face: Face, controls: Sequence[Finding], segments: Sequence[Finding]) -> Iterator[Finding]:
    """Yield a finding of the whole face, with a sentence, for each metric in which some control or segment is bad."""
    bad: dict[str, list[Finding]] = {}
    for finding in (*controls, *segments):
        if finding.verdict != OK:
            bad.setdefault(finding.metric, []).append(finding)
    for metric, those in bad.items():
        names = listed([f"{each.name}: {each.sentence}" if each.sentence else each.name for each in those])
        verdict = those[0].verdict
        yield Finding(FACE, "", f"bad_{metric}", "count", len(those), verdict, _sentence(face, metric, those, names))


def _sentence(face: Face, metric: str, those: Sequence[Finding], names: str) -> str:
    count = len(those)
    one = count == 1
    if metric == "used_in_training":
        later = int(_untrained(face).sum())
        elsewhere = f"{'all' if later == count else later} of these do in held-out poses" if later else "nor elsewhere"
        remedy = "add poses that move them, several for each" + ("" if later else ", or leave them out")
        return (
            f"{count} of {len(face.rig.controls)} controls never move in training ({names}), "
            f"{'but ' if later else ''}{elsewhere}, so no method can learn what they do: {remedy}"
        )
    return {
        "training_of_limits": f"training moves {count} control{'s' * (not one)} through less than {NARROW:.0%} of "
        f"{'its' if one else 'their'} limits ({names}): add poses, or narrow the limits",
        "reach": f"{count} control{'s' * (not one)} move{'s' * one} nothing ({names}): leave "
        f"{'it' if one else 'them'} out, or look for the mesh that {'it' if one else 'they'} should move",
        "off_its_place": f"the poses of {count} segment{'s' * (not one)} lie up to "
        f"{max(each.value or 0 for each in those):.3g} mm from the mesh ({names}): write the parts of mesh and "
        "poses in one order",
        "controls": f"no control was found to move {count} segment{'s' * (not one)} ({names}), so that networks there "
        "see all of them: sample more poses, say in the folder which control moves which vertex, or leave out what "
        "stands still",
        "misplaced": f"{count} segment{'s' * (not one)} move{'s' * one} rigidly, but no vertices quite with "
        f"{'it' if one else 'them'} ({names}): the closest would misplace {'it' if one else 'them'} by up to "
        f"{max(each.value or 0 for each in those):.2g} mm, so networks deform {'it' if one else 'them'}, less exactly; "
        "include what carries such parts, if there is anything",
        "attached_yet_misplaced": f"{count} segment{'s' * (not one)} that the rig names as rigid "
        f"{'is' if one else 'are'} attached to vertices that misplace {'it' if one else 'them'} by up to "
        f"{max(each.value or 0 for each in those):.2g} mm ({names}): include what carries them, or don't name them",
        "texels_a_vertex": f"{count} segment{'s' * (not one)} ha{'s' if one else 've'} less than a texel a vertex in "
        f"maps of {face.map_size} × {face.map_size} ({names}), which refined networks make up for in part: cut "
        "the face into more segments, or set [coarse] map_size in a CONFIG file",
    }[metric]


def unit_in_words(recipe: object) -> str:
    """Return how the unit of a character is known, from what its rig is built of, as `Face` has it."""
    face = getattr(recipe, "face", None)
    unit = getattr(face, "unit", None)
    if unit is None:
        return "mm, as in all recipes"
    if getattr(face, "states_unit", False):
        return f"the USD's own, and {unit} in files that state none"
    return "guessed from the size of what moves" if unit == "guess" else f"{unit}, as its face.toml says"
