"""The floors of the maps: the true mesh projected onto the deformation maps, an oracle for what their size allows."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from replicate.config import Config
from replicate.engine.stage import Stage
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan

NOTE = "An oracle: the true mesh projected onto the deformation maps by least squares: what their resolution allows."


@dataclass(frozen=True)
class MapNumbers:
    """The maps' widths in pixels; 0 for no refinement."""

    map_size: int
    refined_map_size: int = 0


def _stages(plan: Plan) -> tuple[Stage, ...]:
    return (artefacts.influence_stage(plan),)


def _refined_stages(plan: Plan) -> tuple[Stage, ...]:
    return (artefacts.influence_stage(plan), artefacts.squares_stage(plan))


def load(inputs: Mapping[str, Path], numbers: MapNumbers) -> Callable:
    """Return (parameters, truth (b, n, 3)) → the vertices that the maps can hold of the truth."""
    from replicate.approximation.deformation_map import Floor

    mesh = artefacts.load_mesh(inputs)
    squares = artefacts.load_squares(inputs) if numbers.refined_map_size else ()
    segments = artefacts.load_coarse_segments(inputs, mesh)
    floor = Floor(segments, numbers.map_size, squares, numbers.refined_map_size)
    return lambda params, truth: mesh.neutral + floor(truth - mesh.neutral)


def _numbers(config: Config) -> MapNumbers:
    return MapNumbers(config.coarse.map_size)


def _refined_numbers(config: Config) -> MapNumbers:
    return MapNumbers(config.coarse.map_size, config.refinement.map_size)


def _poses(config: Config) -> int:
    return config.evaluation.floor_poses or config.evaluation.test_poses


# Each has the colour of the networks whose floor it is.
SHARED = {"oracle": True, "note": NOTE, "mark": "‡", "in_figures": False, "poses": _poses}
METHODS = (
    Method(
        "floor",
        "Floor, coarse maps",
        _stages,
        load,
        80,
        colour="#E69F00",
        floor_of="coarse",
        numbers=_numbers,
        **SHARED,
    ),
    Method(
        "floor_refined",
        "Floor, refined maps",
        _refined_stages,
        load,
        81,
        colour="#0072B2",
        floor_of="refined",
        numbers=_refined_numbers,
        **SHARED,
    ),
)
