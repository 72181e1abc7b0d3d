"""Print Table 1: each character's counts of segments and sizes of models, ours beside the paper's; and claim C6.

From the paper's counts of segments and parameters follow the least and the most that its CNN can weigh, and from its
dense sizes how many vertices its dense networks must move.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.approximation.model_size import MapShape, NetworkShape, cnn_size_mb, dense_size_mb, dense_vertices
from replicate.approximation.segments import Segment
from replicate.config import CoarseConfig, RefinementConfig
from replicate.drawing.panels import DPI, WIDTH, Words, enlarge, tidy
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.report.results import STANDS_FOR, Row, characters_of, find, run_name, seeds_note
from replicate.report.tables import Table, paper_value, round_off

if TYPE_CHECKING:
    import matplotlib.figure

# The dense baseline's hidden layers: as the text has them, and as the released code has them (DEVIATIONS D13).
WIDTHS = {"dense": (256, 256), "dense_released": (256, 512)}
CLAIM = (2.0, 5.0)  # C6: how many times as large as the CNN the dense model is
NOTES = (
    "Sizes are those of all weights as float32, 1 MB = 10⁶ bytes; a character's rigid segments have none.",
    "least–most: networks that see no rig parameter, and networks that see all; what they see lies between.",
    "Vertices implied: how many the paper's dense networks move if they see all parameters, and if they see none. "
    "More than the character has means that its networks were not of that width.",
)


def table1(ours: Iterable[Row], paper: Sequence[Row], lines: Collection[str] = ()) -> Table:
    """Return Table 1 with a column for each of our characters, next to it the film character that it stands for.

    lines: the labels of those that are shown, such as `COUNTS`; all by default, with notes on the others.
    """
    rows = [row for row in ours if row.table == "table1"]
    whose = []  # (heading, rows, character)
    for character in characters_of(rows):
        whose.append((character, rows, character))
        if character in STANDS_FOR:
            whose.append((STANDS_FOR[character], paper, STANDS_FOR[character]))
    body: list[tuple[str, ...] | None] = []
    for line in [line for line in _LINES if not lines or (line and line[0] in lines)]:
        cells = line and [line[1](source, name, source is paper) for _, source, name in whose]
        body.append(line and (line[0], *cells))
    profiles = sorted({row.profile for row in rows})
    about = "; ".join([f"profile {', '.join(profiles)}", seeds_note(rows)])
    header = ("", *(heading for heading, _, _ in whose))
    return Table(
        "Table 1: the models of our characters beside the paper's",
        (header,),
        tuple(body),
        (*NOTES[: 1 if lines else None], about),
    )


def size_ratio(rows: Iterable[Row], character: str, dense: str = "dense") -> float | None:
    """Return how many times as large as the CNN a character's dense model is; None where a size is missing."""
    rows = list(rows)
    large, small = (find(rows, "table1", character, method, "model_size") for method in (dense, "refined"))
    return large.value / small.value if large and small and small.value else None


def size_claim(ours: Sequence[Row], paper: Sequence[Row]) -> str:
    """Judge claim C6, "the CNN is 2–5× smaller than the dense model", in a few sentences.

    The dense layers of the paper's text decide; those of the released code are mentioned. An even smaller CNN is fine.
    """
    ratios = {name: ratio for name in characters_of(ours) if (ratio := size_ratio(ours, name))}
    claim = f"C6, a CNN {CLAIM[0]:g} to {CLAIM[1]:g} times smaller than the dense model,"
    if not ratios:
        return f"{claim} is not tested: there are no sizes."
    inside = [name for name, ratio in ratios.items() if ratio >= CLAIM[0]]
    outside = [name for name in ratios if name not in inside]
    verdicts = ((word, names) for word, names in (("holds on", inside), ("fails on", outside)) if names)
    beyond = [name for name, ratio in ratios.items() if ratio > CLAIM[1]]
    verdict = " and ".join(f"{word} {_in_words(names)}" for word, names in verdicts)
    wide = {name: ratio for name in ratios if (ratio := size_ratio(ours, name, "dense_released"))}
    theirs = {name: ratio for name in STANDS_FOR.values() if (ratio := size_ratio(paper, name))}
    reasons = [
        f"With hidden layers of {_widths('dense')} the dense model is {_times(ratios)} times as large as the CNN.",
        f"With hidden layers of {_widths('dense_released')} it is {_times(wide)} times as large." if wide else "",
        f"In the paper it is {_times(theirs)} times as large." if theirs else "",
        f"That it is more than {CLAIM[1]:g} times on {_in_words(beyond)} is no failure." if beyond else "",
    ]
    return f"{claim} {verdict}. {' '.join(filter(None, reasons))}"


def _in_words(names: Iterable[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last


def _times(ratios: dict[str, float]) -> str:
    return _in_words(f"{ratio:.1f} ({name})" for name, ratio in ratios.items())


def _widths(method: str) -> str:
    return " and ".join(map(str, WIDTHS[method]))


def _number(method: str, metric: str) -> Callable:
    def cell(rows, character: str, is_paper: bool) -> str:
        row = find(rows, "table1", character, method, metric)
        if is_paper:
            return paper_value(row)
        return round_off(row.value, row.unit, row.sd or None) if row else "–"

    return cell


def _span(method: str) -> Callable:
    def cell(rows, character: str, is_paper: bool) -> str:
        least, most = bracket(rows, character) if is_paper and method == "refined" else _ends(rows, character, method)
        return f"{least:.2f}–{most:.2f}" if least is not None and most is not None else "–"

    return cell


def _ends(rows, character: str, method: str) -> tuple[float | None, float | None]:
    sizes = (find(rows, "table1", character, method, f"model_size_{end}") for end in ("least", "most"))
    least, most = (row.value if row else None for row in sizes)
    return least, most


def bracket(paper: Iterable[Row], character: str) -> tuple[float | None, float | None]:
    """Return the least and the most, in MB, that the CNN of a character of the paper's can weigh, from its counts."""
    paper = list(paper)
    counts = [
        find(paper, "table1", character, *key)
        for key in (("coarse", "segments"), ("refined", "segments"), ("model", "rig_parameters"))
    ]
    if None in counts:
        return None, None
    coarse, refined, parameters = (round(row.value) for row in counts)
    least, most = (
        cnn_size_mb([count] * coarse, [count] * refined, CoarseConfig(), RefinementConfig())
        for count in (0, parameters)
    )
    return least, most


def _network_share(rows, character: str, is_paper: bool) -> str:
    """Return the mean share of the rig parameters that a network of the CNN sees, from where its size lies between."""
    size = find(rows, "table1", character, "refined", "model_size")
    least, most = bracket(rows, character) if is_paper else _ends(rows, character, "refined")
    if size is None or least is None or most is None or most <= least:
        return "–"
    return f"{(size.value - least) / (most - least):.0%}"


def implied_vertices(paper: Iterable[Row], character: str, method: str) -> tuple[float, float] | None:
    """Return how many vertices a dense model of the paper's size moves, if it sees all parameters, and if none."""
    paper = list(paper)
    keys = (("dense", "model_size"), ("coarse", "segments"), ("model", "rig_parameters"))
    found = [find(paper, "table1", character, *key) for key in keys]
    if None in found:
        return None
    size, segments, parameters = (row.value for row in found)
    fewest, most = (dense_vertices(size, round(segments), count, WIDTHS[method]) for count in (round(parameters), 0))
    return fewest, most


def _dense_vertices(method: str) -> Callable:
    def cell(rows, character: str, is_paper: bool) -> str:
        ends = implied_vertices(rows, character, method) if is_paper else None
        return f"{ends[0]:,.0f}–{ends[1]:,.0f}" if ends else ""

    return cell


def _ratio(method: str) -> Callable:
    def cell(rows, character: str, is_paper: bool) -> str:
        return round_off(size_ratio(rows, character, method), "ratio")

    return cell


_LINES = (
    ("Vertices", _number("model", "vertices")),
    ("Rig parameters", _number("model", "rig_parameters")),
    ("Coarse segments", _number("coarse", "segments")),
    ("Refinement segments", _number("refined", "segments")),
    ("Rigid segments", _number("model", "rigid_segments")),
    None,
    ("CNN, MB", _number("refined", "model_size")),
    ("– least–most", _span("refined")),
    ("– parameters a network sees, mean", _network_share),
    ("– coarse networks alone", _number("coarse", "model_size")),
    (f"Dense {'/'.join(map(str, WIDTHS['dense']))}, MB", _number("dense", "model_size")),
    ("– least–most", _span("dense")),
    (f"Dense {'/'.join(map(str, WIDTHS['dense_released']))}, MB", _number("dense_released", "model_size")),
    ("– least–most", _span("dense_released")),
    ("Dense over CNN", _ratio("dense")),
    (f"Dense {'/'.join(map(str, WIDTHS['dense_released']))} over CNN", _ratio("dense_released")),
    None,
    ("Vertices that deform", _number("model", "deformable_vertices")),
    *((f"– implied by dense {'/'.join(map(str, WIDTHS[name]))}", _dense_vertices(name)) for name in WIDTHS),
)

COUNTS = (  # the lines that most readers want
    *("Vertices", "Rig parameters", "Coarse segments", "Refinement segments", "Rigid segments"),
    *("CNN, MB", f"Dense {'/'.join(map(str, WIDTHS['dense']))}, MB", "Dense over CNN"),
)

# C6 as a chart: how many times as large as the CNN the dense model is.

OURS, THEIRS = "#1F6FB4", "#333333"


def ratio_chart(ours: Sequence[Row], paper: Sequence[Row]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the dense model's size over the CNN's, ours as dots and the paper's as rings."""
    from matplotlib.figure import Figure

    characters = characters_of(ours)
    figure = Figure((WIDTH, 1.3 + 0.45 * len(characters)), dpi=DPI, layout="constrained")
    axes, labels, phrases = figure.subplots(), [], []
    axes.axvspan(*CLAIM, color="0.92", zorder=0)
    for y, character in enumerate(characters):
        film = STANDS_FOR.get(character)
        theirs = size_ratio(paper, film) if film else None
        ratio = size_ratio(ours, character)
        if theirs:
            axes.plot(theirs, y, "o", markerfacecolor="none", markeredgecolor=THEIRS, markersize=14)
        if ratio:
            axes.plot(ratio, y, "o", color=OURS, markersize=10)
        labels.append(f"{character} ({film})" if film else character)
        phrases.append(f"{labels[-1]}: {round_off(ratio, 'ratio')} and {round_off(theirs, 'ratio')}")
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.set_xlabel("how many times as large as the CNN the dense model is")
    tidy(axes)
    enlarge(axes)
    return figure, Words(
        f"A dot chart of the dense model's size over the CNN's, ours and the paper's. {'; '.join(phrases)}.",
        f"Dots are ours, rings the paper's. The grey band is the claim, {CLAIM[0]:g} to {CLAIM[1]:g} times.",
    )


# One character's numbers of Table 1, from the artefacts of the stages that train nothing.


@dataclass(frozen=True)
class SizeSettings:
    """The settings of Table 1's stage: the labels of its rows, and the shapes of the networks."""

    character: str
    profile: str
    coarse: MapShape
    refined: MapShape


def rows_of(settings: SizeSettings, inputs: Mapping[str, Path]) -> list[Row]:
    """Return a character's rows.

    inputs: the folders of the stages "rig", "influence", "rigid" and "selection".
    """
    mesh, parameters = artefacts.load_mesh(inputs), artefacts.load_influence(inputs).shape[1]
    coarse, refined = artefacts.load_coarse_segments(inputs, mesh), artefacts.load_squares(inputs)
    rigid = len(artefacts.load_attachments(inputs).segment)
    run, values = run_name(inputs), counts(mesh, parameters, rigid, coarse, refined)
    values |= sizes_mb(parameters, coarse, refined, settings.coarse, settings.refined)
    return [
        Row("table1", settings.character, method, metric, unit, float(value), None, 1, None, settings.profile, run)
        for (method, metric), (unit, value) in values.items()
    ]


def counts(
    mesh: Mesh, parameters: int, rigid: int, coarse: Sequence[Segment], refined: Sequence[Segment]
) -> dict[tuple[str, str], tuple[str, float]]:
    """Return the counts of Table 1 and the number of vertices that the networks move: (method, metric) → (unit, value).

    parameters: m of the whole rig
    rigid: the number of rigid segments
    coarse, refined: the segments of the coarse and of the refinement networks
    """
    values = {
        ("model", "vertices"): len(mesh.neutral),
        ("model", "rig_parameters"): parameters,
        ("model", "rigid_segments"): rigid,
        ("model", "deformable_vertices"): sum(len(segment.vertices) for segment in coarse),
        ("coarse", "segments"): len(coarse),
        ("refined", "segments"): len(refined),
    }
    return {key: ("count", value) for key, value in values.items()}


def sizes_mb(
    parameters: int,
    coarse: Sequence[Segment],
    refined: Sequence[Segment],
    coarse_shape: NetworkShape,
    refined_shape: NetworkShape,
) -> dict[tuple[str, str], tuple[str, float]]:
    """Return the sizes of Table 1, (method, metric) → (unit, value), and the least and most that they could be.

    parameters: m of the whole rig
    coarse, refined: the segments of the coarse and of the refinement networks
    coarse_shape, refined_shape: the shapes of these networks
    """
    sizes = {}
    ends = {"": None, "_least": 0, "_most": parameters}
    for ending, count in ends.items():
        inputs_coarse, inputs_refined = (
            [len(segment.parameters) if count is None else count for segment in part] for part in (coarse, refined)
        )
        sizes["refined", f"model_size{ending}"] = cnn_size_mb(
            inputs_coarse, inputs_refined, coarse_shape, refined_shape
        )
        sizes["coarse", f"model_size{ending}"] = cnn_size_mb(inputs_coarse, (), coarse_shape, refined_shape)
        outputs = [len(segment.vertices) for segment in coarse]
        for method, hidden in WIDTHS.items():
            sizes[method, f"model_size{ending}"] = dense_size_mb(inputs_coarse, outputs, hidden)
    return {key: ("MB", value) for key, value in sizes.items()}
