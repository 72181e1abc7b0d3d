"""Segments and charts of mesh files: borders, seams, overlaps, and charts that are made."""

import numpy as np
import pytest
from sample_folders import COLUMNS, ROWS, neutral, obj

from data_recipes.sampled.mesh_file import read_mesh
from data_recipes.sampled.segment_charts import clean_name, covered_and_doubled, make_mesh
from replicate.base.exceptions import InputError


def mesh_of(tmp_path, text: str, segments: str = "groups"):
    """Return our mesh of an OBJ."""
    file = tmp_path / "mesh.obj"
    file.write_text(text)
    read = read_mesh(file)
    return make_mesh(read, segments, read.vertices, "mesh.obj")


def sheet(uv, groups=True, seam_row=None) -> str:
    """Return the sheet as OBJ with texture coordinates uv(u, v, side); rows from `seam_row` on have those of side 1."""
    lines = [f"v {x} {y} {z}" for x, y, z in neutral().tolist()]
    for side in (0, 1):
        for k in range(ROWS * COLUMNS):
            u, v = uv(k % COLUMNS / (COLUMNS - 1), k // COLUMNS / (ROWS - 1), side)
            lines.append(f"vt {u} {v}")
    for row in range(ROWS - 1):
        if groups:
            lines.append("g lower" if row < 3 else "g upper")
        side = int(seam_row is not None and row >= seam_row)
        for column in range(COLUMNS - 1):
            first = row * COLUMNS + column + 1
            corners = (first, first + 1, first + COLUMNS + 1, first + COLUMNS)
            lines.append("f " + " ".join(f"{k}/{k + side * ROWS * COLUMNS}" for k in corners))
    return "\n".join(lines) + "\n"


def test_a_vertex_between_segments_goes_with_most_of_its_faces_and_charts_fill_the_square(tmp_path):
    mesh = mesh_of(tmp_path, obj())
    assert mesh.segment_names == ("lower", "upper")
    rows = mesh.segment.reshape(ROWS, COLUMNS)
    assert (rows[:3] == 0).all() and (rows[4:] == 1).all()
    assert rows[3].tolist() == [1, 0, 0, 0, 0]  # between them: triangles in either, and the first segment on a tie
    for k in (0, 1):
        own = mesh.uv[mesh.segment == k]
        np.testing.assert_array_equal([own.min(0), own.max(0)], [[0, 0], [1, 1]])


def test_a_group_may_name_its_vertices_itself(tmp_path):
    border = 3 * COLUMNS + 1
    mesh = mesh_of(tmp_path, obj().replace("g upper", f"g upper\np {border} {border + 1}", 1))
    assert mesh.segment[border - 1 : border + 2].tolist() == [1, 1, 0]


def test_a_vertex_on_a_seam_is_not_split_and_lies_on_the_side_of_most_of_its_corners(tmp_path):
    text = sheet(lambda u, v, side: (u, v / 2 + 0.5 * side * (v > 0.3)), groups=False, seam_row=2)
    mesh = mesh_of(tmp_path, text)
    assert len(mesh.neutral) == ROWS * COLUMNS and mesh.segment_names == ("rest",)
    places = {tuple(place) for place in mesh.uv.round(4).tolist()}
    assert len(places) == ROWS * COLUMNS


def test_islands_are_the_connected_parts_of_the_texture_the_largest_first(tmp_path):
    mesh = mesh_of(tmp_path, sheet(lambda u, v, side: (u + 2 * side, v), seam_row=1), "islands")
    assert mesh.segment_names == ("island_01", "island_02")
    rows = mesh.segment.reshape(ROWS, COLUMNS)
    assert (rows[0] == 1).all() and (rows[2:] == 0).all() and rows[1].tolist() == [0, 0, 0, 0, 1]
    assert (mesh.uv >= 0).all() and (mesh.uv <= 1).all()


def test_charts_are_made_where_those_of_the_file_overlap_and_where_there_are_none(tmp_path):
    mirrored = sheet(lambda u, v, side: (abs(2 * u - 1), v), groups=False)
    for text in (mirrored, obj(with_uv=False)):
        mesh = mesh_of(tmp_path, text)
        for k in range(len(mesh.segment_names)):
            own = mesh.uv[mesh.segment == k]
            assert len(np.unique(own.round(3), axis=0)) == len(own)  # no two vertices in one place
            faces = mesh.faces[(mesh.segment[mesh.faces] == k).all(1)]
            assert covered_and_doubled(mesh.uv[faces].astype(float))[1] < 0.02


def test_faces_without_an_area_are_left_out_and_their_vertices_stay(tmp_path):
    text = obj() + "v 0 0 0\nv 0 0 0\ng lower\nf 31/1 32/2 1/3\n"
    mesh = mesh_of(tmp_path, text)
    assert len(mesh.neutral) == 32 and len(mesh.faces) == 2 * (ROWS - 1) * (COLUMNS - 1)
    assert mesh.segment[30:].tolist() == [0, 0]


def test_names_of_segments_can_name_results(tmp_path):
    mesh = mesh_of(tmp_path, obj().replace("g lower", "g face/lower lip", 1).replace("g upper", "g ../", 1))
    assert set(mesh.segment_names) >= {"face_lower_lip"} and all("/" not in name for name in mesh.segment_names)


@pytest.mark.parametrize(
    ("name", "clean"),
    [
        ("顔", "顔"),
        ("Za\u0308hne oben", "Zähne_oben"),
        ("हिंदी", "हिंदी"),
        ("<b>skin</b>", "b_skin_b"),
        ("C:\\lip\u202e.", "C_lip"),
        ("☺", "rest"),
        ("顔" * 40, "顔" * 20),
        ("lid-2", "lid-2"),
    ],
)
def test_a_segments_name_keeps_letters_and_digits_of_any_script(name, clean):
    assert clean_name(name) == clean


@pytest.mark.parametrize(("shift", "share"), [(1.0, 0.0), (0.0, 1.0)])
def test_the_overlap_of_charts_is_a_share_of_what_they_cover(shift, share):
    one = np.array([[[0, 0], [0.5, 0], [0, 1.0]], [[0.5, 0], [0.5, 1.0], [0, 1.0]]])
    covered, doubled = covered_and_doubled(np.concatenate([one, one + np.array([shift / 2, 0])]))
    assert abs(covered - (0.5 + shift / 2)) < 0.02 and abs(doubled - share) < 0.02


def test_islands_need_texture_coordinates(tmp_path):
    with pytest.raises(InputError, match="no texture coordinates"):
        mesh_of(tmp_path, obj(with_uv=False), "islands")
