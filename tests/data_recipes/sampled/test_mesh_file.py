"""Mesh files as programs write them: what is clear is read, and keeps the vertices in the order of the file."""

import struct

import numpy as np
import pytest
from sample_folders import COLUMNS, FACE, ROWS, neutral, obj, write

from data_recipes.sampled.face_file import read_face
from data_recipes.sampled.mesh_file import read_mesh
from data_recipes.sampled.sample_folder import open_folder
from data_recipes.sampled.segment_charts import covered_and_doubled, make_mesh
from replicate.base.exceptions import InputError

QUAD = "f 1/1 2/2 7/7 6/6\n"
FACES = 2 * (ROWS - 1) * (COLUMNS - 1)


def read(tmp_path, text: str | bytes, name: str = "mesh.obj"):
    """Return a file's content."""
    file = tmp_path / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_mesh(file)


def colours(text: str) -> str:
    """Return an OBJ whose vertices have colours."""
    return "".join(line + " .5 .4 .3\n" if line.startswith("v ") else line + "\n" for line in text.splitlines())


def from_the_end(text: str) -> str:
    """Return an OBJ whose faces count backwards."""
    back = lambda word: "/".join(str(int(k) - 1 - len(neutral())) for k in word.split("/"))  # noqa: E731
    lines = (line.split() for line in text.splitlines())
    return "\n".join(" ".join(["f", *map(back, words[1:])]) if words[0] == "f" else " ".join(words) for words in lines)


WRITTEN = {
    "tabs": lambda text: text.replace(" ", "\t"),
    "several blanks": lambda text: text.replace(" ", "   ").replace("\n", "  \n  "),
    "continued lines": lambda text: text.replace(" 7/7 ", " \\\n  7/7 ").replace("v 0.0 ", "v 0.0\\\n "),
    "a comment that ends like a continued line": lambda text: "# C:\\faces\\\n" + text,
    "carriage returns alone": lambda text: text.replace("\n", "\r"),
    "carriage returns too": lambda text: text.replace("\n", "\r\n"),
    "a byte order mark": lambda text: "\ufeff" + text,
    "colours": colours,
    "w": lambda text: colours(text).replace(" .5 .4 .3", " 1.0"),
    "w of texture coordinates": lambda text: text.replace("\ng lower", " 0.0\ng lower", 1),
    "indices from the end": from_the_end,
    "comments behind": lambda text: text.replace("\n", " # skin\n"),
    "lines and curves": lambda text: text + "l 1 2 3\ncstype bezier\ncurv 0 1 1 2 3 4\nend\n",
    "normals": lambda text: text + "vn 0 0 1\n",
}


@pytest.mark.parametrize("way", WRITTEN)
def test_an_obj_is_the_same_however_it_is_written(tmp_path, way):
    if way == "comments behind":  # a group's name may hold anything
        text = "\n".join(line if line[0] == "g" else line + " # skin" for line in obj().splitlines())
    else:
        text = WRITTEN[way](obj())
    assert text != obj()
    plain, other = read(tmp_path, obj()), read(tmp_path, text)
    for name in ("vertices", "faces", "uv", "uv_faces"):
        np.testing.assert_array_equal(getattr(other, name), getattr(plain, name))
    assert other.groups == plain.groups and not other.remarks


def test_a_vertex_that_a_polygon_repeats_counts_once_and_a_polygon_without_an_area_is_left_out(tmp_path):
    found = read(tmp_path, obj().replace(QUAD, "f 1/1 2/2 2/2 7/7 6/6 6/6 1/1\n", 1))
    np.testing.assert_array_equal(found.faces, read(tmp_path, obj()).faces)
    assert not found.remarks
    found = read(tmp_path, obj() + "f 1/1 2/2 2/2\nf 1 1 1\n")
    assert len(found.faces) == FACES
    assert found.remarks == (f"{tmp_path}/mesh.obj: polygons of fewer than 3 different vertices, left out: 2",)


def test_polygons_that_are_there_again_even_turned_over_count_once(tmp_path):
    again = [line for line in obj().splitlines() if line.startswith("f ")]
    turned = [" ".join(["f", *reversed(line.split()[1:])]) for line in again]
    found = read(tmp_path, obj() + "\n".join(again[:3] + turned))
    np.testing.assert_array_equal(found.faces, read(tmp_path, obj()).faces)
    assert found.remarks == (f"{tmp_path}/mesh.obj: polygons of the same vertices as another, left out: 23",)


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_names_keep_their_letters(tmp_path, encoding):
    found = read(tmp_path, obj().replace("g lower", "g Zähne  oben").encode(encoding))
    assert make_mesh(found, "groups", found.vertices, "mesh.obj").segment_names == ("Zähne_oben", "upper")


def test_an_object_names_the_faces_that_no_group_names(tmp_path):
    text = obj().replace("g lower", "o Head\ng default").replace("g upper", "o Teeth\ng")
    assert set(read(tmp_path, text).groups) == {"Head", "Teeth"}
    assert set(read(tmp_path, obj().replace("g lower", "g default")).groups) == {"default", "upper"}


@pytest.mark.parametrize("bare", [slice(12, None), slice(15, 17)])
def test_charts_are_made_for_segments_some_of_whose_polygons_have_no_texture_coordinates(tmp_path, bare):
    lines = obj().splitlines()
    faces = [k for k, line in enumerate(lines) if line.startswith("f ")]
    for k in faces[bare]:
        lines[k] = " ".join(word.split("/")[0] for word in lines[k].split())
    found = read(tmp_path, "\n".join(lines))
    mesh, whole = (make_mesh(m, "groups", m.vertices, "mesh.obj") for m in (found, read(tmp_path, obj())))
    lower = mesh.segment == 0
    np.testing.assert_array_equal(mesh.uv[lower], whole.uv[lower])
    upper = mesh.uv[~lower]
    assert len(np.unique(upper.round(3), axis=0)) == len(upper)
    assert covered_and_doubled(mesh.uv[mesh.faces[(mesh.segment[mesh.faces] == 1).all(1)]].astype(float))[1] < 0.02
    with pytest.raises(InputError, match='have no texture coordinates, which segments = "islands" needs'):
        make_mesh(found, "islands", found.vertices, "mesh.obj")


def test_a_corner_without_texture_coordinates_leaves_its_polygon_without(tmp_path):
    found = read(tmp_path, obj().replace(QUAD, "f 1 2/2 7/7 6/6\n"))
    assert (found.uv_faces[:2] == -1).all() and (found.uv_faces[2:] >= 0).all()


def test_vertices_in_no_face_are_a_segment_of_their_own(tmp_path):
    text = obj().replace("vt 0.0 0.0", "v 500 0 20\nv 0 0 0\nvt 0.0 0.0", 1)
    found = read(tmp_path, text)
    assert found.unused.tolist() == [30, 31]
    assert found.remarks == (f"{tmp_path}/mesh.obj: vertices in no face, which stand still: 2",)
    mesh = make_mesh(found, "groups", found.vertices, "mesh.obj")
    assert mesh.segment_names == ("lower", "upper", "unused") and mesh.segment[30:].tolist() == [2, 2]
    np.testing.assert_array_equal(mesh.uv[:30], make_mesh(read(tmp_path, obj()), "groups", neutral(), "").uv)


def test_a_concave_polygon_is_cut_along_its_inside(tmp_path):
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    radius = np.where(np.arange(200) % 2, 20, 60)
    star = [f"v {x:.6f} {y:.6f} 0\n" for x, y in zip(radius * np.cos(angle), radius * np.sin(angle), strict=True)]
    found = read(tmp_path, "".join(star) + "f " + " ".join(map(str, range(1, 201))))
    a, b, c = (found.vertices[found.faces[:, k], :2] for k in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert len(areas) == 198 and (areas > 0).all()
    assert areas.sum() == pytest.approx(100 * 60 * 20 * np.sin(np.pi / 100), rel=1e-5)


@pytest.mark.parametrize(
    ("spoilt", "sentence"),
    [
        (("v -90.0 -100.0", "v nan -100.0"), "line 1: expected 3 numbers up to 1e+09, got 'nan -100.0"),
        (("v -90.0 -100.0", "v -90,0 -100,0"), "line 1: expected 3 numbers up to 1e+09, got '-90,0"),
        ((QUAD, "f 1/1 2/2 31/7 6/6\n"), "line 62: vertex: expected a whole number from 1 to 30, got '31'"),
        ((QUAD, "f 1/1 2/2\n"), "line 62: expected a polygon of 3 corners or more, got 2"),
    ],
)
def test_what_can_be_no_mesh_is_refused_by_its_line(tmp_path, spoilt, sentence):
    with pytest.raises(InputError) as error:
        read(tmp_path, obj().replace(*spoilt, 1))
    assert sentence in str(error.value)


# PLY

CODES = {"float": "f", "double": "d", "uchar": "B", "int": "i", "uint": "I"}


def ply(way: str, real: str = "float", uv: str = "vertex", newline: str = "\n") -> bytes:
    """Return the sheet as PLY: its first row of quads as triangles, a colour for each vertex, texture coordinates."""
    quads = [line.split()[1:] for line in obj(with_uv=False).splitlines() if line[0] == "f"]
    polygons = [[int(word) - 1 for word in quad] for quad in quads]
    polygons[:4] = [corners for a, b, c, d in polygons[:4] for corners in ([a, b, c], [a, c, d])]
    places = [tuple(map(float, line.split()[1:])) for line in obj().splitlines() if line.startswith("vt")]
    vertex = [*((real, name) for name in "xyz"), ("uchar", "red")]
    vertex += [("float", "s"), ("float", "t")] if uv == "vertex" else []
    lines = ["ply", f"format {way} 1.0", "comment a sheet", f"element vertex {len(neutral())}"]
    lines += [f"property {kind} {name}" for kind, name in vertex]
    lines += [f"element face {len(polygons)}", "property uchar flags", "property list uchar uint vertex_indices"]
    lines += ["property list uchar float texcoord"] * (uv == "corners")
    rows = [
        [*zip([kind for kind, _ in vertex], [*point, 200, *(place if uv == "vertex" else ())], strict=True)]
        for point, place in zip(neutral().tolist(), places, strict=True)
    ]
    for corners in polygons:
        row = [("uchar", 1), ("uchar", len(corners)), *(("uint", k) for k in corners)]
        if uv == "corners":
            row += [("uchar", 2 * len(corners)), *(("float", value) for k in corners for value in places[k])]
        rows.append(row)
    header = "".join(line + newline for line in [*lines, "end_header"]).encode()
    if way == "ascii":
        return header + "".join(" ".join(str(value) for _, value in row) + newline for row in rows).encode()
    order = "<" if "little" in way else ">"
    return header + b"".join(struct.pack(order + CODES[kind], value) for row in rows for kind, value in row)


@pytest.mark.parametrize("way", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(("real", "newline"), [("float", "\n"), ("double", "\r\n")])
@pytest.mark.parametrize("uv", ["vertex", "corners"])
def test_a_ply_has_the_vertices_and_faces_of_the_same_obj(tmp_path, way, real, newline, uv):
    found, same = read(tmp_path, ply(way, real, uv, newline), "mesh.ply"), read(tmp_path, obj())
    np.testing.assert_allclose(found.vertices, same.vertices, atol=1e-5)
    np.testing.assert_array_equal(found.faces, same.faces)
    np.testing.assert_allclose(found.uv[found.uv_faces], same.uv[same.uv_faces], atol=1e-6)
    meshes = [make_mesh(m, segments, m.vertices, "mesh") for m, segments in ((found, "islands"), (same, "islands"))]
    np.testing.assert_allclose(meshes[0].uv, meshes[1].uv, atol=1e-6)


def test_a_ply_without_texture_coordinates_gets_charts(tmp_path):
    found = read(tmp_path, ply("ascii", uv="none"), "mesh.ply")
    assert found.uv is None and set(found.groups) == {""}
    assert len(np.unique(make_mesh(found, "groups", found.vertices, "").uv.round(3), axis=0)) == ROWS * COLUMNS


def test_a_folder_may_have_a_ply_in_the_place_of_an_obj(tmp_path):
    folder = write(tmp_path / "box")
    (folder / "mesh.ply").write_bytes(ply("binary_little_endian"))
    (folder / "face.toml").write_text(FACE.replace("mesh.obj", "mesh.ply"))
    open_folder.cache_clear()
    np.testing.assert_allclose(open_folder(folder).vertices_mm, neutral(), atol=1e-5)


PLY = ply("binary_little_endian")


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "no header of a PLY"),
        (PLY[:-1], "ends too early"),
        (PLY[:200], "no header of a PLY"),
        (PLY.replace(b"little", b"middle"), "its header says 'format binary_middle_endian 1.0'"),
        (PLY.replace(b"vertex 30", b"vertex 3000000000"), "ends too early"),
        (PLY.replace(b"face 24", b"face 25"), "ends too early"),
        (PLY.replace(b"property float z", b"property float w"), "its vertices have no z"),
        (PLY.replace(b"float x", b"quad x"), "its header says 'property quad x'"),
        (PLY.replace(b"list uchar uint", b"list float uint"), "ends too early|has the length"),
        (ply("ascii").replace(b"1 3 0 1", b"1 3 0 one"), "invalid literal"),
        (ply("ascii").replace(b"1 3 0 1", b"1 3 0 99"), "face 0 .from 0.: expected vertices from 0 to 29, got .0, 99"),
        (
            ply("ascii").replace(b"-90.0 -100.0", b"nan inf", 1),
            r"vertex 0 .from 0.: expected numbers up to 1e.09, got .nan",
        ),
        (ply("ascii").replace(b"1 3 0 1", b"1 4000000000 0 1"), "ends too early"),
    ],
)
def test_a_damaged_ply_is_refused_in_a_sentence(tmp_path, data, sentence):
    with pytest.raises(InputError, match=sentence):
        read(tmp_path, data, "mesh.ply")


@pytest.mark.parametrize("name", ["mesh.fbx", "mesh.blend", "mesh"])
def test_another_kind_of_file_is_refused_with_the_remedy(tmp_path, name):
    folder = write(tmp_path / "box")
    (folder / "face.toml").write_text(FACE.replace("mesh.obj", name))
    with pytest.raises(InputError, match="export the neutral pose as one of these, its vertices in the order of"):
        read_face(folder)
