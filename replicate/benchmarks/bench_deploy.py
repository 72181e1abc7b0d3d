"""What leaves the suite, form by form: its size on disk, its milliseconds a pose on one core, and what it is off.

`make bench-deploy` writes each method as `make deploy` does, in all the forms that it has: ONNX with weights of 32 and
of 16 bits, our method as C99, and as the weights of shapes, which NumPy then sums up. It poses the character's test
poses by each of them, and compares the vertices with the suite's own and with the rig's. Where the repository has
trained models of a character nothing is trained, unless `--methods` names others.
"""

import argparse
import ctypes
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from data_recipes.recipe_paths import character_label
from data_recipes.rig import Rig
from replicate.approximation.metrics import unique_poses
from replicate.approximation.rigid import Attachments, attach
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.benchmarks.common import (
    add_count,
    answer,
    artefacts_of,
    bench_characters,
    bench_row,
    in_groups,
    make_parser,
)
from replicate.config import Config
from replicate.deployment.c_face import CFace, c_files
from replicate.deployment.onnx_model import largest_distance, onnx_model
from replicate.deployment.shapes import add_targets, shaped_face, weights_by_onnx, weights_model
from replicate.export.files import glb, posed_parts
from replicate.methods import artefacts
from replicate.methods.attachment import placing_attachments
from replicate.methods.method import Method, Model
from replicate.methods.method_registry import choose, method_named
from replicate.methods.plan import Plan
from replicate.methods.trained import FOLDER, TrainedPlan, entries, plan_for, poses_of_errors
from replicate.regional.model import RegionalModel
from replicate.report.results import Row, find
from replicate.report.tables import Table, our_value
from replicate.timing.backends import Evaluate, run_by_onnx
from replicate.timing.machine import confined
from replicate.timing.single_poses import Way, time_single_poses

ABOUT = "size, milliseconds a pose and errors of what leaves the suite: ONNX, C99, and shapes with their weights"
WRITES = "results/runs/bench/bench_deploy.csv"
TABLE = "bench_deploy"
EVALUATIONS = 200
POSES = 100  # test poses at most that forms are compared on
OTHERWISE = ("coarse", "dense", "regional", "linear")  # the methods where the repository has no models
ONNX, HALF, C99, SHAPES = "ONNX", "ONNX, 16 bits", "C99", "shapes"
FORMS = (ONNX, HALF, C99, SHAPES)
COMPILE = ("cc", "-std=c99", "-O3", "-march=native", "-shared", "-fPIC")
MEGA = 1e6


@dataclass(frozen=True)
class Form:
    """A method as it leaves the suite. size: of its files, bytes. evaluate: (1, m) parameters → (1, n, 3) mm."""

    size: int
    evaluate: Evaluate


def measure(config: Config, named: Sequence[str], evaluations: int) -> list[Row]:
    """Write one character's methods in all forms, and return what each costs and is off as rows."""
    plan, methods = _planned(config, named)
    needed = [stage for method in methods for stage in method.stages(plan)]
    common = [artefacts.rig_stage(plan), artefacts.rigid_stage(plan)]
    taken = [] if isinstance(plan, TrainedPlan) else [artefacts.samples_stage(plan)]
    inputs = artefacts_of(TABLE, config, [*common, *taken, *needed])
    rig, attachments = artefacts.load_rig(inputs), artefacts.load_attachments(inputs)
    poses = _test_poses(plan, inputs)
    truth, rows = rig(poses), []
    with tempfile.TemporaryDirectory() as scratch, progress(len(methods), "methods") as bar:
        for method in methods:
            model, placing = _model(method, inputs), placing_attachments(method, attachments)
            own = attach(rig.mesh, placing, rig.mesh.neutral + model.offsets(poses))
            forms = forms_of(model, rig, placing, Path(scratch))
            with confined():
                ways = {name: Way(form.evaluate) for name, form in forms.items()}
                times = time_single_poses(ways, poses, evaluations, lambda _: None)
            for name, form in forms.items():
                found = np.concatenate([form.evaluate(pose[None]) for pose in poses])
                measured = (
                    ("file_size", "MB", form.size / MEGA, None),
                    ("pose", "ms", times[name].p05, times[name].evaluations),
                    ("pose_median", "ms", times[name].median, times[name].evaluations),
                    ("times_as_long_as_onnx", "ratio", times[name].p05 / times[ONNX].p05, times[name].evaluations),
                    ("largest_difference", "mm", largest_distance(found, own), len(poses)),
                    ("vertex_error", "mm", float(np.linalg.norm(found - truth, axis=-1).mean()), len(poses)),
                )
                character = character_label(config.character)
                rows += [
                    bench_row(TABLE, character, method.name, f"{metric}[{name}]", unit, value, count)
                    for metric, unit, value, count in measured
                ]
            bar.update(1)
    return rows


def _planned(config: Config, named: Sequence[str]) -> tuple[Plan, list[Method]]:
    """Return a character's plan and the methods that are written: those named, or else those that have models here."""
    there = entries().get(config.character, {"stages": {}})["stages"]
    words = list(named) or [name for name in OTHERWISE if name in there] or list(OTHERWISE)
    methods = [method for method in choose(words, config) if method.model]
    if not methods:
        raise InputError(f"methods: expected at least one with a model, got {', '.join(words)}")
    return plan_for(config, methods, [*(method.name for method in methods), "rigid"]), methods


def _model(method: Method, inputs: Mapping[str, Path]) -> Model:
    assert method.model is not None, "methods without one are left out"
    return method.model(inputs)


def _test_poses(plan: Plan, inputs: Mapping[str, Path]) -> Float32[np.ndarray, "t m"]:
    """Return test poses, each once: those of the repository's models, or some spread over the character's."""
    if isinstance(plan, TrainedPlan):
        params = poses_of_errors(FOLDER / plan.facts["file"])
    else:
        params = artefacts.load_samples(inputs).test_params
    params = np.asarray(params[unique_poses(params)], np.float32)
    return params[np.linspace(0, len(params) - 1, min(POSES, len(params))).astype(int)]


def forms_of(model: Model, rig: Rig, attachments: Attachments, folder: Path) -> dict[str, Form]:
    """Return a method's forms by name; those that it hasn't, or that this machine can't run, are missing.

    model: the method's. attachments: what places its rigid segments. folder: where C is compiled.
    """
    forms = {}
    for name, half in ((ONNX, False), (HALF, True)):
        written = onnx_model(model, rig.mesh, attachments, half).SerializeToString()
        forms[name] = Form(len(written), run_by_onnx(written))
    if isinstance(model, RegionalModel) and shutil.which(COMPILE[0]):
        forms[C99] = _in_c(CFace("face", rig.controls, rig.mesh, attachments, model, "", "", ""), folder)
    try:
        forms[SHAPES] = _by_shapes(model, rig, attachments)
    except InputError:  # it has none
        pass
    return forms


def _in_c(face: CFace, folder: Path) -> Form:
    texts = c_files(face, "face")
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="ascii")
    library = folder / "face.so"
    subprocess.run([*COMPILE, "-o", library, folder / "face.c", "-lm"], check=True)
    function, count = ctypes.CDLL(str(library)).face_pose, len(face.mesh.neutral)
    pointer = ctypes.POINTER(ctypes.c_float)

    def evaluate(params: Float[np.ndarray, "1 m"]) -> Float32[np.ndarray, "1 n 3"]:
        pose, out = np.ascontiguousarray(params, np.float32), np.empty((1, count, 3), np.float32)
        function(pose.ctypes.data_as(pointer), out.ctypes.data_as(pointer))
        return out

    return Form(sum(map(len, texts.values())), evaluate)


def _by_shapes(model: Model, rig: Rig, attachments: Attachments) -> Form:
    face = shaped_face(model, rig.mesh, attachments, rig.controls)
    written = weights_model(face).SerializeToString()
    mesh = glb([posed_parts(rig, rig.default)[0]], {}, partial(add_targets, face))
    weights = weights_by_onnx(written)
    return Form(len(written) + len(mesh), lambda params: face.posed(weights(params)))


def deploy_table(rows: Sequence[Row], character: str) -> Table:
    """Return the forms of one character's methods with what each costs and is off."""
    metrics = ("file_size", "pose", "times_as_long_as_onnx", "largest_difference", "vertex_error")
    names = dict.fromkeys(row.method for row in rows if row.table == TABLE and row.character == character)
    lines = []
    for name in names:
        for form in FORMS:
            found = [find(rows, TABLE, character, name, f"{metric}[{form}]") for metric in metrics]
            if any(found):
                off = found[3]
                cells = [*map(our_value, found[:3]), f"{off.value:.1g}" if off else "–", our_value(found[4])]
                lines.append((name, (method_named(name).label, form, *cells)))
    header = ("", "", "files, MB", "ms a pose", "× ONNX", "largest difference, mm", "error, mm")
    notes = (
        "Files: C99 is its source; shapes are the GLB that has them, and the network to their weights.",
        "Ms: on one core, the 5th percentile of the times. Shapes: ONNX Runtime for the weights, then NumPy.",
        "Largest difference from what the suite gives; error: mean distance from the rig's vertices in test poses.",
    )
    return Table(f"What leaves the suite: {character}", (header,), in_groups(lines), notes, text_columns=2)


def forms_card(rows: Sequence[Row]) -> Table:
    """Return the forms of all characters' methods in one table, for a page."""
    characters = dict.fromkeys(row.character for row in rows)
    tables = {character: deploy_table(rows, character) for character in characters}
    lines = [(character, (character, *line)) for character, table in tables.items() for line in table.body if line]
    some = next(iter(tables.values()))
    return Table("What leaves the suite", (("", *some.headers[0]),), in_groups(lines), some.notes, text_columns=3)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Measure the forms in which models leave the suite.", profile="whose trainings")
    help = f"names (default: those with models in the repository, else {' '.join(OTHERWISE)})"
    parser.add_argument("--methods", nargs="+", default=[], help=help)
    add_count(parser, "rounds", EVALUATIONS, "poses that each form is timed on")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    named = " ".join(options.methods).replace(",", " ").split()
    choose(named or OTHERWISE)
    measured: Callable[[Config], list[Row]] = partial(measure, named=named, evaluations=options.rounds)
    why = "for the true vertices of its test poses"
    bench_characters(TABLE, measured, deploy_table, options, command_line, rig_use=why)


if __name__ == "__main__":
    sys.exit(main())
