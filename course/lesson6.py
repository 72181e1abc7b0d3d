"""What lesson 6 is set up with and drawn by: poses of the tiny head, a training loop, and its pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn

from data_recipes.catalogue import build_rig
from data_recipes.rig import Rig
from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.samples import evaluate
from replicate.approximation.sampling import augment, split_clips
from replicate.baselines.dense import DenseNetwork
from replicate.drawing.face_sheet import Cell, face_sheet
from replicate.drawing.panels import WIDTH, Words, enlarge, error_scale, tidy
from replicate.methods.linear import ridge, with_constant

if TYPE_CHECKING:
    import matplotlib.figure

POSES, TEST_POSES = 2_500, 200
HIDDEN, SLOPE = (64, 64), 0.2
STEPS, BATCH, RATE, EVERY = 400, 8, 5e-3, 80


@dataclass(frozen=True)
class Face:
    """A rig and poses of it: Eq. 5 on some clips for training, frames of other clips for the test.

    neutral: (n, 3) mm. faces: (f, 3). scale: (m,), what raw parameters were divided by.
    params, test_params: (b, m), scaled, float32. offsets, test_offsets: (b, n, 3) mm, float32.
    """

    rig: Rig
    neutral: np.ndarray
    faces: np.ndarray
    scale: np.ndarray
    params: np.ndarray
    offsets: np.ndarray
    test_params: np.ndarray
    test_offsets: np.ndarray


@cache
def tiny_face() -> Face:
    """Return the tiny head with poses; no test clip has a frame among the training poses."""
    rig, rng = build_rig("tiny"), np.random.default_rng(6)
    animation, test = split_clips([clip.values for clip in rig.clips], rng)
    training, test = augment(animation, POSES, rng), rng.permutation(test)[:TEST_POSES]
    scale, neutral = parameter_scale(training), rig.mesh.neutral
    parts = []
    for poses in (training, test):
        vertices = np.concatenate([posed for _, posed in evaluate(rig, poses)])
        parts += [(poses / scale).astype(np.float32), vertices - neutral]
    return Face(rig, neutral, rig.mesh.faces, scale, *parts)


STRENGTH = 1e-6  # λ of ridge regression


def ridge_line(face: Face, params: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (m + 1, 3n) of ridge regression on the training poses, the constant last, and its offsets.

    params: (b, m), the poses whose offsets (b, n, 3), mm, are returned.
    """
    targets = face.offsets.reshape(len(face.offsets), -1).astype(np.float64)
    (weights,) = ridge(with_constant(face.params), [targets], (STRENGTH,))
    offsets = with_constant(params) @ weights
    return weights.astype(np.float32), offsets.astype(np.float32).reshape(len(params), -1, 3)


def rms(lengths: np.ndarray) -> float:
    """Return the root of the mean square of some numbers."""
    return float(np.sqrt(np.mean(np.square(lengths, dtype=np.float64))))


def small_network(face: Face, seed: int = 0) -> DenseNetwork:
    """Return a fresh dense network, (b, m) → (b, n, 3), whose outputs are small beside 1."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = DenseNetwork(face.params.shape[1], len(face.neutral), HIDDEN, SLOPE)
    with torch.no_grad():
        network.output.weight.mul_(0.1)
        network.output.bias.zero_()
    return network


class Alone(nn.Module):
    """A network by itself: scaled parameters → unit_mm times what it gives, offsets in mm."""

    def __init__(self, network: nn.Module, unit_mm: float):
        super().__init__()
        self.network, self.unit_mm = network, unit_mm

    def forward(self, params: torch.Tensor) -> torch.Tensor:
        """Return offsets (b, n, 3) in mm."""
        return self.unit_mm * self.network(params)


def errors(face: Face, offsets: np.ndarray) -> tuple[float, float]:
    """Return the mean distance in mm and the mean normal error in degrees of predicted test offsets."""
    posed, truth = face.neutral + offsets, face.neutral + face.test_offsets
    return float(vertex_error(posed, truth).mean()), float(np.nanmean(normal_error(posed, truth, face.faces)))


def wins(face: Face, first: np.ndarray, second: np.ndarray) -> str:
    """Say on how many test poses the line's offsets `first` are nearer than a network's, `second`; (b, n, 3) mm."""
    truth = face.neutral + face.test_offsets
    posed = [face.neutral + offsets for offsets in (first, second)]
    mm = [vertex_error(each, truth).mean(1) for each in posed]
    degrees = [np.nanmean(normal_error(each, truth, face.faces), axis=1) for each in posed]
    shares = (float((one < other).mean()) for one, other in (mm, degrees))
    return "over all test poses the line beats the network on {:.0%} in mm, on {:.0%} in degrees".format(*shares)


def predict(model: nn.Module, params: np.ndarray) -> np.ndarray:
    """Return a model's offsets (b, n, 3) in mm at some scaled parameters."""
    with torch.no_grad():
        return model(torch.from_numpy(params)).numpy()


def train(
    model: nn.Module,
    face: Face,
    loss: Callable[[torch.Tensor, torch.Tensor, torch.Tensor, float], torch.Tensor],
    steps: int = STEPS,
    seed: int = 0,
    alpha: float = 5.0,
    every: int = EVERY,
    rate: float = RATE,
) -> list[tuple[int, float, float]]:
    """Train a model in place by Adam; return (step, mm, degrees) on the test poses, at the start and every so often.

    model: scaled parameters (b, m) → offsets (b, n, 3) in mm.
    face: the poses.
    loss: (vertices, target, faces, α) → a number, as in Eq. 1.
    steps: how many; the learning rate falls to zero at the last one.
    seed: of the batches, which are the same for all models.
    alpha: α.
    every: how many steps lie between two measurements.
    rate: the highest learning rate.

    Gradients are clipped to a norm of 1 over all weights.
    """
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    arrays = (face.neutral, face.params, face.offsets, face.faces.astype(np.int64))
    neutral, params, offsets, faces = map(torch.from_numpy, arrays)
    weights = [weight for weight in model.parameters() if weight.requires_grad]
    optimiser = torch.optim.Adam(weights, lr=rate, fused=True)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=steps)
    batches = np.random.default_rng(seed).integers(len(params), size=(steps, BATCH))
    log = [(0, *errors(face, predict(model, face.test_params)))]
    for step, rows in enumerate(torch.from_numpy(batches), 1):
        optimiser.zero_grad()
        loss(neutral + model(params[rows]), neutral + offsets[rows], faces, alpha).backward()
        nn.utils.clip_grad_norm_(weights, 1.0)
        optimiser.step()
        schedule.step()
        if step % every == 0 or step == steps:
            log.append((step, *errors(face, predict(model, face.test_params))))
    return log


# Pictures.

COLOURS = {"line": "#56B4E9", "network": "#D55E00", "network beside the line": "#009E73"}
OTHERS = ("#CC79A7", "#E69F00", "#0072B2")


def curves(line: tuple[float, float], logs: Mapping[str, Sequence[tuple]]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both test errors over the steps of some trainings, and the line's.

    line: its errors, mm and degrees. logs: name → what `train` returned.
    """
    from matplotlib.figure import Figure

    figure = Figure((0.85 * WIDTH, 3.4), dpi=100, layout="constrained")
    labels = ("distance error, mm", "normal error, degrees")
    for k, axes in enumerate(figure.subplots(1, 2)):
        axes.axhline(line[k], color=COLOURS["line"], linewidth=2, linestyle="--", label="line")
        for place, (name, log) in enumerate(logs.items()):
            steps, colour = [row[0] for row in log], COLOURS.get(name, OTHERS[place % len(OTHERS)])
            axes.plot(steps, [row[1 + k] for row in log], "o-", color=colour, linewidth=2, ms=4, label=name)
        axes.set_xlabel("steps")
        axes.set_ylabel(labels[k])
        error_scale(axes, "y")
        tidy(axes)
        enlarge(axes, 13)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False, fontsize=13)
    ends = "; ".join(f"{name} {log[-1][1]:.2f} mm, {log[-1][2]:.2f}°" for name, log in logs.items())
    return figure, Words(
        f"Two charts of test errors over {max(log[-1][0] for log in logs.values())} steps. The line stays at "
        f"{line[0]:.2f} mm and {line[1]:.2f}°; at the end: {ends}.",
        "Errors on poses of clips that training has no frame of. Both axes of errors are logarithmic.",
    )


LIMIT_DEG = 20.0
PANEL, TALL, SHEET = 235, 1.2, 1000  # width of a head in pixels, its height over that, and the width of all


def heads(face: Face, predictions: Mapping[str, np.ndarray]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the test pose whose normals turn most, by the rig and as some methods predict it.

    predictions: name → test offsets (b, n, 3) in mm.
    """
    from replicate.drawing.heatmap import middle_line, normal_bar, normal_heat, split_face
    from replicate.drawing.render import render
    from replicate.drawing.scene import Surface, camera_for, frame_surfaces

    turned = np.nanmean(normal_error(face.neutral + face.test_offsets, face.neutral, face.faces), axis=1)
    pose = int(np.argmax(turned))
    truth = face.neutral + face.test_offsets[pose]
    width, height = PANEL, round(TALL * PANEL)
    view = frame_surfaces(camera_for("front", face.neutral), [Surface(truth, face.faces)], 1 / TALL)
    draw = partial(render, camera=view, width=width, height=height)
    cells = [Cell("rig", (draw([Surface(truth, face.faces)]),))]
    for name, offsets in predictions.items():
        posed = face.neutral + offsets[pose]
        pictures = draw([Surface(posed, face.faces)]), draw([normal_heat(posed, truth, face.faces, LIMIT_DEG)])
        line = middle_line(face.neutral, posed, face.faces, view, width, height)
        mm, degrees = vertex_error(posed, truth).mean(), np.nanmean(normal_error(posed, truth, face.faces))
        cells.append(Cell(name, (split_face(*pictures, line),), (f"{mm:.2f} mm, {degrees:.1f}°",)))
    bar = partial(normal_bar, limit_deg=LIMIT_DEG, orientation="horizontal")
    numbers = "; ".join(f"{cell.title}: {cell.lines[0]}" for cell in cells[1:])
    return face_sheet(cells, len(cells), bar=bar, width=SHEET), Words(
        f"The tiny head by the rig and by {len(predictions)} methods, half of each face coloured by normal error. "
        f"{numbers}.",
        "The test pose whose normals turn most from rest. Left halves: surfaces; right halves: normal errors.",
    )


def leaky_product(width: int = 8, steps: int = 800, seeds: int = 4) -> Callable[[np.ndarray], np.ndarray]:
    """Return the best of some networks of leaky ReLUs, (b, 2) → (b,), that have learnt to multiply from 0 to 1."""
    torch.set_num_threads(1)
    trained = []
    for seed in range(seeds):
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            network = nn.Sequential(nn.Linear(2, width), nn.LeakyReLU(SLOPE), nn.Linear(width, 1))
            optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
            losses = []
            for _ in range(steps):
                pairs = torch.rand(64, 2)
                optimiser.zero_grad()
                loss = (network(pairs)[:, 0] - pairs.prod(1)).square().mean()
                loss.backward()
                optimiser.step()
                losses.append(loss.item())
        trained.append((np.mean(losses[-100:]), seed, network))
    best = min(trained)[-1]
    return lambda pairs: predict(best, np.asarray(pairs, np.float32))[:, 0]


def products(functions: Mapping[str, Callable]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): level curves of functions of two controls, (b, 2) → (b,), from 0 to 2."""
    from matplotlib.figure import Figure

    side = np.linspace(0, 2, 121, dtype=np.float32)
    pairs = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    figure = Figure((0.85 * WIDTH, 3.2), dpi=100, layout="constrained")
    for axes, (name, function) in zip(figure.subplots(1, len(functions), sharey=True), functions.items(), strict=True):
        values = np.asarray(function(pairs)).reshape(len(side), -1)
        levels = axes.contourf(side, side, values, np.linspace(-0.5, 4, 10), cmap="viridis", extend="both")
        axes.contour(side, side, values, np.linspace(-0.5, 4, 10), colors="white", linewidths=0.4)
        axes.plot([0, 1, 1, 0, 0], [0, 0, 1, 1, 0], color="white", linewidth=2)
        axes.set(title=name, xlabel="control $x$", xticks=(0, 1, 2), yticks=(0, 1, 2), aspect="equal")
        enlarge(axes, 13)
    figure.axes[0].set_ylabel("control $y$", fontsize=13)
    bar = figure.colorbar(levels, ax=figure.axes, shrink=0.8, ticks=(0, 1, 2, 3, 4))
    bar.ax.tick_params(labelsize=13)
    return figure, Words(
        f"Level curves of {len(functions)} functions of two controls from 0 to 2: {', '.join(functions)}.",
        "Values over two controls. White square: where training poses are, for controls are divided by their largest "
        "value in training, which has the random factors of Eq. 5 in it.",
    )


def balances(logs: Mapping[float, Sequence[tuple]], line: tuple[float, float], rest: tuple[float, float]):
    """Return (figure, words): the errors that networks end with, one for each α.

    logs: α → what `train` returned. line, rest: errors of the line and of the face at rest, mm and degrees.
    """
    from matplotlib.figure import Figure

    figure = Figure((WIDTH, 4.0), dpi=100, layout="constrained")
    axes = figure.add_subplot()
    ends = sorted((alpha, *log[-1][1:]) for alpha, log in logs.items())
    axes.plot([mm for _, mm, _ in ends], [deg for *_, deg in ends], "o-", color=COLOURS["network"], linewidth=1, ms=9)
    for place, (alpha, mm, degrees) in enumerate(ends):  # one above its dot, the next one below
        beside = (0, 12 if place % 2 == 0 else -24)
        axes.annotate(f"α = {alpha:g}", (mm, degrees), beside, textcoords="offset points", ha="center")
    axes.plot(*line, "x", color=COLOURS["line"], ms=9, mew=3)
    axes.set_title(f"at {max(log[-1][0] for log in logs.values())} steps")
    axes.annotate("line", line, (12, -4), textcoords="offset points")
    axes.plot(*rest, "s", color="0.4", ms=8)
    axes.annotate("face at rest", rest, (-12, -4), textcoords="offset points", ha="right")
    axes.set(xlabel="distance error, mm", ylabel="normal error, degrees")
    axes.set_xlim(0, 1.1 * max(rest[0], ends[-1][1]))
    axes.set_ylim(0, 1.1 * max(rest[1], max(deg for *_, deg in ends)))
    tidy(axes)
    enlarge(axes, 13)
    words = "; ".join(f"α = {alpha:g}: {mm:.2f} mm, {degrees:.2f}°" for alpha, mm, degrees in ends)
    return figure, Words(
        f"A chart of normal error over distance error. {words}; the line {line[0]:.2f} mm, {line[1]:.2f}°; the face at "
        f"rest {rest[0]:.2f} mm, {rest[1]:.2f}°.",
        f"The same network after {STEPS} steps on Eq. 1, with positions in mm and four α.",
    )


REGIONS, TOUCHES_MM, WIDE = 8, 0.05, 600  # the last one in pixels


def controls_of_regions(face: Face) -> tuple[np.ndarray, np.ndarray]:
    """Return each vertex's region (n,), and which controls move each region (r, m) when they are alone at a limit."""
    from replicate.regional.basis import split_regions

    region = np.empty(len(face.neutral), np.int64)
    for k, members in enumerate(split_regions(face.neutral, REGIONS)):
        region[members] = k
    limits = np.concatenate([np.diag(face.rig.lower), np.diag(face.rig.upper)]).astype(np.float32)
    posed = np.concatenate([vertices for _, vertices in evaluate(face.rig, limits)])
    moved = vertex_error(posed, face.neutral) > TOUCHES_MM  # (2m, n)
    by_control = moved.reshape(2, -1, len(region)).any(0)
    return region, np.stack([by_control[:, region == k].any(1) for k in range(REGIONS)])


def regions(face: Face) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): regions of the tiny head, and how many controls each of them sees."""
    from replicate.drawing.heatmap import colour_bar, error_colours
    from replicate.drawing.light import EVEN
    from replicate.drawing.render import render
    from replicate.drawing.rig_views import DISTINCT
    from replicate.drawing.scene import Surface, camera_for, frame_surfaces

    region, seen = controls_of_regions(face)
    counts, most = seen.sum(1), seen.shape[1]
    palette = np.array(DISTINCT[:REGIONS], np.uint8)
    heat = error_colours(counts.astype(np.float64), most)
    of_face = region[face.faces[:, 0]]
    surfaces = [Surface(face.neutral, face.faces, colours[of_face]) for colours in (palette, heat)]
    view = frame_surfaces(camera_for("three_quarter", face.neutral), surfaces, 1 / TALL)
    pictures = [
        render([surface], view, WIDE // 2 - 60, round(TALL * (WIDE // 2 - 60)), studio=EVEN) for surface in surfaces
    ]
    cells = [Cell(title, (each,)) for title, each in zip(("regions", "controls they see"), pictures, strict=True)]
    bar = partial(colour_bar, limit=most, label=f"controls that move the region, of {most}", orientation="horizontal")
    return face_sheet(cells, len(cells), bar=bar, width=WIDE), Words(
        f"The tiny head twice, in {REGIONS} colours for its regions, and coloured by how many of {most} controls "
        f"move each: {', '.join(map(str, sorted(counts)))}.",
        f"A control is counted where it moves a vertex of the region by more than {TOUCHES_MM:g} mm at one of its "
        "limits, all others at rest.",
    )


PIECES = {
    "removed": (
        "no straight line",
        "leaky ReLUs, no products",
        "squared errors",
        "one region, as many bytes",
        "components of positions alone",
    ),
    "added": ("a network for each region", "the same, each of its region's controls"),
}


def pieces(results: str = "reference", character: str = "teen"):
    """Return a table: both validation errors of changed regional methods, over those of one network for all regions."""
    import pandas

    import replicate
    from replicate.benchmarks.bench_regional import ONE

    frame = replicate.results(results).query("table == 'bench_regional' and character == @character")
    values = dict(zip(frame["metric"], frame["value"], strict=True))
    names = {"mm": "validation_vertex_error", "degrees": "validation_normal_error"}
    rows = [(kind, piece) for kind, pieces_of in PIECES.items() for piece in pieces_of]
    table = {
        unit: [values[f"{name}[{piece}]"] / values[f"{name}[{ONE}]"] for _, piece in rows]
        for unit, name in names.items()
    }
    table = pandas.DataFrame(table, index=pandas.MultiIndex.from_tuples(rows)).map("× {:.2f}".format)
    size = [f"{values[f'model_size[{piece}]']:.1f} MB, not {values[f'model_size[{ONE}]']:.1f}" for _, piece in rows]
    return table.assign(size=size)
