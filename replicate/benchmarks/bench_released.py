"""What makes the dense networks of the paper fail: the recipe of its released code, taken apart.

The paper's dense networks have 5.0 mm and 8.9° on Ray, several times the errors of its CNN. `make bench-released`
trains dense networks as the released code does (`replicate.methods.released`) and with one thing as in ours, then ours
with one thing as released, and the CNN both ways, all at one short schedule. Then both networks with several weights of
normals, with our scaling and without any. Errors are those of the validation poses;
test poses are not used. Trainings are stages in the cache, so that a stopped run goes on where it was.
"""

import sys
from collections.abc import Sequence
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.rigid import attach
from replicate.base.schema import Checked
from replicate.benchmarks.common import add_count, add_only, answer, folders_of, make_parser, save_picture
from replicate.benchmarks.variants import METRICS, SIZE_PT, Variant, compare_variants, variants_tables
from replicate.config import ConditioningConfig, Config, resolve
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.heatmap import middle_line, normal_bar, normal_heat, split_face
from replicate.drawing.panels import DPI, MEASURES, WIDTH, Words, enlarge, tidy
from replicate.drawing.render import render
from replicate.methods import artefacts
from replicate.methods.method_registry import method_named
from replicate.methods.plan import Plan
from replicate.report.pose_record import TRUTH, PoseRecord, clay_surfaces, view_of
from replicate.report.results import Row
from replicate.report.tables import Table

if TYPE_CHECKING:
    import matplotlib.figure


ABOUT = "which part of the released recipe makes the paper's dense networks fail"
WRITES = "results/runs/bench/bench_released.csv, bench_released_<character>.png"
TABLE = "bench_released"
STEPS = 3_000
SECTIONS = {  # of the configuration, by method
    name: method_named(f"{name}_released").default_section for name in ("dense", "coarse")
}
PIECES = {  # of a recipe: the keys of the section that it consists of
    "controls": ("conditioning.inputs",),
    "unit of offsets": ("conditioning.unit_mm",),
    "controls and unit": ("conditioning.inputs", "conditioning.unit_mm"),
    "first weights": ("conditioning.weights",),
    "normal weight": ("normal_weight",),
    "controls, unit and normal weight": ("conditioning.inputs", "conditioning.unit_mm", "normal_weight"),
    "schedule": ("training.schedule", "training.peak_rate"),
    "batch, width and bound": ("training.batch", "hidden", "training.largest_gradient"),
}
OF_COARSE = ("controls and unit", "normal weight", "controls, unit and normal weight")  # pieces tried on the CNN too
MORE = 4  # times the steps, for dense networks once: whether the failure passes


def changes(method: str) -> tuple[str, ...]:
    """Return the trainings of a method in words: each recipe as it is, and with one piece of the other."""
    pieces = tuple(PIECES) if method == "dense" else OF_COARSE
    more = (f"released, {MORE} times the steps",) if method == "dense" else ()
    theirs = (f"released, but {piece} as ours" for piece in pieces)
    return ("released", *more, *theirs, "ours", *(f"ours, but {piece} as released" for piece in pieces))


CHANGES = {method: changes(method) for method in SECTIONS}
ALPHAS = (5, 25, 150, 750)  # from the text's to the released code's, with positions in mm
SCALINGS = {"scaled": ConditioningConfig(), "in mm": ConditioningConfig("raw", 1.0, "he")}
GRID = tuple(f"α = {alpha}, {scaling}" for scaling in SCALINGS for alpha in ALPHAS)


def variants(character: str, profile: str, steps: int) -> list[Variant]:
    """Return all trainings of one character, at a schedule of `steps`."""
    usual = resolve(character, profile)
    return [
        Variant(method, change, resolve(character, profile, {method: table}))
        for method, words in CHANGES.items()
        for change, table in (
            *((change, _overrides(usual, method, change, steps)) for change in words),
            *((change, _weighted(usual, method, change, steps)) for change in GRID),
        )
    ]


def _weighted(usual: Config, method: str, change: str, steps: int) -> dict:
    """Return a method's settings with a weight of normals and a scaling, as a nested table."""
    weight, scaling = change.removeprefix("α = ").split(", ")
    table = _as_table(getattr(usual, method))
    table["training"]["steps"] = steps
    return table | {"normal_weight": float(weight), "conditioning": _as_table(SCALINGS[scaling])}


def _overrides(usual: Config, method: str, change: str, steps: int) -> dict:
    """Return the settings of a method under a change in words, as a nested table."""
    ours, theirs = getattr(usual, method), SECTIONS[method](usual.profile)
    base, other = (ours, theirs) if change.startswith("ours") else (theirs, ours)
    piece = change.partition(", but ")[2].rpartition(" as ")[0]
    table = _as_table(base)
    for key in PIECES.get(piece, ()):
        group, _, name = key.rpartition(".")
        (table[group] if group else table)[name] = _value(other, key)
    table["training"]["steps"] = steps * (MORE if change.endswith(f"{MORE} times the steps") else 1)
    return table


def _as_table(section: Checked) -> dict:
    return {field.name: _plain(getattr(section, field.name)) for field in fields(section)}


def _plain(value: object) -> object:
    if isinstance(value, Checked):
        return _as_table(value)
    return list(value) if isinstance(value, tuple) else value


def _value(section: Checked, key: str) -> object:
    for name in key.split("."):
        section = getattr(section, name)
    return _plain(section)


def released_tables(rows: Sequence[Row]) -> list[Table]:
    """Return a table for each character in `bench_released.csv`."""
    return variants_tables(rows, TABLE, "The released recipe and ours", {m: (*c, *GRID) for m, c in CHANGES.items()})


def alpha_chart(rows: Sequence[Row], character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both errors of CNN and dense networks against α, with our scaling and without any."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    values = {(r.method, r.metric): r.value for r in rows if r.table == TABLE and r.character == character}
    figure = Figure((WIDTH, 0.42 * WIDTH), dpi=DPI, layout="constrained")
    panels, ratios = figure.subplots(1, 2), []
    for axes, metric, (_, _, label) in zip(panels, METRICS, MEASURES, strict=True):
        for method in SECTIONS:
            for scaling, dashes in zip(SCALINGS, ("-", (0, (2, 1.5))), strict=True):
                errors = [values[method, f"{metric}[α = {alpha}, {scaling}]"] for alpha in ALPHAS]
                shown = method_named(method)
                axes.loglog(
                    ALPHAS, errors, "o", linestyle=dashes, color=shown.colour, label=f"{shown.label}, {scaling}"
                )
        axes.set_xticks(ALPHAS, [str(alpha) for alpha in ALPHAS])
        axes.minorticks_off()
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.set_xlabel("α, the weight of normals")
        axes.set_ylabel(label)
        tidy(axes)
        enlarge(axes, SIZE_PT)
    panels[0].legend(frameon=False, fontsize=SIZE_PT - 2)
    for scaling in SCALINGS:
        for alpha in (ALPHAS[0], ALPHAS[-1]):
            coarse, dense = (values[method, f"{METRICS[1]}[α = {alpha}, {scaling}]"] for method in ("coarse", "dense"))
            ratios.append(f"α = {alpha}, {scaling}: {coarse:.2f}° and {dense:.2f}°")
    return figure, Words(
        f"Two line charts of the errors of CNN and dense networks of {character} against α. Normal errors of CNN and "
        f"dense: {'; '.join(ratios)}.",
        f"Errors of {character}'s networks on the validation poses against the weight of normals in Eq. 1: with "
        "controls and offsets scaled as ours are, and with both as they are, in the rig's units and in mm. The rest of "
        "the recipe is ours.",
    )


def draw_faces(variants: Sequence[Variant], rows: Sequence[Row]) -> list[Row]:
    """Draw one pose as the trained variants of one character predict it, if they are all there; return no rows."""
    if not {*SHOWN} <= {(variant.method, variant.change) for variant in variants}:
        return []
    save_picture(f"{TABLE}_{rows[0].character}", released_faces(faces_of(variants)))
    return []


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, "toon", profile="whose samples and settings")
    add_count(parser, "steps", STEPS, "of each training")
    add_only(parser)
    return answer(parser, partial(compare_variants, TABLE, variants, released_tables, afterwards=draw_faces), arguments)


# The released recipe and ours as faces: one pose as dense networks and CNNs of either recipe predict it.

SHOWN = (
    ("dense", "released"),
    ("dense", "released, but controls, unit and normal weight as ours"),
    ("dense", "ours"),
    ("coarse", "released"),
    ("coarse", "ours"),
)
COLUMNS, TALL, LIMIT_DEG = 3, 1.2, 30.0  # faces in a row; a picture's height over its width; the end of the colours


def faces_of(variants: Sequence[Variant]) -> PoseRecord:
    """Return the validation pose of median motion as the trained variants of `SHOWN` predict it.

    Predictions are called "Dense: released", ….
    """
    vertices, by_name = {}, {(variant.method, variant.change): variant for variant in variants}
    for method, change in SHOWN:
        plan = Plan(by_name[method, change].config)
        (stage,) = method_named(method).stages(plan)
        inputs = folders_of((stage, *stage.inputs))
        mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
        row = median_pose(samples.validation_offsets)
        params = np.asarray(samples.validation_params[row : row + 1])
        predicted = mesh.neutral + method_named(method).model(inputs).offsets(params)
        predicted = attach(mesh, artefacts.load_attachments(inputs), predicted)[0]
        vertices[f"{method_named(method).label}: {change}"] = predicted.astype(np.float32)
    vertices[TRUTH] = (mesh.neutral + samples.validation_offsets[row]).astype(np.float32)
    props = tuple(artefacts.load_rig(inputs).pose_props(params[0]))
    return PoseRecord(plan.character, row, mesh.neutral, mesh.faces, vertices, props)


def median_pose(offsets: Float[np.ndarray, "p n 3"]) -> int:
    """Return the index of the pose whose vertices' mean distance from the neutral pose is the median of all poses."""
    motion = [float(np.linalg.norm(pose, axis=1).mean()) for pose in offsets]
    return int(np.argsort(motion, kind="stable")[(len(motion) - 1) // 2])


def released_faces(record: PoseRecord) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the rig's pose, and each prediction as half surface, half normal errors."""
    width = cell_width(COLUMNS)
    height = round(TALL * width)
    view = view_of(record, "front", width / height)
    draw = partial(render, camera=view, width=width, height=height)
    truth = record.vertices[TRUTH]
    cells, phrases = [Cell("the rig", (draw(clay_surfaces(record, TRUTH)),))], []
    for name, vertices in record.vertices.items():
        if name == TRUTH:
            continue
        heat = draw([normal_heat(vertices, truth, record.faces, LIMIT_DEG)])
        line = middle_line(record.neutral, truth, record.faces, view, width, height)
        distance = f"{vertex_error(vertices, truth).mean():.2f} mm"
        angle = f"{np.nanmean(normal_error(vertices, truth, record.faces)):.2f}°"
        cells.append(Cell(name, (split_face(draw(clay_surfaces(record, name)), heat, line),), (distance, angle)))
        phrases.append(f"{name}, {distance} and {angle}")
    bar = partial(normal_bar, limit_deg=LIMIT_DEG, orientation="horizontal")
    figure = face_sheet(cells, COLUMNS, bar)
    return figure, Words(
        f"Six heads in one pose: the rig, then five networks', left half clay, right half normal errors. "
        f"Mean errors: {'; '.join(phrases)}.",
        f"A validation pose of {record.character}, the median by how far it is from the neutral one. Left half of each "
        f"face: the surface; right half: the angle between predicted and true normals, 0° to {LIMIT_DEG:g}°. Below: "
        "the pose's mean errors.",
    )


if __name__ == "__main__":
    sys.exit(main())
