"""Table 1: sizes counted by hand, equal to those of models that are really saved, and the paper's own arithmetic."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from sample_rows import cells_after, table1_rows

from replicate.approximation import cnn
from replicate.approximation.model import SegmentedModel
from replicate.approximation.model_size import (
    MapShape,
    cnn_size_mb,
    cnn_weights,
    dense_size_mb,
    dense_vertices,
    dense_weights,
    megabytes,
)
from replicate.approximation.rigid import Attachments
from replicate.approximation.segments import Segment, save_segments
from replicate.base.paths import PAPER
from replicate.baselines import dense
from replicate.config import CoarseConfig, DenseConfig, RefinementConfig
from replicate.geometry.mesh import Mesh
from replicate.report.results import STANDS_FOR, characters_of, find, read_results, write_results
from replicate.report.tables import as_markdown, as_text
from replicate.targets.compare import compare
from replicate.targets.table1.tables import (
    COUNTS,
    WIDTHS,
    SizeSettings,
    bracket,
    implied_vertices,
    ratio_chart,
    rows_of,
    size_claim,
    size_ratio,
    sizes_mb,
    table1,
)

THEIRS = read_results(PAPER / "table1.csv")
SHAPES = [MapShape(c.map_size, c.channels, c.hidden) for c in (CoarseConfig(), RefinementConfig())]
SMALL = MapShape(map_size=16, channels=2, hidden=(3, 128))


def segments(counts: list[tuple[int, int]]) -> list[Segment]:
    """Return segments of (vertices, parameters) each, one behind the other."""
    generator, parts, start = np.random.default_rng(0), [], 0
    for k, (vertices, parameters) in enumerate(counts):
        where = np.arange(start, start + vertices, dtype=np.int32)
        uv = generator.random((vertices, 2), dtype=np.float32)
        parts.append(Segment(f"part_{k}", where, uv, np.arange(parameters, dtype=np.int32)))
        start += vertices
    return parts


def saved_weights(model: SegmentedModel, folder, save, config) -> int:
    """Save a model and return how many trained weights its file holds."""
    save(model, folder, config)
    arrays = load_file(folder / "weights.safetensors")
    assert {array.dtype for name, array in arrays.items() if name.startswith("networks.")} == {torch.float32}
    return sum(array.numel() for name, array in arrays.items() if name.startswith("networks."))


def test_weights_of_small_networks_are_those_counted_by_hand():
    # 5 → 3 → 128 = 8×8×2; a 3×3 convolution 2 → 2 after the upsampling to 16×16, one more, and 1×1 to three channels
    assert cnn_weights(5, SMALL) == (15 + 3) + (384 + 128) + 2 * (9 * 2 * 2 + 2) + (2 * 3 + 3)
    assert dense_weights(5, 4, (3, 2)) == (15 + 3) + (6 + 2) + (2 * 12 + 12)
    assert cnn_weights(0, CoarseConfig()) == 256 + (256 * 512 + 512) + 1168 + 2 * 2320 + 51
    assert cnn_weights(7, RefinementConfig()) - cnn_weights(7, CoarseConfig()) == 2320
    assert megabytes(250_000) == 1.0


@pytest.mark.parametrize("config", [CoarseConfig(), RefinementConfig(), CoarseConfig(map_size=64, hidden=(8, 128))])
def test_a_saved_cnn_is_as_large_as_counted(tmp_path, config):
    parts = segments([(5, 3), (40, 11)])
    facts = cnn.shape_facts(config)
    model = SegmentedModel([cnn.make_network(s, facts) for s in parts], parts, np.ones(11), [1.0, 1.0], 45)
    count = sum(cnn_weights(len(part.parameters), config) for part in parts)
    assert saved_weights(model, tmp_path, cnn.save, config) == count
    assert model.size_mb() == pytest.approx(megabytes(count), rel=1e-12)


@pytest.mark.parametrize("hidden", [*WIDTHS.values(), (7,)])
def test_a_saved_dense_model_is_as_large_as_counted(tmp_path, hidden):
    parts, config = segments([(5, 3), (40, 11)]), DenseConfig(hidden=hidden)
    networks = [dense.make_network(s, dense.shape_facts(config)) for s in parts]
    model = SegmentedModel(networks, parts, np.ones(11), [1.0, 1.0], 45)
    assert saved_weights(model, tmp_path, dense.save, config) == sum(
        dense_weights(len(s.parameters), len(s.vertices), hidden) for s in parts
    )
    assert model.size_mb() == pytest.approx(dense_size_mb([3, 11], [5, 40], hidden), rel=1e-12)


def test_the_vertices_that_a_dense_size_implies_are_those_it_was_made_of():
    size = dense_size_mb([99] * 6, [800] * 6, (256, 512))
    assert dense_vertices(size, 6, 99, (256, 512)) == pytest.approx(4800, rel=1e-9)


@pytest.mark.parametrize(
    ("character", "least", "most"),
    [("Hiccup", 7.75, 11.45), ("Valka", 6.66, 9.91), ("Toothless", 12.71, 19.44), ("Ray", 4.99, 5.90)],
)
def test_the_papers_counts_bracket_its_cnn_sizes(character, least, most):
    sizes = bracket(THEIRS, character)
    assert [round(size, 2) for size in sizes] == [least, most]
    assert sizes[0] < find(THEIRS, "table1", character, "refined", "model_size").value < sizes[1]


def test_the_papers_dense_size_for_ray_does_not_fit_the_widths_of_the_text():
    vertices = find(THEIRS, "table1", "Ray", "model", "vertices").value
    assert min(implied_vertices(THEIRS, "Ray", "dense")) > vertices
    fewest, most = implied_vertices(THEIRS, "Ray", "dense_released")
    assert 3300 < fewest < most < 3420 < vertices
    for character in ("Hiccup", "Valka", "Toothless"):
        fewest, most = implied_vertices(THEIRS, character, "dense")
        assert 6700 < fewest < most < 8650 < find(THEIRS, "table1", character, "model", "vertices").value


@pytest.fixture
def character(tmp_path):
    """Return (settings, inputs) of a mesh of three segments, one of them rigid, and two refinement segments."""
    owner = np.repeat(np.int32([0, 1, 2]), [6, 4, 3])
    generator = np.random.default_rng(1)
    places = generator.normal(size=(13, 3)).astype(np.float32) * 10
    uv = generator.random((13, 2), dtype=np.float32)
    faces = np.int32([[0, 1, 2], [3, 4, 5], [6, 7, 8], [7, 8, 9], [10, 11, 12]])
    mesh = Mesh(places, faces, uv, owner, ("face", "neck", "tooth"))
    influence = np.zeros((13, 5), bool)
    influence[:6, :3] = influence[6:10, 3] = True
    inputs = {name: tmp_path / f"{name}-mine" for name in ("rig", "influence", "rigid", "selection")}
    for folder in inputs.values():
        folder.mkdir()
    mesh.save(inputs["rig"] / "mesh.npz")
    np.save(inputs["influence"] / "influence.npy", influence)
    none = np.zeros((1, 3))
    Attachments(np.int64([2]), np.int64([[0, 1, 2]]), none, np.zeros(1), none).save(inputs["rigid"] / "attachments.npz")
    save_segments(segments([(4, 2), (3, 1)]), inputs["selection"] / "segments.npz")
    settings = SizeSettings("mine", "quick", *SHAPES)
    return settings, inputs


def test_a_characters_rows_are_counts_of_what_the_stages_found_and_sizes_of_what_they_make(character):
    rows = rows_of(*character)
    value = {(row.method, row.metric): row.value for row in rows}
    assert value["model", "vertices"] == 13 and value["model", "rig_parameters"] == 5
    assert value["model", "rigid_segments"] == 1 and value["model", "deformable_vertices"] == 10
    assert value["coarse", "segments"] == value["refined", "segments"] == 2
    assert value["coarse", "model_size"] == cnn_size_mb([3, 1], [], CoarseConfig(), RefinementConfig())
    assert value["refined", "model_size"] == cnn_size_mb([3, 1], [2, 1], CoarseConfig(), RefinementConfig())
    assert value["dense", "model_size"] == dense_size_mb([3, 1], [6, 4], (256, 256))
    assert value["dense_released", "model_size"] == dense_size_mb([3, 1], [6, 4], (256, 512))
    assert {row.unit for row in rows if "size" in row.metric} == {"MB"} and len({row.run for row in rows}) == 1


def test_a_size_lies_between_that_of_nets_which_see_nothing_and_all():
    coarse, refined = segments([(9, 3), (20, 8)]), segments([(4, 5)])
    sizes = sizes_mb(8, coarse, refined, *SHAPES)
    for method in ("coarse", "refined", *WIDTHS):
        least, size, most = (sizes[method, f"model_size{end}"][1] for end in ("_least", "", "_most"))
        assert least < size < most
    everything = sizes_mb(8, segments([(9, 8), (20, 8)]), segments([(4, 8)]), *SHAPES)
    assert everything["refined", "model_size"] == everything["refined", "model_size_most"]


def test_the_table_shows_ours_beside_the_papers_and_where_the_size_lies():
    text = as_text(table1([*table1_rows("mine"), *table1_rows()], THEIRS))
    assert text.splitlines()[2].split() == ["teen", "Hiccup", "mine"]
    assert cells_after(text, "Vertices ") == ["12,510", "12,510", "12,510"]
    assert cells_after(text, "Refinement segments") == ["3", "4", "3"]
    assert cells_after(text, "CNN, MB") == ["8.00", "8.66", "8.00"]
    assert cells_after(text, "– least–most") == ["7.00–11.00", "7.75–11.45", "7.00–11.00"]
    assert cells_after(text, "– parameters a network sees, mean") == ["25%", "25%", "25%"]
    assert cells_after(text, "Dense over CNN") == ["3.00", "3.00", "3.00"]
    assert cells_after(text, "– implied by dense 256/256") == ["6,704–7,561"]
    markdown = [row for row in as_markdown(table1(table1_rows(), THEIRS)).splitlines() if row.startswith("|")]
    assert len({row.count("|") for row in markdown}) == 1


def test_chosen_lines_alone_are_shown_without_notes_on_the_others():
    table = table1(table1_rows(), THEIRS, COUNTS)
    assert tuple(line[0] for line in table.body) == COUNTS and not any("implied" in note for note in table.notes)


def test_the_chart_of_ratios_has_ours_beside_the_papers():
    figure, words = ratio_chart([*table1_rows(), *table1_rows("mine")], THEIRS)
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["teen (Hiccup)", "mine"]
    assert "teen (Hiccup): 3.00 and 3.00; mine: 3.00 and –" in words.alt and "2 to 5 times" in words.caption


def test_several_seeds_show_their_spread_where_there_is_one():
    rows = [replace(row, seeds=2, sd=0.5 if row.metric == "segments" else 0.0) for row in table1_rows()]
    text = as_text(table1(rows, THEIRS))
    assert cells_after(text, "Refinement segments") == ["3", "±", "0.5", "4"] and cells_after(text, "CNN, MB") == [
        "8.00",
        "8.66",
    ]
    assert "2 seeds" in text


@pytest.mark.parametrize(
    "large, word", [(15.9, "fails on teen"), (16.0, "holds on teen"), (40.1, "more than 5 times on teen is no")]
)
def test_claim_c6_is_judged_by_the_ratio_alone(large, word):
    claim = size_claim(table1_rows(large=large), THEIRS)
    assert word in claim and f"{large / 8:.1f} (teen)" in claim and f"{large / 4:.1f} (teen)" in claim
    assert "3.0 (Hiccup), 3.7 (Valka), 2.4 (Toothless) and 4.8 (Ray)" in claim


def test_claim_c6_names_those_it_holds_on_and_those_it_does_not_and_is_not_tested_without_sizes():
    claim = size_claim([*table1_rows(), *table1_rows("toon", large=8.0)], THEIRS)
    assert "holds on teen and fails on toon" in claim
    assert "not tested" in size_claim([], THEIRS) and size_ratio([], "teen") is None


def test_characters_come_in_the_papers_order():
    assert characters_of([*table1_rows("mine"), *table1_rows("toon"), *table1_rows("teen")]) == ["teen", "toon", "mine"]
    assert list(STANDS_FOR) == ["teen", "woman", "dragon", "toon"]


def test_compare_prints_table_1_without_its_brackets(tmp_path):
    write_results(tmp_path / "table1.csv", table1_rows())
    text = as_text(compare(THEIRS, [], read_results(tmp_path / "table1.csv"), "table1"))
    assert cells_after(text, "  Refined, model_size [MB]") == ["8.66", "–", "8.00", "–"]
    assert cells_after(text, "  Dense, 256 and 512, model_size [MB]") == ["–", "–", "48.00", "–"]
    assert "least" not in text and text.count("──") and text.splitlines().count(text.splitlines()[4]) == 1
