"""What deliberate faults do to Table 2's numbers, to show that the tolerances of the committed results notice them.

`make bench-faults` takes a run's networks, skins and attachments, breaks one thing at a time and measures again:
texture coordinates flipped, a segment that predicts nothing, a refinement left out, teeth carried by others' vertices,
half of the bones lost, and coarse networks trained without the normal term of Eq. 1. The sound run is measured on the
same poses.
`tests/report/test_tolerances.py` asserts that every band of tolerances.toml beside it notices the fault that it names,
for other characters too, whose errors it changes as a fault does here.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from data_recipes import recipe_paths
from replicate.approximation.cnn import make_network
from replicate.approximation.metrics import Predictor, evaluate, unique_poses
from replicate.approximation.model import SegmentedModel, load_model
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.rigid import Attachments, attach
from replicate.approximation.samples import SampleSet
from replicate.base.progress import progress
from replicate.benchmarks.common import add_count, answer, artefacts_of, bench_characters, make_parser
from replicate.config import Config
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts, measurement
from replicate.methods import coarse as coarse_method
from replicate.methods.method_registry import method_named
from replicate.methods.plan import Plan
from replicate.report.results import Row, error_rows
from replicate.report.tables import Table, our_value

ABOUT = "what deliberate faults do to the numbers of Table 2"
WRITES = "results/runs/bench/bench_faults.csv"
TABLE = "bench_faults"
POSES = 128
METHODS = ("coarse", "refined", "floor", "neutral", "attachment", "lbs16", "lbs32")
COLUMNS = (
    ("coarse", "vertex"),
    ("coarse", "normal"),
    ("refined", "vertex"),
    ("refined", "normal"),
    ("lbs32", "vertex"),
)


def networks(inputs: dict[str, Path], flipped: bool = False) -> tuple:
    """Return the coarse and the refined model of a run, reading their maps at (1 − u, v) if flipped."""

    def make(segment, facts):
        uv = np.ascontiguousarray(np.float32([1, 0]) + np.float32([-1, 1]) * segment.uv) if flipped else segment.uv
        return make_network(replace(segment, uv=uv), facts)

    coarse, residual = (load_model(inputs[name], make) for name in ("coarse", "refined"))
    return coarse, RefinedModel(coarse, residual)


def predictor_of(
    mesh: Mesh, attachments: Attachments, model: SegmentedModel | RefinedModel, movable: np.ndarray | None = None
) -> Predictor:
    """Return the predictor of a model; movable: the vertices that it may move, all by default."""

    def predict(params: np.ndarray, truth: np.ndarray) -> np.ndarray:
        offsets = model.offsets(params)
        return attach(mesh, attachments, mesh.neutral + (offsets if movable is None else offsets * movable[:, None]))

    return predict


def faults(config: Config) -> tuple[Mesh, SampleSet, Attachments, dict[str, dict[str, Predictor]]]:
    """Return mesh, samples, attachments and by fault's name the predictor of each method under that fault."""
    plan = Plan(config)
    measured = {name: measurement.stage(plan, method_named(name)) for name in METHODS}
    inputs = artefacts_of(TABLE, config, list(measured.values()))
    unweighted = replace(config, coarse=replace(config.coarse, normal_weight=0.0))
    faulty = artefacts_of(TABLE, unweighted, [coarse_method.stage(Plan(unweighted))])
    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
    attachments = artefacts.load_attachments(inputs)
    sound = {name: measurement.predictor(stage.config, inputs) for name, stage in measured.items()}
    place = partial(predictor_of, mesh, attachments)
    coarse, refined = networks(inputs)
    flipped, both_flipped = networks(inputs, flipped=True)
    movable = mesh.segment != np.bincount(mesh.segment).argmax()  # all but the face
    shifted = replace(attachments, vertex=np.roll(attachments.vertex, len(attachments.vertex) // 2, axis=0))
    changed = {
        "sound": {},
        "uv_flipped": {"coarse": place(flipped), "refined": place(both_flipped)},
        "segment_zeroed": {"coarse": place(coarse, movable), "refined": place(refined, movable)},
        "refinement_left_out": {"refined": sound["coarse"]},
        "teeth_on_wrong_vertices": {"attachment": lambda params, truth: attach(mesh, shifted, truth)},
        "half_of_the_bones": {"lbs32": sound["lbs16"]},
        "normals_unweighted": {"coarse": place(coarse_method.load_model(faulty))},
    }
    return mesh, samples, attachments, {name: sound | predictors for name, predictors in changed.items()}


def measure(config: Config, count: int) -> list[Row]:
    """Return Table 2's rows under every fault on `count` test poses; their table is "table2@<fault>"."""
    mesh, samples, attachments, faulty = faults(config)
    poses = unique_poses(samples.test_params)
    poses = poses[np.linspace(0, len(poses) - 1, min(count, len(poses))).astype(int)]
    poses_and_truth = (mesh, samples.test_params[poses], samples.test_offsets[poses])
    character, rows = recipe_paths.character_label(config.character), []
    errors_by: dict[Callable, object] = {}  # a predictor that several faults share is evaluated once
    for name, predictors in faulty.items():
        missing = {method: predict for method, predict in predictors.items() if predict not in errors_by}
        with progress(len(poses), f"errors, {name}") as bar:
            fresh = evaluate(*poses_and_truth, missing, attachments.segment, config.evaluation.batch, bar)
        errors_by |= {predict: fresh[method] for method, predict in missing.items()}
        errors = {method: errors_by[predict] for method, predict in predictors.items()}
        for row in error_rows(character, errors, config.profile, "bench-faults"):
            rows.append(replace(row, table=f"{row.table}@{name}"))
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the measurement from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__.splitlines()[0], profile="whose networks are broken")
    add_count(parser, "poses", POSES, "test poses to measure on")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    bench_characters(TABLE, partial(measure, count=options.poses), faults_table, options, command_line)


def faults_table(rows: Sequence[Row], character: str) -> Table:
    """Return the mean errors of one character under every fault."""
    by_key = {(row.table, row.method, row.metric): row for row in rows}
    names = list(dict.fromkeys(row.table.partition("@")[2] for row in rows))
    lines = []
    for name in names:
        found = (by_key[f"table2@{name}", method, f"{kind}_error_mean"] for method, kind in COLUMNS)
        lines.append((name.replace("_", " "), *map(our_value, found)))
    header = ("", *(f"{method}, {'mm' if kind == 'vertex' else 'degrees'}" for method, kind in COLUMNS))
    note = f"mean errors on {rows[0].poses} test poses."
    return Table("Table 2's numbers under deliberate faults", (header,), tuple(lines), (note,))


if __name__ == "__main__":
    sys.exit(main())
