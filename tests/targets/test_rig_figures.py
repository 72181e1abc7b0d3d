"""Figures 5, 7 and 8: every segment has the colour that the legend and the CSV say, every example its numbers."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from plain_rig import PlainRig
from plane import flat_grid

from data_recipes.controls import Control
from data_recipes.rig import Clip
from replicate.approximation.segments import Segment
from replicate.base.exceptions import InputError
from replicate.drawing.prop_surfaces import perceived
from replicate.drawing.rig_views import (
    DISTINCT,
    UNUSED_COLOUR,
    _without_collisions,
    legend_panel,
    open_mouth,
    read_lines,
)
from replicate.geometry.mesh import Mesh
from replicate.report.tables import as_text
from replicate.targets import figure05, figure07, figure08
from replicate.targets.figure05 import clip_kinds, clip_strips, poses_table, save_clips, save_poses, shown_frames
from replicate.targets.figure07 import (
    PARTS,
    RIGID,
    neighbours,
    rigid_errors_chart,
    save_segments_figure,
    segment_palette,
    segments_table,
)
from replicate.targets.figure08 import (
    chart_panels,
    charts_in_rows,
    refinement_colours,
    refinement_table,
    save_refinement_figure,
    segment_lines,
)

NAMES = ("face", "neck", "tooth_1", "tooth_2")


class Plate(SimpleNamespace, PlainRig):
    """A plate of 9 × 9 vertices, 180 mm wide, in four strips; its controls shift it, one opens no mouth."""

    def __call__(self, params):
        return self.mesh.neutral + np.float32([1, 1, 0]) * np.float32(np.sum(params))

    def pose_props(self, params):
        eye = self.mesh.neutral * np.float32(0.1) + np.float32([0, 30, 60])
        return [("eye_left", eye, self.mesh.faces, (0.0, 0.0, 1.0)), ("hair", eye, self.mesh.faces, (1.0, 0.0, 0.0))]


@pytest.fixture
def rig(monkeypatch):
    flat, faces = flat_grid(np.linspace(-90, 90, 9), np.linspace(-90, 90, 9), 40)
    owner = np.repeat(np.int32([0, 1, 2, 3]), [45, 18, 9, 9])
    mesh = Mesh(flat, faces, (flat[:, :2] + 90) / 180, owner, NAMES)
    controls = (
        Control("jaw_open", 0, 0, 2, "jaw"),
        Control("brow", -1, 0, 1, "brow"),
        Control("nod", -4, 0, 4, "head"),
    )
    limits = {
        side: np.float32([getattr(control, side) for control in controls]) for side in ("lower", "default", "upper")
    }
    clips = tuple(
        Clip(name, np.zeros((frames, 3), np.float32))
        for name, frames in (("00_take_joy", 30), ("01_take_fear", 9), ("02_dialogue_joy", 48), ("mine", 5))
    )
    return Plate(name="plate", mesh=mesh, controls=controls, clips=clips, **limits)


def parts(*extents: tuple[int, int]) -> list[Segment]:
    segments = []
    for k, (start, stop) in enumerate(extents):
        uv = np.zeros((stop - start, 2), np.float32)
        segments.append(Segment(f"face_{k + 1}", np.arange(start, stop, dtype=np.int32), uv, np.int32([0, 2])))
    return segments


def test_every_deforming_segment_has_a_colour_of_its_own_and_rigid_neighbours_differ(rig):
    colours = segment_palette(rig.mesh, [2, 3])
    assert colours[0] == DISTINCT[0] and colours[1] in DISTINCT and colours[2:] == [RIGID[0], RIGID[1]]
    assert len(set(DISTINCT)) == len(DISTINCT) >= 19 and not {*RIGID, UNUSED_COLOUR} & set(DISTINCT)
    assert len(set(segment_palette(rig.mesh, []))) == 4


def test_a_part_has_the_same_colour_on_every_character(rig):
    other = replace(rig.mesh, segment_names=("cranium", "face_1", "neck_and_ears", "frill"))
    first, second = segment_palette(rig.mesh, [2, 3]), segment_palette(other, [])
    assert first[0] == second[1] and first[1] == second[2], "face and neck, wherever they stand in the list"
    assert len(set(second)) == 4 and {colour for _, colour in PARTS} <= set(DISTINCT)


def test_neighbours_in_figure_7_have_colours_that_shading_leaves_apart(rig):
    near, colours = neighbours(rig.mesh), perceived(segment_palette(rig.mesh, []))
    np.testing.assert_array_equal(near, near.T)
    touching = rig.mesh.segment[rig.mesh.faces]
    assert near[touching[:, 0], touching[:, 1]].all()
    apart = np.linalg.norm(colours[:, None] - colours, axis=-1)
    assert apart[near & ~np.eye(len(near), dtype=bool)].min() > 60


def test_figure_7_is_saved_with_its_words_and_numbers(rig, tmp_path):
    save_segments_figure(rig, [2, 3], [3.0, 2.0, 0.1, 0.25], tmp_path / "figure07_plate@one")
    lines = read_lines(tmp_path / "figure07_plate@one.csv", figure07.HEADER)
    assert [line["segment"] for line in lines] == list(NAMES)
    assert [int(line["vertices"]) for line in lines] == [45, 18, 9, 9]
    assert sum(int(line["faces"]) for line in lines) == len(rig.mesh.faces)
    assert [line["kind"] for line in lines] == ["deforms", "deforms", "rigid", "rigid"]
    assert [int(line["faces"]) for line in lines] == [80, 32, 16, 0], "a face belongs to the first that it touches"
    assert lines[0]["colour"] == "#f3c300"
    image = Image.open(tmp_path / "figure07_plate@one.png")
    assert image.mode == "RGB"
    words = json.loads((tmp_path / "figure07_plate@one.json").read_text())
    assert image.text["Description"] == words["alt"]
    assert "2 that deform" in words["caption"] and "2 that move rigidly" in words["caption"]
    assert words["caption"].startswith("Mesh segments of plate@one (face in one chart), after Fig. 7: ")
    pixels = np.array(image.convert("RGB")).reshape(-1, 3).astype(int)
    red, _, blue = pixels.T
    yellow, brown = (((red > 130) & (blue < 60)).sum(), ((red < 115) & (red - blue > 25)).sum())
    assert yellow > 1000 and brown > 500 and lines[1]["colour"] == "#654522"
    text = as_text(segments_table(tmp_path / "figure07_plate@one.csv", "plate@one"))
    assert "2 rigid segments together" in text and "tooth_1" not in text and "≤ 0.25" in text


def test_figure_7_names_segments_where_there_is_room_and_shows_the_legends_colours(rig):
    figure, _ = figure07.figure07(rig, [2, 3], "plate", across=300)
    front, *_ = figure.axes
    assert {text.get_text() for text in front.texts} <= {"face", "neck"}
    (label,) = [text for text in front.texts if text.get_text() == "face"]
    x, y = (round(place) for place in label.get_position())
    shown = front.images[0].get_array()[y - 3 : y + 4, x - 3 : x + 4].reshape(-1, 3)
    legend = perceived([segment_palette(rig.mesh, [2, 3])[0]])
    assert np.linalg.norm(perceived(shown.tolist()) - legend, axis=-1).max() < 25


def test_labels_that_would_cover_others_or_leave_the_picture_are_left_out():
    labels = [(150, 100, "first"), (160, 104, "covers it"), (150, 140, "below"), (4, 200, "cut off")]
    assert [text for _, _, text in _without_collisions(labels, 300)] == ["first", "below"]


def test_each_segments_error_stands_against_tau_the_most_rigid_first(rig):
    figure, words = rigid_errors_chart(rig.mesh, np.array([3.0, 2.0, 0.1, 0.25]), [2, 3], 0.3, "plate")
    (axes,) = figure.axes
    (dots,) = axes.collections
    np.testing.assert_allclose(dots.get_offsets(), [[0.1, 0], [0.25, 0], [2.0, 1], [3.0, 2]])
    palette = np.array(segment_palette(rig.mesh, [2, 3])) / 255
    np.testing.assert_allclose(dots.get_facecolor()[:, :3], palette[[2, 3, 1, 0]])
    assert [label.get_text() for label in axes.get_yticklabels()] == ["2 rigid", "neck", "face"]
    assert [text.get_text() for text in axes.texts] == ["τ = 0.3 mm"]
    assert "each segment of plate (face in one chart) is" in words.caption
    assert "rigid one is 0.25 mm" in words.caption and "deforming one is 2 mm" in words.caption


def test_without_rigid_segments_the_table_of_figure_7_has_no_line_for_them(rig, tmp_path):
    save_segments_figure(rig, [], [1.0] * 4, tmp_path / "figure07_plate")
    text = as_text(segments_table(tmp_path / "figure07_plate.csv", "plate"))
    assert "rigid" not in text and "tooth_2" in text


def test_figure_8_colours_faces_that_touch_a_segment_and_leaves_the_rest_grey(rig):
    colours = refinement_colours(rig.mesh, parts((0, 18), (36, 45)))
    first, second = (rig.mesh.faces < 18).any(1), ((rig.mesh.faces >= 36) & (rig.mesh.faces < 45)).any(1)
    assert not (first & second).any() and 0 < first.sum() < len(first)
    assert (colours[first] == DISTINCT[0]).all() and (colours[second] == DISTINCT[1]).all()
    assert (colours[~first & ~second] == UNUSED_COLOUR).all()


def test_figure_8_draws_each_square_in_its_chart(rig):
    segments = parts((0, 18), (27, 36))
    segments.append(replace(segments[0], name="neck_1", vertices=np.arange(45, 54, dtype=np.int32)))
    colours = refinement_colours(rig.mesh, segments)
    face, neck = chart_panels(rig.mesh, segments, colours, 120)
    assert face.shape == neck.shape and face.shape[1] == 120 < face.shape[0], "a title stands above a square"
    shown = [[(picture == colour).all(-1).sum() for colour in DISTINCT[:3]] for picture in (face, neck)]
    assert min(shown[0][:2]) > 100 and shown[0][2] == 0
    assert shown[1][2] > 50 and shown[1][:2] == [0, 0]
    dark = (face < 60).all(-1)
    assert dark.any(0).sum() > 60, "the squares have outlines"


def test_charts_stand_in_rows_of_four():
    pictures = [np.full((20, 10, 3), 10 * k, np.uint8) for k in range(5)]
    first, second = charts_in_rows(pictures)
    assert first.shape == second.shape == (20, 40, 3)
    assert first[0, ::10, 0].tolist() == [0, 10, 20, 30] and second[0, ::10, 0].tolist() == [40, 255, 255, 255]
    assert charts_in_rows([]) == []


def test_the_lines_of_figure_8_add_up_to_the_mesh_and_to_all_of_the_error(rig, tmp_path):
    errors = np.zeros(81)
    errors[:18], errors[27:36], errors[40] = 4.0, 1.0, 19.0
    segments = parts((0, 18), (27, 36))
    lines = [dict(zip(figure08.HEADER, line, strict=True)) for line in segment_lines(rig.mesh, segments, errors)]
    assert [line["segment"] for line in lines] == ["face_1", "face_2", "unused"]
    assert sum(line["vertices"] for line in lines) == 81 and lines[0]["chart"] == "face"
    assert [line["error_share"] for line in lines] == pytest.approx([0.72, 0.09, 0.19])
    assert [line["map_error_mm"] for line in lines] == pytest.approx([2.0, 1.0, (19 / 54) ** 0.5])
    assert (lines[0]["u_low"], lines[0]["u_high"], lines[0]["v_low"], lines[0]["v_high"]) == (0.0, 1.0, 0.0, 0.125)
    save_refinement_figure(rig, segments, errors, tmp_path / "figure08_plate")
    text = as_text(refinement_table(tmp_path / "figure08_plate.csv", "plate"))
    assert "0.00–0.12" in text and "72%" in text and "–" in text.splitlines()[-1]
    caption = json.loads((tmp_path / "figure08_plate.json").read_text())["caption"]
    assert "72% in face, square 1; 9% in face, square 2" in caption
    assert "coloured if it touches a refined vertex" in caption
    assert caption.startswith("Refinement segments of plate (face in one chart), after Fig. 8: ")


def test_figure_5_is_saved_with_every_control_that_a_pose_uses(rig, tmp_path):
    params = np.float32([[4, 0, 0], [0, -1, 2], [1, 0.5, -6], [0, 0, 1]])
    save_poses(rig, params, np.array([3, 5, 8, 9]), tmp_path / "figure05_plate")
    lines = read_lines(tmp_path / "figure05_plate.csv", figure05.POSES_HEADER)
    rows = [(line["pose"], line["sample"], line["control"], float(line["value"])) for line in lines]
    assert rows == [
        ("1", "3", "jaw_open", 4.0), ("2", "5", "brow", -1.0), ("2", "5", "nod", 2.0), ("3", "8", "jaw_open", 1.0),
        ("3", "8", "brow", 0.5), ("3", "8", "nod", -6.0), ("4", "9", "nod", 1.0),
    ]  # fmt: skip
    caption = json.loads((tmp_path / "figure05_plate.json").read_text())["caption"]
    assert "each uses 1 to 3 of 3 controls" in caption and "0 to 1 of them lie beyond" in caption and "Eq. 5" in caption
    body = poses_table(tmp_path / "figure05_plate.csv", "plate").body
    assert body[0] == ("1 (sample 3)", "1", "1", "jaw_open 2.0")
    assert body[2] == ("3 (sample 8)", "3", "1", "nod 1.5, brow 0.5, jaw_open 0.5")
    without = Plate(**(vars(rig) | {"clips": None}))
    save_poses(without, params, np.arange(4), tmp_path / "figure05_plate")
    caption = json.loads((tmp_path / "figure05_plate.json").read_text())["caption"]
    assert "uniformly" in caption and "Eq. 5" not in caption


def test_a_strip_is_drawn_of_the_first_clip_of_each_kind(rig, tmp_path):
    kinds = clip_kinds(rig.clips)
    assert {kind: clip.name for kind, clip in kinds.items()} == {
        "take": "00_take_joy", "dialogue": "02_dialogue_joy", "clip": "mine",
    }  # fmt: skip
    frames = shown_frames(kinds["dialogue"])
    assert len(frames) == 6 and frames[0] > 0 and frames[-1] < 47 and (np.diff(frames) >= 4).all()
    figure, words = clip_strips(rig, width=30, height=30)
    assert sum(bool(axes.images) for axes in figure.axes) == 18 and "4 clips in all" in words.caption
    save_clips(rig, tmp_path / "figure05_plate_clips")
    lines = read_lines(tmp_path / "figure05_plate_clips.csv", figure05.CLIPS_HEADER)
    assert len(lines) == 18 and lines[6]["kind"] == "dialogue"
    assert float(lines[6]["time_s"]) == pytest.approx(int(lines[6]["shown_frame"]) / 24)


def test_a_mouth_is_opened_by_the_controls_that_do_it(rig):
    np.testing.assert_allclose(open_mouth(rig), [1.6, 0, 0])
    plain = Plate(**(vars(rig) | {"controls": tuple(Control(f"c{k}", -1, 0, 1, "x") for k in range(3))}))
    np.testing.assert_array_equal(open_mouth(plain), rig.default)


def test_a_legend_shows_each_colour_and_several_in_one_square():
    picture = legend_panel([("one", [(200, 0, 0)]), ("two", [(0, 200, 0), (0, 0, 200)]), ("three", ())], "", 240)
    assert picture.shape[1] == 240 and picture.dtype == np.uint8
    for colour in ((200, 0, 0), (0, 200, 0), (0, 0, 200)):
        assert (picture == colour).all(-1).sum() > 60


def test_a_legend_has_as_many_columns_as_its_texts_leave_room_for():
    entries = [("a name", [(200, 0, 0)])] * 12
    wide, narrow, long = (
        legend_panel(entries, "", 840),
        legend_panel(entries, "", 210),
        legend_panel([*entries, ("a name that fills the line", ())], "", 840),
    )
    assert wide.shape[0] < narrow.shape[0] < long.shape[0]
    assert legend_panel(entries, "what it is", 840).shape[0] > wide.shape[0], "a heading has a line of its own"
    reds = [np.flatnonzero((picture == (200, 0, 0)).all(-1).any(0)) for picture in (wide, narrow)]
    assert [1 + (np.diff(columns) > 1).sum() for columns in reds] == [4, 1]


def test_numbers_that_are_missing_or_no_such_table_are_named(tmp_path):
    file = tmp_path / "figure07_plate.csv"
    with pytest.raises(InputError, match=r"figure07_plate.csv: there is no such file; `make figure07` writes it"):
        segments_table(file, "plate")
    file.write_text("segment\nface\n")
    with pytest.raises(InputError, match=r"line 1: expected the header .*, got 'segment'"):
        segments_table(file, "plate")
    file.write_text(",".join(figure07.HEADER) + "\nface\n")
    with pytest.raises(InputError, match="line 2: expected 6 cells, got 1"):
        segments_table(file, "plate")


def test_missing_numbers_name_the_target_that_writes_them_whatever_its_length(tmp_path):
    for target, name in (("lbs", "lbs_teen.csv"), ("figure05", "figure05_teen_clips.csv")):
        with pytest.raises(InputError, match=f"{name}: there is no such file; `make {target}` writes it"):
            read_lines(tmp_path / name, ("bones",))
