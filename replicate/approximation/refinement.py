"""The refinement: where coarse maps are too coarse, larger maps over small squares add the residual (§3.2, §3.3)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Float64, Int
from threadpoolctl import threadpool_limits

from replicate.approximation.cnn import make_network, shape_facts
from replicate.approximation.deformation_map import bilinear, polyharmonic_map, sampling_matrix
from replicate.approximation.losses import Supervision
from replicate.approximation.model import SegmentedModel, fresh_model, load_model
from replicate.approximation.samples import SampleSet
from replicate.approximation.segments import Segment, make_segment, segment_vertices
from replicate.approximation.training import prepare, train
from replicate.base.exceptions import InputError
from replicate.config import RefinementConfig
from replicate.geometry.mesh import Mesh

UNCOVERED_COST = 0.25  # squared distance that counts for a vertex whose chart has no cluster: half a chart's width
STARTS = 4  # k-means runs, the best of which is taken
GAP_NOISE = 0.02  # how much a gap differs between runs of k-means


@dataclass(frozen=True)
class Elbow:
    """How the number of clusters was chosen.

    inertia: that of 1, 2, … clusters, as a share of the cost without clusters.
    even: the same for an error that is equal everywhere.
    clusters: their number, where the gap between the two curves' logarithms first stops growing.
    """

    inertia: tuple[float, ...]
    even: tuple[float, ...]
    clusters: int


def map_error(segments: Sequence[Segment], offsets: Float[np.ndarray, "p n 3"], size: int) -> Float64[np.ndarray, " n"]:
    """Return e_i of Eq. 2 in mm²: what each vertex loses in a map of size² pixels, over p poses; zero outside segments.

    The maps hold offsets, not positions, as those of the networks do.
    """
    errors = np.zeros(offsets.shape[1])
    for segment in segments:
        truth = offsets[:, segment.vertices].transpose(1, 0, 2).reshape(len(segment.vertices), -1)  # (k, 3p)
        pixels = polyharmonic_map(segment.uv, truth, size).reshape(size**2, -1)
        residual = truth - sampling_matrix(bilinear(segment.uv, size)) @ pixels
        errors[segment.vertices] = (residual**2).sum(1) / len(offsets)
    return errors


def select(
    segments: Sequence[Segment],
    errors: Float[np.ndarray, " n"],
    influence: Bool[np.ndarray, "n m"],
    square: float,
    clusters_max: int,
    seed: int = 0,
) -> tuple[tuple[Segment, ...], Elbow]:
    """Return the refinement segments (§3.3), and how the number of clusters was chosen.

    segments: the coarse ones.
    errors: e_i of Eq. 2, mm².
    influence: which parameter can move which vertex.
    square: the side of a square, in widths of a chart.
    clusters_max: the most clusters that are tried.
    seed: of k-means.

    Texture coordinates of each chart are clustered by k-means, weighted by e_i. The vertices in a square around a
    centroid form a segment, whose coordinates are stretched to fill its map. A cluster belongs to one chart, since
    charts are separate planes: clusters go where they lower the summed inertia most, and a vertex in a chart without
    clusters costs UNCOVERED_COST.
    """
    weights = [errors[segment.vertices] for segment in segments]
    centroids, knee = clusters([segment.uv for segment in segments], weights, clusters_max, seed)
    squares = []
    for segment, centres in zip(segments, centroids, strict=True):
        squares += square_segments(segment, centres, influence, square)
    if not squares:
        raise InputError(f"refinement.square is {square}: no such square holds three vertices; choose a larger one")
    return tuple(squares), knee


def square_segments(
    segment: Segment, centres: Float[np.ndarray, "c 2"], influence: Bool[np.ndarray, "n m"], square: float
) -> list[Segment]:
    """Return the segments of a chart's squares: the vertices in each, their coordinates stretched to fill its map.

    A vertex in several squares belongs to that of the nearest centroid, by the larger difference in u or v, so that
    every vertex in a square belongs to a segment. Squares with fewer than three vertices are dropped.
    """
    if len(centres) == 0:
        return []
    apart = np.abs(segment.uv[:, None] - centres).max(2)  # (k, c)
    owner = np.where(apart.min(1) <= square / 2, apart.argmin(1), -1)
    squares = []
    for c in range(len(centres)):
        uv, vertices = segment.uv[owner == c], segment.vertices[owner == c]
        if len(uv) >= 3:
            low, size = uv.min(0), np.ptp(uv, axis=0)
            stretched = (uv - low) / np.where(size > 0, size, 1)
            squares.append(make_segment(f"{segment.name}_{c + 1}", vertices, stretched, influence))
    return squares


def clusters(
    charts: Sequence[np.ndarray], weights: Sequence[np.ndarray], most: int, seed: int
) -> tuple[list[Float64[np.ndarray, "c 2"]], Elbow]:
    """Return each chart's centroids (c may be 0) for the number of clusters, at most `most`, at the elbow."""
    fits, dealt, inertia = deal(charts, weights, most, seed)
    if not inertia:
        raise InputError("refinement: the coarse maps hold every vertex exactly, so there is nothing to refine")
    _, _, even = deal(charts, [np.ones(len(weight)) for weight in weights], len(inertia), seed)
    count = elbow(inertia, even)
    centroids = [fit[d - 1][1] if d else np.zeros((0, 2)) for fit, d in zip(fits, dealt[count - 1], strict=True)]
    return centroids, Elbow(tuple(inertia), tuple(even), count)


def deal(
    charts: Sequence[np.ndarray], weights: Sequence[np.ndarray], most: int, seed: int
) -> tuple[list[list[tuple[float, np.ndarray]]], list[tuple[int, ...]], list[float]]:
    """Return each chart's fits, how many of 1, 2, … clusters each chart gets, and the remaining share of the cost."""
    fits = [_chart_fits(uv, weight, most, seed) for uv, weight in zip(charts, weights, strict=True)]
    costs = [
        [UNCOVERED_COST * float(w.sum())] + [cost for cost, _ in fit] for w, fit in zip(weights, fits, strict=True)
    ]
    whole = sum(cost[0] for cost in costs)
    counts = [0] * len(charts)
    inertia, history = [], []
    for _ in range(most):
        gains = [cost[d] - cost[d + 1] if d + 1 < len(cost) else -np.inf for cost, d in zip(costs, counts, strict=True)]
        if max(gains) == -np.inf:  # every chart has as many clusters as places with an error
            break
        counts[int(np.argmax(gains))] += 1
        history.append(tuple(counts))
        inertia.append(sum(cost[d] for cost, d in zip(costs, counts, strict=True)) / whole)
    return fits, history, inertia


def _chart_fits(uv: np.ndarray, weight: np.ndarray, most: int, seed: int) -> list[tuple[float, np.ndarray]]:
    """Return (inertia, centroids) of one chart for 1, 2, … clusters."""
    from sklearn.cluster import KMeans  # slow; posing a face doesn't need it

    fits = []
    distinct = len(np.unique(uv[weight > 0], axis=0))
    with threadpool_limits(1):
        for k in range(1, min(most, distinct) + 1):
            means = KMeans(k, n_init=STARTS, random_state=seed).fit(uv.astype(np.float64), sample_weight=weight)
            fits.append((float(means.inertia_), means.cluster_centers_))
    return fits


def elbow(inertia: Sequence[float], even: Sequence[float]) -> int:
    """Return the number of clusters at the elbow of an inertia curve: where its gap to `even` first stops growing.

    The gap is log(even) − log(inertia), where `even` is the curve of an error that is equal everywhere (Tibshirani,
    Walther and Hastie 2001, "Estimating the number of clusters in a data set via the gap statistic"). Unlike the point
    farthest below the chord of the curve, it doesn't depend on where the curve ends. See DEVIATIONS, D11.
    """
    least = np.finfo(np.float64).tiny
    gap = np.log(np.maximum(even, least)) - np.log(np.maximum(inertia, least))
    falls = np.append(gap[1:] <= gap[:-1] + GAP_NOISE, True)
    return int(np.argmax(falls)) + 1


class RefinedModel:
    """The full approximation Δ + δ: a coarse model and the refinement's residual on top."""

    def __init__(self, coarse: SegmentedModel, residual: SegmentedModel):
        self.coarse, self.residual = coarse, residual

    def offsets(self, params: Float[np.ndarray, "b m"], batch: int = 32) -> Float32[np.ndarray, "b n 3"]:
        """Return full-mesh offsets (mm) for raw rig parameters; zero on vertices of no segment."""
        return self.coarse.offsets(params, batch) + self.residual.offsets(params, batch)

    def size_mb(self) -> float:
        """Return the size of all weights of both stages in MB of 10⁶ bytes."""
        return self.coarse.size_mb() + self.residual.size_mb()


def train_refined(
    mesh: Mesh,
    coarse: SegmentedModel,
    segments: Sequence[Segment],
    samples: SampleSet,
    config: RefinementConfig,
    scratch: Path,
    progress: Callable,
    seed: int,
    device: str = "cpu",
) -> tuple[RefinedModel, list[dict]]:
    """Train the refinement networks on the residual of a fixed coarse model; return the model and its log.

    coarse: the coarse model; the networks see rig parameters scaled as in it.
    segments: those of the refinement. The other arguments are those of `train_segments`.

    The loss is Eq. 1 of Δ + δ on the faces that touch a refined vertex, since nothing else can change. The coarse
    networks behind those faces are evaluated with every batch: that takes a millisecond, and saves a table of
    predictions for all samples.
    """
    place = prepare(device)
    refined = segment_vertices(segments)
    supervision = Supervision(mesh, samples, coarse.vertices, config.normal_weight, place, refined)
    params, offsets = supervision.statistics()
    networks = [make_network(segment, shape_facts(config)) for segment in segments]
    targets = offsets - coarse.offsets(params)
    residual = fresh_model(networks, segments, coarse.scale.cpu().numpy(), targets, config, seed).to(place)
    coarse = coarse.to(place)
    near = [k for k, s in enumerate(coarse.segments) if np.isin(s.vertices, supervision.vertices).any()]
    below = coarse.part(near)
    source = _positions(below.vertices, supervision.vertices, place)
    target = _positions(supervision.vertices, refined, place)

    def loss_of_step(step: int) -> torch.Tensor:
        params, truth = supervision.batch(seed, "refined", step, config.training)
        with torch.no_grad():
            base = below(params)[:, source]
        return supervision.loss(base.index_add(1, target, residual(params)), truth)

    measure = partial(supervision.validation(coarse.offsets), residual.offsets)
    log = train(residual, loss_of_step, config.training, scratch, progress, "refined", measure)
    return RefinedModel(coarse, residual), log


def _positions(among: Int[np.ndarray, " a"], members: Int[np.ndarray, " w"], device: torch.device) -> torch.Tensor:
    """Return the position in `among` of each of `members`, all of which are in it."""
    order = np.argsort(among)
    return torch.from_numpy(order[np.searchsorted(among, members, sorter=order)]).to(device)


def load_refined(folder: Path, coarse: SegmentedModel) -> RefinedModel:
    """Read a refinement that `cnn.save(model.residual, …)` wrote; raise InputError if there is none."""
    return RefinedModel(coarse, load_model(folder, make_network))
