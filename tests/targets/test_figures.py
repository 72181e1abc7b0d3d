"""Figures: colours that mean what the bar says, one scale for all panels, words that hold the numbers, small files."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import hsv_to_rgb
from matplotlib.text import Text
from PIL import Image
from plain_rig import PlainRig
from plane import flat_grid
from sample_rows import CURVE, PAPER_ROWS, table2_rows
from scipy.ndimage import gaussian_filter

from replicate.approximation.metrics import normal_error
from replicate.drawing.characters import expression_sheet, segment_colours
from replicate.drawing.colours import perceived
from replicate.drawing.heatmap import NO_NORMAL, ROOT, error_colours, normal_heat
from replicate.drawing.panels import DPI, Words, panel_grid, save_figure
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.scene import Camera, axes
from replicate.engine.exceptions import InputError
from replicate.geometry.mesh import Mesh
from replicate.report.pose_record import PoseRecord
from replicate.report.training_curves import read_curves, read_log, write_curves
from replicate.targets.figure01.side_by_side import figure01
from replicate.targets.figure09.forehead_wrinkles import figure09
from replicate.targets.figure10.error_faces import figure10, picture_name
from replicate.targets.table2.curves_chart import training_curves
from replicate.targets.table2.error_chart import table2_chart

COLUMN_INCHES = 84 / 25.4


@pytest.fixture
def record() -> PoseRecord:
    """A bumpy plate, 180 mm wide, that the "dense" method roughens and the "coarse" one flattens."""
    flat, faces = flat_grid(np.linspace(-90, 90, 25), np.linspace(-90, 90, 25), 40)
    truth = flat.copy()
    truth[:, 2] += 4 * np.sin(flat[:, 1] / 8)
    rough = truth + np.random.default_rng(0).normal(size=truth.shape).astype(np.float32)
    region = np.int8(flat[faces].mean(1)[:, 1] < 20)
    vertices = {"truth": truth, "coarse": flat, "dense": rough}
    return PoseRecord("teen", 7, flat, faces, vertices, region_names=("forehead", "mouth"), region=region)


def test_no_error_has_the_first_colour_and_the_limit_and_more_the_last():
    colours = error_colours(np.float32([0, 5, 10, 50, np.nan]), 10)
    assert (colours[0] == error_colours(np.float32([0]), 1)[0]).all()
    assert (colours[2] == colours[3]).all() and (colours[1] != colours[2]).any()
    assert tuple(colours[4]) == NO_NORMAL


def test_twelve_degrees_and_twenty_two_look_apart_and_one_is_seen():
    none, one, twelve, more = perceived(error_colours(np.float32([0, 1, 12, 22]), 30.0, ROOT).tolist())
    assert np.linalg.norm(more - twelve) > 25 and np.linalg.norm(one - none) > 10


def test_brightness_rises_with_the_error():
    colours = error_colours(np.linspace(0, 10, 50, dtype=np.float32), 10) / 255
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    assert (np.diff(linear @ [0.2126, 0.7152, 0.0722]) > 0).all()


def test_the_heat_of_a_perfect_prediction_is_one_colour_and_unlit(record):
    truth = record.vertices["truth"]
    heat = normal_heat(truth, truth, record.faces, 10.0)
    assert len(np.unique(heat.colours, axis=0)) == 1 and not heat.lit


def pictures_of(figure) -> list[np.ndarray]:
    return [axes.images[0].get_array() for axes in figure.axes if axes.images]


def texts_of(figure) -> list[str]:
    return [text.get_text() for text in figure.texts]


def test_figure_10_halves_each_methods_face_into_surface_and_heat_on_one_scale(record):
    figure, _ = figure10(record, 10.0, across=60, renderer="software")
    truth, coarse, dense = pictures_of(figure)
    exact, limit = (error_colours(np.float32([error]), 10.0)[0] for error in (0, 10))
    assert np.ptp(truth.astype(int), axis=-1).max() < 20, "clay is grey, heat is not"
    for picture in (coarse, dense):
        colourful = np.ptp(picture.astype(int), axis=-1) > 40
        assert not colourful[:, :28].any() and colourful[20:50, 34:].mean() > 0.5
    assert not (coarse == limit).all(-1)[:, :28].any() and not (truth == exact).all(-1).any()
    bar = figure.axes[-1]
    assert bar.get_xlim() == (0, 10) and "degrees" in bar.get_xlabel()


def test_figure_10_prints_the_mean_of_the_mesh_and_of_each_region_below_each_face(record):
    figure, words = figure10(record, 10.0, across=60, renderer="software")
    texts = texts_of(figure)
    rows = ["whole mesh", "forehead", "mouth"]
    assert [name for name in texts if name in rows] == rows
    errors = {
        method: normal_error(record.vertices[method], record.vertices["truth"], record.faces)
        for method in ("coarse", "dense")
    }
    expected = []
    for error in errors.values():
        expected += [f"{part.mean():.2f}°" for part in (error, error[record.region == 0], error[record.region == 1])]
    assert [text for text in texts if text.endswith("°")] == expected and len(set(expected)) == 6
    assert f"Coarse {expected[0]}" in words.alt and "Refined" not in words.caption
    assert words.caption.startswith("Test pose 7 of teen, the one whose forehead folds most (after Fig. 10)")


def test_figure_10_breaks_many_methods_into_rows_of_five(record):
    names = ("coarse", "refined", "dense", "lbs16", "lbs24", "lbs32", "linear")
    many = replace(record, vertices={"truth": record.vertices["truth"]} | dict.fromkeys(names, record.neutral))
    figure, _ = figure10(many, across=40, renderer="software")
    places = [axes.get_position() for axes in figure.axes if axes.images]
    tops = [round(place.y1, 3) for place in places]
    assert [tops.count(top) for top in dict.fromkeys(tops)] == [3, 5], "so that LBS stands in one row"
    assert all(0 <= place.x0 and place.x1 <= 1 and 0 <= place.y0 and place.y1 <= 1 for place in places)
    assert texts_of(figure).count("whole mesh") == 2, "each row says what its numbers are"


def test_captions_say_by_which_rule_a_pose_was_chosen(record):
    records = [record, *(replace(record, choice=rule, ranked_by="refined") for rule in ("median", "worst"))]
    captions = [figure10(one, across=24, renderer="software")[1].caption for one in records]
    assert "the median of the mean normal errors of “Refined”" in captions[1]
    assert "the largest mean normal error of “Refined”" in captions[2]
    assert [picture_name(one) for one in records] == ["figure10_teen", "figure10_teen_median", "figure10_teen_worst"]
    close = figure10(record, camera="forehead", across=24, renderer="software")[1].caption
    assert close.startswith("Close up on the forehead, test pose 7") and len({*captions, close}) == 4
    assert picture_name(record, "forehead") == "figure10_teen_forehead"


def test_figure_9_shows_the_methods_that_there_are(record):
    figure, words = figure09(record, across=160, renderer="software")
    error = normal_error(record.vertices["coarse"], record.vertices["truth"], record.faces)[record.region == 0].mean()
    assert [text for text in texts_of(figure) if text] == ["Ground truth", "Coarse", f"forehead: {error:.2f}°"]
    assert f"Ground truth, Coarse {error:.2f}°." in words.alt


def test_figure_1_shows_head_and_forehead_with_both_errors_below(record):
    both = replace(record, vertices=record.vertices | {"refined": record.vertices["truth"] + np.float32([0, 0, 0.5])})
    figure, words = figure01(both, across=160, renderer="software")
    assert len(pictures_of(figure)) == 4 and texts_of(figure)[-4:] == ["Ground truth", "Refined", "0.50 mm", "0.00°"]
    assert texts_of(figure)[:2] == ["distance error", "normal error"]
    assert "Refined 0.50 mm and 0.00°" in words.alt and "Fig. 1)" in words.caption


def test_the_captions_of_the_figures_differ(record):
    drawn = [figure01(record, 24, "software"), figure09(record, across=24, renderer="software"),
             figure10(record, across=24, renderer="software")]  # fmt: skip
    assert len({words.caption.partition("test pose")[0] for _, words in drawn}) == 3
    assert len({words.alt for _, words in drawn}) == 3


def test_panels_are_drawn_pixel_for_pixel(tmp_path):
    rng = np.random.default_rng(0)
    picture = rng.choice(np.uint8([0, 80, 160, 255]), size=(40, 50, 1)).repeat(3, -1)
    figure = panel_grid([[picture, picture]], ["a", "b"])
    save_figure(figure, tmp_path / "f.png", Words("what it shows: α", "what it means"))
    image = np.array(Image.open(tmp_path / "f.png").convert("RGB"))
    assert image.shape[:2] == tuple(round(x * DPI) for x in figure.get_size_inches()[::-1])
    windows = np.lib.stride_tricks.sliding_window_view(image, picture.shape)
    assert (np.abs(windows.astype(int) - picture) <= 2).all((-1, -2, -3)).sum() == 2


def test_a_saved_figure_is_small_has_a_palette_white_paper_and_its_words(tmp_path, record):
    figure, words = figure10(record, across=200, renderer="software")
    save_figure(figure, tmp_path / "f.png", words)
    image = Image.open(tmp_path / "f.png")
    assert image.mode == "P" and (tmp_path / "f.png").stat().st_size < 300_000
    assert image.convert("RGB").getpixel((0, 0)) == (255, 255, 255)
    assert image.text["Description"] == words.alt
    assert json.loads((tmp_path / "f.json").read_text()) == {"alt": words.alt, "caption": words.caption}


def test_a_figure_that_would_be_too_large_gets_fewer_colours(tmp_path):
    x, y = np.meshgrid(np.linspace(0, 255, 300), np.linspace(0, 255, 300))
    noise = np.random.default_rng(0).normal(size=(2, 300, 300, 1)) * 12
    picture = np.uint8((np.stack([x, y, 255 - x], -1) + noise[0] + noise[1]).clip(0, 255))
    figure = panel_grid([[picture]], ["noise"])
    save_figure(figure, tmp_path / "f.png", Words("noise", "noise"))
    size = (tmp_path / "f.png").stat().st_size
    assert 50_000 < size < 300_000
    save_figure(figure, tmp_path / "f.png", Words("noise", "noise"), size - 1)
    assert 30_000 < (tmp_path / "f.png").stat().st_size < size


def test_a_legends_colours_are_exact_beside_a_picture_of_many_hues(tmp_path):
    generator = np.random.default_rng(0)
    squares = generator.integers(0, 256, (24, 3), np.uint8)
    x, y = np.meshgrid(np.linspace(0, 255, 300), np.linspace(0, 255, 300))
    picture = np.uint8((np.stack([x, y, 255 - x], -1) + generator.normal(size=(300, 300, 1)) * 8).clip(0, 255))
    for k, square in enumerate(squares):
        picture[12 * k : 12 * k + 11, 5:16] = square
    save_figure(panel_grid([[picture]], ["hues"]), tmp_path / "f.png", Words("hues", "hues"))
    image = Image.open(tmp_path / "f.png")
    drawn = np.asarray(image.convert("RGB")).reshape(-1, 3)
    assert image.mode == "P" and all((drawn == square).all(-1).sum() >= 121 for square in squares)


def test_mixtures_of_many_hues_show_no_bands_where_palette_colours_are_mixed(tmp_path):
    hue, light = np.meshgrid(np.linspace(0, 1, 300), np.linspace(0.3, 1, 300))
    smooth = np.uint8(255 * hsv_to_rgb(np.stack([hue, 0 * hue + 0.8, light], -1)))
    figure = panel_grid([[smooth]], ["hues"])
    pictures = {}
    for dither in (False, True):
        save_figure(figure, tmp_path / "f.png", Words("hues", "hues"), dither=dither)
        image = Image.open(tmp_path / "f.png")
        assert image.mode == "P"
        pictures[dither] = np.asarray(image.convert("RGB"), float)
    figure.savefig(tmp_path / "exact.png", dpi=DPI)
    exact = np.asarray(Image.open(tmp_path / "exact.png").convert("RGB"), float)
    banding = {d: np.abs(gaussian_filter(pictures[d] - exact, (3, 3, 0))).mean() for d in pictures}
    assert banding[True] < 0.5 * banding[False]


def test_the_same_figure_gives_the_same_bytes(tmp_path, record):
    for name in ("a.png", "b.png"):
        figure, words = figure10(record, across=60, renderer="software")
        save_figure(figure, tmp_path / name, words)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_curves_are_read_back_to_the_last_bit(tmp_path):
    curves = {("teen", "dense"): CURVE, ("teen", "coarse"): CURVE[:1]}
    write_curves(tmp_path / "c.csv", curves)
    assert read_curves(tmp_path / "c.csv") == curves
    assert (tmp_path / "c.csv").read_text().splitlines()[1] == "teen,coarse,100,3.5,1.25,4.5"


def test_a_training_log_is_read_and_a_broken_one_is_named_with_its_line(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("step,loss,mm,degrees\n100,3.5,1.25,4.5\n")
    assert read_log(path) == CURVE[:1]
    path.write_text("step,loss,mm,degrees\n100,3.5,x,4.5\n")
    with pytest.raises(InputError, match="line 2: mm is 'x', where only a number is allowed"):
        read_log(path)
    path.write_text("step,loss\n")
    with pytest.raises(InputError, match="line 1: found 'step,loss'"):
        read_log(path)
    with pytest.raises(InputError, match="make table2"):
        read_curves(tmp_path / "missing.csv")


def test_training_curves_draw_each_network_and_the_floors():
    curves = {("teen", "coarse"): CURVE, ("teen", "dense"): CURVE, ("other", "refined"): CURVE}
    figure, words = training_curves(curves, table2_rows(), "teen")
    left = figure.axes[0]
    assert [line.get_label() for line in left.lines] == ["Coarse", "Dense", "Floor, coarse maps", "Floor, refined maps"]
    np.testing.assert_allclose(left.lines[0].get_ydata(), [1.25, 1 / 3])
    np.testing.assert_allclose(figure.axes[1].lines[1].get_ydata(), [4.5, 2.0])
    assert "Dense ends at 0.33 mm" in words.alt


def test_the_chart_of_table_2_shows_ours_and_the_papers():
    figure, words = table2_chart(table2_rows(), PAPER_ROWS, "teen")
    points = {(round(line.get_xdata()[0], 2), line.get_ydata()[0]) for line in figure.axes[0].lines}
    assert (0.11, 0) in points and (0.36, 0) in points  # coarse: ours, Hiccup's
    assert len(figure.axes[0].lines) == 9 + 6  # ours, the driven skin among them, and the paper's
    assert "Refined 0.22 mm" in words.alt and "Hiccup" in words.caption
    assert [axes.get_xlabel() for axes in figure.axes] == ["distance error, mm", "normal angle error, degrees"]


def test_letters_of_table_2s_charts_are_five_points_high_in_a_column_of_the_paper():
    chart = table2_chart(table2_rows(), PAPER_ROWS, "teen")[0]
    curves = training_curves({("teen", "coarse"): CURVE}, table2_rows(), "teen")[0]
    for figure in (chart, curves):
        FigureCanvasAgg(figure).draw()
        shrunk = COLUMN_INCHES / figure.get_size_inches()[0]
        words = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
        assert len(words) > 10 and all(text.get_fontsize() * shrunk >= 5 for text in words)


def test_a_dots_number_stands_clear_of_the_papers_ring_and_of_the_axis():
    figure, _ = table2_chart(table2_rows(), PAPER_ROWS, "teen")
    FigureCanvasAgg(figure).draw()
    renderer = figure.canvas.get_renderer()
    for panel in figure.axes:
        rings = [line for line in panel.lines if line.get_markerfacecolor() == "none"]
        for number in panel.texts:
            box, frame = number.get_window_extent(renderer), panel.get_window_extent(renderer)
            assert frame.x0 < box.x0 and box.x1 < frame.x1 + 10, "no line bounds a panel at its right"
            assert not any(box.contains(*panel.transData.transform(ring.get_xydata()[0])) for ring in rings)


def test_an_expression_sheet_shows_every_pose_with_its_title_and_props(record):
    uv = (record.neutral[:, :2] + 90) / 180
    teeth = np.int32(record.neutral[:, 1] < -50)
    mesh = Mesh(record.neutral, record.faces, uv, teeth, ("face", "tooth_upper_01"))
    assert {tuple(colour) for colour in segment_colours(mesh)} == {(226, 178, 148), (245, 242, 230)}
    eye = record.neutral * 0.2 + np.float32([0, 0, 60])

    class Rig(SimpleNamespace, PlainRig):
        def __call__(self, params):
            return mesh.neutral + np.float32([params[0], 0, 0])

        def pose_props(self, params):
            return [("eye", eye, record.faces, (0.0, 0.0, 1.0))]

    rig = Rig(name="plate", mesh=mesh, controls=[None])
    poses = {"rest": np.zeros(1), "left": np.full(1, -30.0), "right": np.full(1, 30.0)}
    figure, words = expression_sheet(rig, poses, columns=2, width=60, height=50, renderer="software")
    pictures = [axes.images[0].get_array() for axes in figure.axes]
    assert [text.get_text() for text in figure.texts] == ["rest", "left", "right", ""]
    assert len(pictures) == 4 and (pictures[3] == 255).all()
    assert (pictures[1] != pictures[2]).any() and (pictures[0][..., 2] > pictures[0][..., 0] + 60).any()
    assert "plate in 3 poses: rest, left, right" in words.alt


@pytest.mark.parametrize("azimuth", [-40.0, 0.0, 40.0])
def test_a_catchlight_stays_on_the_cameras_side_of_an_eyeball(azimuth):
    turn, pitch = np.meshgrid(np.linspace(0, 6, 20), np.linspace(-1.4, 1.4, 12))
    unit = np.stack([np.cos(pitch) * np.sin(turn), np.sin(pitch), np.cos(pitch) * np.cos(turn)], -1).reshape(-1, 3)
    eye, centre = (20 * unit + (33, 2, 60)).astype(np.float32), np.array([33, 2, 60])
    camera = Camera((0, 0, 40), 264, azimuth)
    props = [(f"eye_{zone}_left", eye[part], np.int32([[0, 1, 2]]), (250, 250, 250))
             for zone, part in (("white", slice(0, 120)), ("iris", slice(120, 240)))]  # fmt: skip
    assert len(prop_surfaces(props)) == 2
    light = prop_surfaces(props, camera)[-1]
    towards = (light.vertices - centre) @ axes(camera)[0].T  # right, up, to the eye
    assert (towards[:, 0] < 0).all() and (towards[:, 1] > 0).all() and (towards[:, 2] > 15).all()
    assert np.linalg.norm(towards, axis=1) == pytest.approx(20 * 1.012, abs=0.1)
