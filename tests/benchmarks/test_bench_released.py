"""The released recipe taken apart: each training changes what it says and nothing else, and is a line of the table."""

from dataclasses import asdict

import pytest

from replicate.benchmarks import bench_regional, bench_released
from replicate.benchmarks.bench_released import (
    ALPHAS,
    CHANGES,
    GRID,
    PIECES,
    SCALINGS,
    SECTIONS,
    alpha_chart,
    released_tables,
    variants,
)
from replicate.config import resolve
from replicate.report.results import Row


def flat(section) -> dict:
    keys = {}
    for name, value in asdict(section).items():
        keys |= {f"{name}.{key}": each for key, each in value.items()} if isinstance(value, dict) else {name: value}
    return keys


@pytest.fixture(scope="module")
def sections():
    return {(v.method, v.change): flat(getattr(v.config, v.method)) for v in variants("tiny", "laptop", 700)}


@pytest.mark.parametrize("method", SECTIONS)
def test_the_two_recipes_are_those_of_the_rows(sections, method):
    ours = flat(getattr(resolve("tiny", "laptop"), method))
    theirs = flat(SECTIONS[method]("laptop"))
    for change, expected in (("ours", ours), ("released", theirs)):
        assert sections[method, change] == expected | {"training.steps": 700}
    more = sections.get((method, "released, 4 times the steps"))
    assert more == (sections[method, "released"] | {"training.steps": 2_800} if method == "dense" else None)


@pytest.mark.parametrize("method, change", [(m, c) for m, words in CHANGES.items() for c in words if ", but " in c])
def test_a_change_is_of_its_piece_alone(sections, method, change):
    base, other = ("ours", "released") if change.startswith("ours") else ("released", "ours")
    here, before, after = sections[method, change], sections[method, base], sections[method, other]
    differing = {key for key in here if here[key] != before[key]}
    piece = next(keys for name, keys in PIECES.items() if f", but {name} as " in change)
    assert differing and differing <= set(piece)
    assert all(here[key] == after[key] for key in piece)


def test_all_pieces_together_make_one_recipe_of_the_other(sections):
    ours, theirs = sections["dense", "ours"], sections["dense", "released"]
    differing = {key for key in ours if ours[key] != theirs[key]}
    assert differing == {key for keys in PIECES.values() for key in keys}


@pytest.mark.parametrize("method", SECTIONS)
def test_weights_of_normals_are_tried_with_our_scaling_and_with_none(sections, method):
    ours = sections[method, "ours"]
    assert sections[method, "α = 5, scaled"] == ours
    for scaling in SCALINGS:
        assert [sections[method, f"α = {alpha}, {scaling}"]["normal_weight"] for alpha in ALPHAS] == [*ALPHAS]
    plain = sections[method, "α = 750, in mm"]
    differing = {key for key in ours if ours[key] != plain[key]}
    assert differing == {"normal_weight", "conditioning.inputs", "conditioning.unit_mm"}


def test_the_chart_against_alpha_has_a_line_for_each_network_and_scaling():
    metrics = {"validation_normal_error": "deg", "validation_vertex_error": "mm"}
    rows = [
        row(method, f"{metric}[{change}]", unit, 1.0 + place)
        for metric, unit in metrics.items()
        for place, (method, change) in enumerate((m, c) for m in SECTIONS for c in GRID)
    ]
    figure, words = alpha_chart(rows, "toon")
    assert [len(axes.lines) for axes in figure.axes] == [4, 4]
    assert "α = 5, scaled: 9.00° and 1.00°" in words.alt


def row(method, metric, unit, value, table="bench_released"):
    return Row(table, "toon", method, metric, unit, value, None, 1, 64, "laptop", "bench-released")


def test_a_training_is_a_line_and_a_method_a_group():
    rows = [
        row("coarse", "validation_normal_error[ours]", "deg", 3.0),
        row("dense", "model_size[released]", "MB", 1.25),
        row("dense", "validation_normal_error[ours]", "deg", 2.0),
        row("dense", "validation_normal_error[released]", "deg", 29.87),
        row("dense", "validation_normal_error[ours]", "deg", 99.0, table="another"),
    ]
    (table,) = released_tables(rows)
    assert table.body == (
        ("Dense", "released", "1.25", "29.87"),
        ("Dense", "ours", "", "2.00"),
        None,
        ("Coarse", "ours", "", "3.00"),
    )


@pytest.mark.parametrize("bench", [bench_released, bench_regional])
def test_a_schedule_without_steps_is_refused(bench, capsys):
    assert bench.main(["--steps", "0"]) == 2
    assert "steps: expected a whole number of at least 1, got 0" in capsys.readouterr().err
