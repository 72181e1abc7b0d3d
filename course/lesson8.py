"""What lesson 8 is set up with and drawn by: errors seed by seed, splits of an animation, a plan, and pictures."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from data_recipes.acting.procedural_acting import act
from data_recipes.early_checks import recipe_controls
from data_recipes.recipe.reading import load_recipe
from replicate.approximation.sampling import augment, split_clips, split_frames
from replicate.drawing.panels import WIDTH, Words, enlarge, tidy
from replicate.methods.method_registry import method_named
from replicate.targets.claims.rules import Evidence, MissingNumber, folders_of, gather
from replicate.targets.claims.verdicts import NETWORKS, SKINS

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas

PAPERS = (*NETWORKS, *SKINS)  # the methods that the paper has in Table 2

BySeed = dict[int, float]


@cache
def evidence() -> Evidence:
    """Return the committed results, as the claims are judged by."""
    return gather(folders_of("reference"))


def normal_errors(methods: Sequence[str] = PAPERS) -> dict[str, dict[str, BySeed]]:
    """Return mean normal errors in degrees: character → method → seed → error.

    Characters that lack one of the methods, or the errors of single seeds, are left out.
    """
    errors: dict[str, dict[str, BySeed]] = {}
    for character in evidence().characters():
        try:
            numbers = {method: evidence().error(character, method, "normal") for method in methods}
        except MissingNumber:
            continue
        if all(number.by_seed or number.sd is None for number in numbers.values()):
            errors[character] = {name: number.by_seed or {0: number.value} for name, number in numbers.items()}
    return errors


def limits_table() -> "pandas.DataFrame":
    """Return normal errors in degrees from the face at rest down to what the maps could hold, a character a line."""
    import pandas

    names = ("neutral", "linear", "refined", "dense", "floor_refined")
    lines = {}
    for character in evidence().characters():
        if "@" not in character:
            try:
                lines[character] = [evidence().error(character, name, "normal").value for name in names]
            except MissingNumber:
                continue
    titles = ["face at rest", "straight line", "refined", "dense", "refined maps' floor"]
    return pandas.DataFrame.from_dict(lines, "index", columns=titles).map("{:.2f}°".format)


# Splits of an animation.

TRAINING_POSES, TEST_POSES, HELD_OUT = 2_500, 100, 0.1
LEAKS = ("none", "neighbours", "scaled copies")


@dataclass(frozen=True)
class Split:
    """Training poses (a, m) and test poses (t, m), float32: each control divided by its largest value."""

    training: np.ndarray
    test: np.ndarray


@cache
def clips() -> tuple[np.ndarray, ...]:
    """Return the animation of the tiny head, a clip an array (t, m), each control divided by its largest value."""
    recipe = load_recipe("tiny")
    poses = [np.asarray(values, np.float32) for _, values in act(recipe_controls(recipe), recipe.acting)]
    largest = np.abs(np.concatenate(poses)).max(0)
    return tuple(clip / np.where(largest > 0, largest, np.float32(1)) for clip in poses)


@cache
def splits() -> dict[str, Split]:
    """Return five splits of the animation by name, some of which leak."""
    rng = np.random.default_rng(8)
    by_clips = split_clips(clips(), rng, HELD_OUT)
    by_frames = split_frames(clips(), rng, HELD_OUT)
    everything = np.concatenate(clips())
    tenth = np.arange(len(everything)) % 10 == 0
    pairs = {
        "A": by_frames,
        "B": (augment(by_clips[0], TRAINING_POSES, rng), by_clips[1]),
        "C": (augment(np.concatenate([by_clips[0], *[by_clips[1]] * 4]), TRAINING_POSES, rng), by_clips[1]),
        "D": by_clips,
        "E": (everything[~tenth], everything[tenth]),
    }
    return {name: _thinned(*pair, rng) for name, pair in pairs.items()}


def _thinned(training: np.ndarray, test: np.ndarray, rng: np.random.Generator) -> Split:
    """Return a split of some of the test poses that aren't at rest, and of different training poses."""
    training, test = (np.unique(poses, axis=0) for poses in (training, test))
    test = test[np.abs(test).max(1) > 0.1]
    return Split(rng.permutation(training), rng.permutation(test)[:TEST_POSES])


# A plan of an ablation.


@dataclass(frozen=True)
class Plan:
    """A comparison of two methods that is fixed before anybody has seen its numbers.

    hypothesis: one sentence: what becomes smaller or larger, and because of what.
    base: the method of Table 2 that yours is compared with, such as "dense".
    changes: what mine.py does otherwise, a string for each thing.
    metric: "normal_error_mean" or "vertex_error_mean".
    least_effect: your error over the base's has to be at most this, or the change is not worth it; above 1, at least
        this, if you expect a larger error.
    characters: names of Table 2. seeds: whole numbers, the same for both methods.
    chosen_on: the poses by which you choose steps, widths and so on: "training", "validation" or "test".
    beside: methods that need no network and stand in the table, too.
    command: the line that runs it all, its characters and seeds those of the plan, such as

        make table2 METHODS="dense linear mine.py neutral" CHARACTERS="teen woman" SEED="0 1 2"
    """

    hypothesis: str
    base: str
    changes: tuple[str, ...]
    metric: str
    least_effect: float
    characters: tuple[str, ...]
    seeds: tuple[int, ...]
    chosen_on: str
    beside: tuple[str, ...]
    command: str


def seal(plan: Plan) -> str:
    """Return twelve characters that any change of a plan would change."""
    return hashlib.sha256(json.dumps(asdict(plan), sort_keys=True).encode()).hexdigest()[:12]


# Pictures.


def seeds_chart(
    methods: Sequence[str] = ("refined", "dense", "lbs32", "linear"),
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): normal errors of some methods on our characters, a dot a seed."""
    from matplotlib.figure import Figure

    shown = {name: errors for name, errors in normal_errors(methods).items() if "@" not in name}
    shown = dict(list(shown.items())[:4])
    figure = Figure((WIDTH, 3.0), dpi=100, layout="constrained")
    phrases = []
    for axes, (character, errors) in zip(figure.subplots(1, len(shown), sharey=True), shown.items(), strict=True):
        for place, (method, by_seed) in enumerate(errors.items()):
            axes.plot([*by_seed.values()], [place] * len(by_seed), "|", color=method_named(method).colour, ms=20, mew=2)
        axes.set(title=character, xlabel="degrees", ylim=(len(methods) - 0.5, -0.5))
        axes.margins(x=0.1)
        axes.set_yticks(range(len(methods)), [method_named(method).label for method in methods])
        tidy(axes)
        enlarge(axes, 13)
        means = (f"{method_named(method).label} {np.mean([*each.values()]):.2f}°" for method, each in errors.items())
        phrases.append(f"{character}: {', '.join(means)}")
    return figure, Words(
        f"Strokes in {len(shown)} panels, one a character. Means: {'; '.join(phrases)}.",
        "Mean normal error on the test poses; a stroke is a fit with its own seed. No axis begins at zero.",
    )


def splits_chart(names: Mapping[str, str]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the jaw in three clips, and which frames two ways of splitting keep for the test.

    names: "frames" and "clips" → titles.
    """
    from matplotlib.figure import Figure

    jaw = [control.name for control in recipe_controls(load_recipe("tiny"))].index("jaw_open")
    three = sorted(clips(), key=lambda clip: -np.ptp(clip[:, jaw]))[:3]
    track = np.concatenate([clip[:, jaw] for clip in three])
    seconds = np.arange(len(track)) / 24
    owner = np.repeat(range(3), [len(clip) for clip in three])
    held = {"frames": np.random.default_rng(1).random(len(track)) < 1 / 3, "clips": owner == 1}
    figure = Figure((WIDTH, 3.6), dpi=100, layout="constrained")
    for axes, (kind, title) in zip(figure.subplots(2, 1, sharex=True), names.items(), strict=True):
        for inside, colour, label in ((~held[kind], "0.6", "training"), (held[kind], "#D55E00", "test")):
            axes.plot(seconds[inside], track[inside], ".", color=colour, ms=6, label=label)
        for end in np.flatnonzero(np.diff(owner)):
            axes.axvline(seconds[end], color="0.3", linewidth=0.8)
        axes.set(title=title, ylabel="jaw open")
        tidy(axes)
        enlarge(axes, 12)
    axes.set_xlabel("seconds", fontsize=12)
    axes.legend(loc="upper left", fontsize=12, markerscale=2)
    return figure, Words(
        "The jaw over the frames of three clips, twice: above, test frames lie between training frames all along the "
        "curve; below, one whole clip is for the test.",
        "A frame is a dot; grey lines are the clips' borders. The control is divided by its largest value.",
    )
