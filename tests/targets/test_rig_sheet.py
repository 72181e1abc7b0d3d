"""Sheets of the characters have all panels, and wireframes show the edges that face the camera."""

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image
from plain_rig import PlainRig

from replicate.drawing.characters import character_surfaces, shown_only
from replicate.drawing.marks import quad_edges, wireframe
from replicate.drawing.scene import Camera, Surface, camera_for, frame_surfaces, project
from replicate.geometry.mesh import Mesh
from replicate.targets.rigs import chart_names, draw_line_up, draw_sheets, line_up, rig_sheet

QUADS = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6]])
FACES = np.int32(np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]]))


class Plate(SimpleNamespace, PlainRig):
    """A rig of two charts and a tooth, 180 mm wide, painted, that one control moves aside."""

    def __call__(self, params):
        return self.mesh.neutral + np.float32([params[0], 0, 0])

    def pose_props(self, params):
        eye = self.mesh.neutral[:4] * 0.1 + np.float32([0, 0, 20])
        return [("eye_white_left", eye, np.int32([[0, 1, 2]]), np.full((4, 3), 250, np.uint8))]


@pytest.fixture
def rig():
    x, y = np.meshgrid([-90.0, -30.0, 30.0, 90.0], [-40.0, 40.0])
    flat = np.stack([x, y, 0 * x + 0.01 * y], -1).reshape(-1, 3).astype(np.float32)
    neutral = np.concatenate([flat, flat * 0.5 + np.float32([0, 80, 0]), flat * 0.1 + np.float32([0, -60, 0])])
    quads = np.concatenate([QUADS + 8 * k for k in range(3)])
    faces = np.int32(np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    uv = np.tile((flat[:, :2] + [90, 40]) / [180, 80], (3, 1)).astype(np.float32)
    names = ("face", "crown", "tooth_upper_01")
    mesh = Mesh(neutral, faces, uv, np.repeat(np.int32([0, 1, 2]), 8), names)
    paint = np.tile(np.uint8([10, 200, 30]), (24, 1))
    return Plate(name="plate", mesh=mesh, controls=[None], default=np.zeros(1, np.float32), paint=paint)


def test_a_sheet_has_three_views_a_wireframe_and_a_chart_for_each_deformable_segment(rig):
    figure, words = rig_sheet(rig, 60, 66)
    titles = [text.get_text() for text in figure.texts]
    assert titles == ["front", "three-quarter", "side", "wireframe", "face  8", "crown  8"]
    assert [bool(axes.images) for axes in figure.axes] == [True] * 4 + [False] * 2
    for axes in figure.axes[4:]:
        triangles, edges = axes.collections
        assert len(triangles.get_paths()) == 6 and len(edges.get_paths()) == 10
    assert "2 deformable segments: face, crown" in words.alt and "1 rigid" in words.caption
    assert chart_names(rig) == ["face", "crown"]


def test_panels_of_a_sheet_do_not_overlap_however_many_charts_there_are(rig):
    names = tuple(f"part_{k:02d}" for k in range(19))
    mesh = rig.mesh
    rig.mesh = SimpleNamespace(**vars(mesh) | {"segment_names": names})  # some of them hold no vertex
    figure, _ = rig_sheet(rig, 60, 66)
    boxes = [axes.get_position() for axes in figure.axes]
    assert len(boxes) == 4 + 19
    for k, one in enumerate(boxes):
        assert 0 <= one.x0 and one.x1 <= 1 and 0 <= one.y0 and one.y1 <= 1
        assert not any(
            one.x0 < o.x1 - 1e-9 and o.x0 < one.x1 - 1e-9 and one.y0 < o.y1 - 1e-9 and o.y0 < one.y1 - 1e-9
            for o in boxes[:k]
        )


def test_titles_are_no_wider_than_what_they_stand_over(rig):
    names = tuple(f"gums_and_tongue_{k:02d}" for k in range(19))
    rig.mesh = SimpleNamespace(**vars(rig.mesh) | {"segment_names": names})
    figure, _ = rig_sheet(rig, 310, 340)
    renderer = FigureCanvasAgg(figure).get_renderer()
    for axes, title in zip(figure.axes, figure.texts, strict=True):
        box, words = axes.get_window_extent(renderer), title.get_window_extent(renderer)
        assert box.x0 - 3 <= words.x0 and words.x1 <= box.x1 + 3, title.get_text()


def test_a_line_up_shows_every_rig_twice_in_its_paint(rig):
    figure, words = line_up([rig, rig], 60, 66)
    pictures = [axes.images[0].get_array() for axes in figure.axes]
    assert len(pictures) == 4 and "2 characters" in words.alt
    for picture in pictures:
        assert (picture[..., 1].astype(int) > picture[..., 0] + 60).sum() > 100


def test_sheets_and_line_up_are_written_in_full_colour_and_with_their_words(rig, tmp_path, monkeypatch):
    monkeypatch.setattr("replicate.targets.rigs.expression_poses", lambda rig: {"neutral": rig.default})
    files = [*draw_sheets(rig, tmp_path), draw_line_up([rig], tmp_path)]
    assert [file.name for file in files] == ["plate_sheet.png", "plate_expressions.png", "characters.png"]
    for file in files:
        assert Image.open(file).mode == "RGB" and file.stat().st_size < 2_000_000
        assert "plate" in file.with_suffix(".json").read_text()


def test_a_framed_camera_shows_all_of_the_surfaces_and_little_more(rig):
    surfaces = character_surfaces(rig, rig.default)
    for aspect in (0.6, 2.5):
        camera = frame_surfaces(camera_for("three_quarter", rig.mesh.neutral), surfaces, aspect)
        pixels, _ = project(
            np.concatenate([s.vertices for s in surfaces]).astype(float), camera, round(100 * aspect), 100
        )
        low, high = pixels.min(0), pixels.max(0)
        assert (low > [0, 3]).all() and (high < [100 * aspect, 97]).all()
        assert min(low) < 5
        np.testing.assert_allclose((low + high) / 2, [50 * aspect, 50], atol=0.7)


def test_quads_have_no_diagonals_and_other_triangles_keep_all_edges():
    assert {tuple(edge) for edge in quad_edges(FACES)} == {
        (0, 1), (1, 2), (2, 3), (4, 5), (5, 6), (6, 7), (0, 4), (1, 5), (2, 6), (3, 7)
    }  # fmt: skip
    assert len(quad_edges(FACES[:5])) == 12
    assert len(quad_edges(np.int32([[0, 1, 2], [1, 3, 2]]))) == 5


def test_a_wireframe_lies_before_its_surface_and_leaves_out_what_faces_away(rig):
    camera = Camera((0, 0, 0), 200)
    front = wireframe(rig.mesh.neutral, rig.mesh.faces, camera, 1.0)
    assert len(front.faces) == 2 * 30 and isinstance(front, Surface)
    assert front.vertices[:, 2].min() > rig.mesh.neutral[:, 2].min() + 0.2
    assert len(wireframe(rig.mesh.neutral, rig.mesh.faces[:, ::-1], camera, 1.0).faces) == 0


def test_words_name_what_is_for_display_only_among_what_there_is(rig):
    assert shown_only([rig]) == "Paint and eyeballs are for display only; no method approximates them."
    bald = Plate(**vars(rig) | {"pose_props": lambda params: []})
    assert shown_only([bald]) == "Paint is for display only; no method approximates it."
    assert shown_only([Plate(**vars(bald) | {"paint": None})]) == ""
    haired = Plate(**vars(rig) | {"pose_props": lambda params: [("hair_long",), ("glasses_2",), ("bust",)]})
    assert shown_only([bald, haired]).startswith("Paint, hair and glasses are for display only")
    assert shown_only([rig]) in rig_sheet(rig, 60, 66)[1].caption and shown_only([rig]) in line_up([rig])[1].caption
