"""One character's numbers of Table 1, from the artefacts of the stages that train nothing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from replicate.approximation.model_size import MapShape, NetworkShape, cnn_size_mb, dense_size_mb
from replicate.approximation.segments import Segment
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.report.results import Row, run_name


@dataclass(frozen=True)
class SizeSettings:
    """The settings of Table 1's stage: the labels of its rows, and the shapes of the networks."""

    character: str
    profile: str
    coarse: MapShape
    refined: MapShape


# The dense baseline's hidden layers: as the text has them, and as the released code has them (DEVIATIONS D13).
WIDTHS = {"dense": (256, 256), "dense_released": (256, 512)}


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
