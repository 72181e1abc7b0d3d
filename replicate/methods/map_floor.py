"""The floors of the maps: the true mesh projected onto deformation maps, an oracle for what their size allows."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from replicate.config import Config
from replicate.methods import artefacts
from replicate.methods.method import Method

NOTE = "An oracle: the true mesh projected onto the deformation maps by least squares: what their resolution allows."


@dataclass(frozen=True)
class MapSettings:
    """The maps' widths in pixels; 0 for no refinement."""

    map_size: int
    refined_map_size: int = 0


def load(inputs: Mapping[str, Path], settings: MapSettings) -> Callable:
    """Return (parameters, truth (b, n, 3)) → the truth as well as the maps can hold it."""
    from replicate.approximation.deformation_map import Floor

    mesh = artefacts.load_mesh(inputs)
    squares = artefacts.load_squares(inputs) if settings.refined_map_size else ()
    segments = artefacts.load_coarse_segments(inputs, mesh)
    floor = Floor(segments, settings.map_size, squares, settings.refined_map_size)
    return lambda params, truth: mesh.neutral + floor(truth - mesh.neutral)


def _settings(config: Config) -> MapSettings:
    return MapSettings(config.coarse.map_size)


def _refined_settings(config: Config) -> MapSettings:
    return MapSettings(config.coarse.map_size, config.refinement.map_size)


def _poses(config: Config) -> int:
    return config.evaluation.floor_poses or config.evaluation.test_poses


# Each floor has the colour of its networks.
SHARED = {"oracle": True, "note": NOTE, "mark": "‡", "in_figures": False, "poses": _poses}
METHODS = (
    Method(
        "floor",
        "Floor, coarse maps",
        lambda plan: (artefacts.influence_stage(plan),),
        load,
        80,
        colour="#E69F00",
        floor_of="coarse",
        settings=_settings,
        **SHARED,
    ),
    Method(
        "floor_refined",
        "Floor, refined maps",
        lambda plan: (artefacts.influence_stage(plan), artefacts.squares_stage(plan)),
        load,
        81,
        colour="#0072B2",
        floor_of="refined",
        settings=_refined_settings,
        **SHARED,
    ),
)
