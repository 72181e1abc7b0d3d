"""Measure a method of your own on poses of `tiny` that it has never seen, and give it a row of the leaderboard.

    python course/project/leaderboard.py mine.py --name Ada --to rows.csv

The first time takes about a minute of one core; what is made is kept in the cache. README.md says what counts.
"""

import argparse
import ast
import json
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:  # the project's folder, wherever this is run from
    sys.path.insert(0, str(ROOT))

from replicate.base.command_line import run
from replicate.base.exceptions import InputError
from replicate.base.files import check_writable
from replicate.base.paths import settle_folders
from replicate.base.tables import Column, read_csv, write_csv
from replicate.base.user_files import check_output_file, read_text, shown_path, whole_number
from replicate.config import LARGEST_SEED, Config, resolve
from replicate.engine import scheduler
from replicate.engine.provenance import core_count, provenance
from replicate.engine.stage import Stage, StageContext, in_order, stream_rng
from replicate.engine.store import artefact_folder, lock, read_manifest
from replicate.methods import artefacts, measurement
from replicate.methods.method import Method
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan, reference
from replicate.report.tables import Table, as_text, round_off

LEADERBOARD = Path(__file__).with_name("leaderboard.csv")
GIVEN = "given"  # in place of a student's name: what every method is compared with


# The rule, first part: what a method's file must not name, and how long it may be.

MOST_LINES = 30
MOST_BYTES = 100_000
_TEST = "the test poses are for measuring alone; choose on the validation poses"
_RIG = "a method learns from samples of the rig, never from the rig itself"
FORBIDDEN = {
    **dict.fromkeys(("test_params", "test_offsets"), _TEST),
    **dict.fromkeys(("load_rig", "rig_of", "build_rig", "make_rig", "data_recipes"), _RIG),
}


def check_source(file: Path) -> int:
    """Return how many lines of code a method's file has.

    A statement is a line, however it is broken; blank lines, comments and docstrings don't count. Raises InputError for
    a file that can't be read, has more than `MOST_LINES`, names what is `FORBIDDEN`, or imports a file beside it.
    """
    try:
        tree = ast.parse(read_text(file, MOST_BYTES))
    except (SyntaxError, ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{shown_path(file)}: expected Python, got something else ({error})") from None
    for node in ast.walk(tree):
        for name in _names(node):
            if name in FORBIDDEN:
                raise InputError(f"{shown_path(file)}, line {node.lineno}: it names {name}, but {FORBIDDEN[name]}")
            if isinstance(node, ast.alias | ast.ImportFrom) and file.with_name(f"{name}.py").is_file():
                raise InputError(
                    f"{shown_path(file)}, line {node.lineno}: it imports {name}.py, but a method is one file"
                )
    count = _lines(tree)
    if count > MOST_LINES:
        rest = "blank lines, comments and docstrings don't count"
        raise InputError(f"{shown_path(file)}: expected at most {MOST_LINES} lines of code, got {count}; {rest}")
    return count


def _names(node: ast.AST) -> list[str]:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return [name]
        case ast.alias(name=name) | ast.ImportFrom(module=str(name)):
            return name.split(".")
    return []


def _lines(tree: ast.Module) -> int:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            del node.body[0]
    return sum(bool(line.strip()) for line in ast.unparse(tree).splitlines())


# The rule, second part: what a method can read. Its test poses are decoys, and its rig is a mesh without a rig.


class OpenPlan(Plan):
    """The plan that a method under measurement gets; the names of its stages are those of any plan.

    hidden: the stage that holds the poses that methods are measured on; it is in no method's inputs.
    closed: the stages that no method may read.
    """

    def __init__(self, config: Config):
        super().__init__(config)
        whole = Plan(config)
        rig, samples = artefacts.rig_stage(whole), artefacts.samples_stage(whole)
        self._stages["influence"] = artefacts.influence_stage(whole)
        self.stage("rig", copy_mesh, None, rig, per_seed=False)
        self.stage("samples", put_decoys, self.settings(None), samples)
        self.hidden = whole.stage("hidden", hide_poses, self.settings(None), samples)
        self._open = tuple(self._stages.values())
        self.closed = (rig, samples, self.hidden)

    def stages_of(self, method: Method) -> tuple[Stage, ...]:
        """Return a method's stages; raise InputError if one of them reads what is closed."""
        stages, closed = method.stages(self), {stage.identifier for stage in self.closed}
        for stage in in_order([*stages]):
            if stage.identifier in closed:
                continue
            if stage not in self._open and closed & {source.identifier for source in stage.inputs}:
                raise InputError(f"method {method.name}: its stage {stage.name} reads what methods must not: {_RIG}")
        return stages


def copy_mesh(context: StageContext) -> None:
    """Write the artefact "rig" without the rig: the neutral mesh alone."""
    shutil.copyfile(context.inputs["rig"] / "mesh.npz", context.out / "mesh.npz")


def put_decoys(context: StageContext) -> None:
    """Write the artefact "samples" with half of the test poses: the decoys."""
    samples, folder = artefacts.load_samples(context.inputs), context.inputs["samples"]
    for name in ("params", "offsets", "steps", "bins", "validation_params", "validation_offsets"):
        shutil.copyfile(folder / f"{name}.npy", context.out / f"{name}.npy")
    decoys, _ = halves(samples.test_params, context.config.seed)
    _save_poses(context.out, "test", samples, decoys)
    facts = json.dumps(samples.facts | {"test_poses": len(decoys)}, indent=1)
    (context.out / "samples.json").write_text(facts + "\n", encoding="utf-8")


def hide_poses(context: StageContext) -> None:
    """Write the other half of the test poses, which methods are measured on."""
    samples = artefacts.load_samples(context.inputs)
    _save_poses(context.out, "hidden", samples, halves(samples.test_params, context.config.seed)[1])


def _save_poses(folder: Path, part: str, samples: object, poses: np.ndarray) -> None:
    np.save(folder / f"{part}_params.npy", samples.test_params[poses])
    np.save(folder / f"{part}_offsets.npy", samples.test_offsets[poses])


def halves(params: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of two random halves of the unique test poses: decoys, and hidden ones."""
    from replicate.approximation.metrics import unique_poses

    poses = unique_poses(np.asarray(params))
    order = stream_rng(seed, "project", "halves").permutation(len(poses))
    return np.sort(poses[order[: len(poses) // 2]]), np.sort(poses[order[len(poses) // 2 :]])


# A method's numbers, and the rule's third part: it must be as far off on poses that it could read as on hidden ones.

SCORE = "score.json"
TIMED = 200  # poses, one at a time
LEAST_RATIO = 0.7  # of the errors; 2,000 random halves gave 0.84 to 1.19 for four methods that had seen neither
EXACT_DEG = 0.02  # only the rig is so near itself


@dataclass(frozen=True)
class Score:
    """A method's mean errors on hidden poses, on decoys, its size if it states one, and the median time of a pose."""

    normal_deg: float
    vertex_mm: float
    decoys_deg: float
    size_mb: float | None
    pose_ms: float


def score_stage(plan: OpenPlan, method: Method) -> Stage:
    """Return the stage that measures a method. Raises InputError if one of its stages reads what is closed."""
    settings = measurement.measurement_settings(method, plan.config)
    called = (score, *measurement.reading(method, plan.config).sources)
    shared = (artefacts.rig_stage(plan), artefacts.samples_stage(plan), artefacts.rigid_stage(plan))
    inputs = {stage.title: stage for stage in (plan.hidden, *shared, *plan.stages_of(method))}
    return plan.stage(f"score_{method.name}", ", ".join(map(reference, called)), settings, *inputs.values())


def score(context: StageContext) -> None:
    """Measure a method on hidden poses and on decoys, by one thread; it gets all inputs but the hidden poses."""
    from replicate.approximation.metrics import evaluate, summary

    settings = context.config
    hidden = [np.load(context.inputs["hidden"] / f"hidden_{name}.npy") for name in ("params", "offsets")]
    inputs = {name: folder for name, folder in context.inputs.items() if not name.startswith("hidden")}
    predict = measurement.predictor(settings, inputs)
    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
    decoys = [np.asarray(samples.test_params), np.asarray(samples.test_offsets)]
    ours, theirs = (evaluate(mesh, *poses, {"": predict}, batch=settings.batch)[""] for poses in (hidden, decoys))
    milliseconds = []
    for pose in hidden[0][:TIMED, None]:
        start = time.perf_counter()
        predict(pose, None)
        milliseconds.append(1e3 * (time.perf_counter() - start))
    own = inputs.get(settings.method)
    size = read_manifest(own)["notes"].get("size_mb") if own else None
    means = (summary(tally).mean for tally in (ours.normal, ours.vertex, theirs.normal))
    found = Score(*means, size, float(np.median(milliseconds)))
    (context.out / SCORE).write_text(json.dumps(vars(found)) + "\n", encoding="utf-8")


def measure(method: Method, seed: int) -> Score:
    """Make a method's stages and return its numbers; raise InputError for a method that breaks the rule."""
    if method.oracle:
        raise InputError(f"method {method.name}: it is an oracle, which gets the true mesh: {_RIG}")
    stage = score_stage(OpenPlan(resolve("tiny", "quick", seed=seed)), method)
    facts = provenance(["python", *sys.orig_argv[1:]], "quick", [seed], core_count())
    scheduler.run([stage], facts=facts)
    found = Score(**json.loads((artefact_folder(stage.identifier) / SCORE).read_text(encoding="utf-8")))
    check_score(method.name, found)
    return found


def check_score(name: str, found: Score) -> None:
    """Raise InputError for a method that can't be so good without breaking the rule."""
    if found.normal_deg < EXACT_DEG:
        raise InputError(
            f"method {name}: its normal error is {found.normal_deg:.4f}°, as only the rig's can be, but {_RIG}"
        )
    if found.decoys_deg < LEAST_RATIO * found.normal_deg:
        raise InputError(
            f"method {name}: its normal error is {found.decoys_deg:.2f}° on the test poses that it could read, and "
            f"{found.normal_deg:.2f}° on hidden ones that are as hard: it has learned the former by heart, but {_TEST}"
        )


# The leaderboard: a CSV file with a row for each name, method and seed.


@dataclass(frozen=True)
class Row:
    """A row of the leaderboard; lines is None for a method of the suite."""

    name: str
    method: str
    seed: int
    normal_error_deg: float
    vertex_error_mm: float
    size_mb: float | None
    pose_ms: float
    lines: int | None


KEY = ("name", "method", "seed")
COLUMNS = (
    Column("name"),
    Column("method"),
    Column("seed", "whole number"),
    Column("normal_error_deg", "finite number"),
    Column("vertex_error_mm", "finite number"),
    Column("size_mb", "finite number", optional=True),
    Column("pose_ms", "finite number"),
    Column("lines", "whole number", optional=True),
)


def read_rows(file: Path) -> list[Row]:
    """Return a leaderboard's rows; a file that isn't there yet begins with the given ones."""
    if not file.exists() and file != LEADERBOARD:
        return [row for row in read_rows(LEADERBOARD) if row.name == GIVEN]
    frame = read_csv(file, COLUMNS, KEY, "there is no such file").astype(object)
    return [Row(*line) for line in frame.where(frame.notna(), None).itertuples(index=False)]


def put_row(file: Path, row: Row) -> list[Row]:
    """Put a row into a leaderboard, in place of an earlier one, and return all rows, the best first."""
    with lock("leaderboard"):
        rows = {(other.name, other.method, other.seed): other for other in read_rows(file)}
        rows[row.name, row.method, row.seed] = row
        best_first = sorted(rows.values(), key=lambda each: (each.seed, each.normal_error_deg, each.name))
        write_csv(file, COLUMNS, map(astuple, best_first), KEY)
    return best_first


def in_words(rows: Sequence[Row], seed: int) -> str:
    """Return the rows of one seed as a table, the best first."""
    headers = ("name", "method", "normal error [°]", "vertex error [mm]", "size [MB]", "time a pose [ms]", "lines")
    body = tuple(tuple(_cells(row)) for row in rows if row.seed == seed)
    return as_text(Table(f"tiny, hidden poses, seed {seed}", (headers,), body, text_columns=2))


def _cells(row: Row) -> Iterator[str]:
    yield from (row.name, row.method)
    numbers = (row.normal_error_deg, row.vertex_error_mm, row.size_mb, row.pose_ms)
    yield from map(round_off, numbers, ("deg", "mm", "MB", "ms"))
    yield round_off(row.lines, "count")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure a method, write its row and print the leaderboard. Raises InputError for whatever is wrong with it."""
    parser = argparse.ArgumentParser(
        prog="python course/project/leaderboard.py",
        description="Measure a method on poses of tiny that it has never seen, write its row, and print all rows.",
        epilog="A file is checked beforehand: 30 lines, no test poses, no rig. README.md says why.",
    )
    parser.add_argument("method", help="a file with a METHOD, such as mine.py; or a method of the suite, such as pca")
    parser.add_argument("--name", required=True, help="whose row it is; an earlier one of the method is replaced")
    parser.add_argument("--seed", default="0", help="of samples, hidden poses and training (default: %(default)s)")
    parser.add_argument(
        "--to",
        type=Path,
        default=LEADERBOARD,
        metavar="FILE",
        help="the CSV file (default: the course's own leaderboard.csv, which git tracks)",
    )
    options = parser.parse_args(arguments)
    # whatever can be wrong is found before a minute of work
    settle_folders()
    seed = whole_number(options.seed, "--seed", 0, LARGEST_SEED)
    name = " ".join(options.name.split())
    if not 0 < len(name) <= 40 or not name.isprintable():
        raise InputError(f"--name: expected a name of at most 40 letters, got {options.name!r}")
    file = options.to.expanduser().absolute()
    check_output_file(file)
    if not file.parent.is_dir():
        raise InputError(f"--to: there is no folder {shown_path(file.parent)}")
    check_writable(file.parent, "--to")
    read_rows(file)
    lines = check_source(Path(options.method).expanduser()) if options.method.endswith(".py") else None
    found = choose([options.method])
    if len(found) != 1:
        raise InputError(f"{options.method}: expected one method, got {len(found)}")
    score = measure(found[0], seed)
    row = Row(
        name,
        found[0].name,
        seed,
        round(score.normal_deg, 4),
        round(score.vertex_mm, 4),
        score.size_mb and round(score.size_mb, 3),
        round(score.pose_ms, 3),
        lines,
    )
    if lines is not None and score.size_mb is None:
        print(
            f"{found[0].name}: it has no size; call context.note(size_mb=…) in a stage that is named like the method",
            file=sys.stderr,
        )
    print("\n" + in_words(put_row(file, row), seed))


if __name__ == "__main__":
    sys.exit(run("course.project.leaderboard:main"))
