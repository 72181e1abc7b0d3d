"""Where the neutral head's vertices lie."""

import dataclasses

import numpy as np
import pytest
from heads import NAMES, head

from data_recipes.head.neutral_head import build_head
from data_recipes.head.shape import build_shape, skin_distance
from data_recipes.recipe.reading import load_recipe
from replicate.base.exceptions import InputError

PEOPLE = ("teen", "woman", "toon")


def triangle_angles_deg(vertices, faces):
    p = vertices[faces]
    out = []
    for i in range(3):
        a, b = p[:, (i + 1) % 3] - p[:, i], p[:, (i + 2) % 3] - p[:, i]
        out.append(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(1))))
    return np.stack(out, -1)


def normals(vertices, faces):
    p = vertices[faces]
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


@pytest.mark.parametrize("name", ("tiny", "teen"))
def test_the_same_recipe_gives_the_same_bytes(name):
    again = build_head(load_recipe(name))
    for field in ("vertices", "faces", "uv", "segment", "mirror"):
        assert getattr(again, field).tobytes() == getattr(head(name), field).tobytes(), field


@pytest.mark.parametrize("name", NAMES)
def test_neutral_is_exactly_symmetric_and_fits_float32(name):
    h = head(name)
    assert (h.vertices[h.mirror] * (-1, 1, 1) == h.vertices).all()
    assert np.abs(h.vertices).max() < 300
    assert np.abs(h.vertices.astype(np.float32) - h.vertices).max() < 1e-4


@pytest.mark.parametrize("name", PEOPLE)
def test_triangles_are_well_shaped(name):
    h = head(name)
    angles = triangle_angles_deg(h.vertices.astype(np.float32).astype(float), h.faces).min(1)
    assert angles.min() > 1.0
    assert np.median(angles) > 30
    skin = np.isin(h.part[h.faces], (0, 1, 2)).all(1)
    assert (angles[skin] < 10).mean() < 0.04


def test_no_triangle_of_tiny_is_degenerate():
    tiny = head("tiny")
    assert triangle_angles_deg(tiny.vertices, tiny.faces).min() > 1.0


@pytest.mark.parametrize("name", NAMES)
def test_skin_lies_on_the_surface_and_faces_outwards(name):
    h = head(name)
    shape = build_shape(h.recipe)
    body = h.grids["body"]
    ids = body[1:][body[1:] >= 0]
    assert np.abs(skin_distance(shape, h.vertices[ids])).max() < 0.1
    faces = h.faces[np.isin(h.faces, ids).all(1)]
    centre = h.vertices[faces].mean(1)
    d = skin_distance(shape, centre + normals(h.vertices, faces)) - skin_distance(shape, centre)
    assert (d > 0).mean() > 0.995


@pytest.mark.parametrize("name", PEOPLE)
def test_the_face_does_not_fold_over_itself(name):
    h = head(name)
    inside = np.concatenate([h.grids[f"nostril_{s}"][:2].ravel() for s in ("left", "right")])
    lips = h.grids["mouth"][0]
    mask = (h.segment[h.faces] == 0).all(1) & ~np.isin(h.faces, np.concatenate([inside, lips])).any(1)
    faces, n = h.faces[mask], normals(h.vertices, h.faces[mask])
    owner = {}
    for i, face in enumerate(faces.tolist()):
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            owner[a, b] = i
    pairs = np.array([(i, owner[b, a]) for (a, b), i in owner.items() if a < b and (b, a) in owner])
    bend = (n[pairs[:, 0]] * n[pairs[:, 1]]).sum(1)
    assert (bend < -0.5).sum() == 0
    assert (bend < 0).mean() < 2e-3


@pytest.mark.parametrize("name", ("teen", "woman"))
def test_rows_of_the_forehead_are_two_millimetres_apart(name):
    h = head(name)
    t = h.recipe.template
    body = h.grids["body"]
    for column in (-10, 0, 10):
        steps = np.linalg.norm(np.diff(h.vertices[body[t.eye_rows[1] + 2 : t.hair_row + 1, column]], axis=0), axis=1)
        assert steps.mean() < 2.15
        assert steps.max() < 2.8


@pytest.mark.parametrize("name", NAMES)
def test_lips_are_closed_and_their_seam_runs_from_the_left_corner_to_the_right(name):
    h = head(name)
    upper, lower = h.vertices[h.curves["seam_upper"]], h.vertices[h.curves["seam_lower"]]
    assert (upper[0] == lower[0]).all() and (upper[-1] == lower[-1]).all()
    assert (np.diff(upper[:, 0]) < 0).all() and (np.diff(lower[:, 0]) < 0).all()
    gap = upper[1:-1, 1] - lower[1:-1, 1]
    assert (gap > 0).all() and gap.max() < 0.2
    u, side = h.ring_parameter["mouth_u"], h.ring_parameter["mouth_side"]
    mouth = h.vertices[h.grids["mouth"]]
    assert np.corrcoef(u, mouth[0, :, 0])[0, 1] > 0.999
    assert (mouth[1, side > 0, 1] > mouth[1, side < 0, 1].max() - 4).all()
    assert u[0] == 1 and side[0] == 0 and u[len(u) // 2] == -1


@pytest.mark.parametrize("name", NAMES)
def test_mouth_bag_teeth_gums_and_tongue_are_inside_the_head_and_behind_the_lips(name):
    h = head(name)
    seam = h.vertices[h.grids["mouth"][0]]
    for part, depth in (("teeth", 3.0), ("gum_upper", 3.0), ("gum_lower", 3.0), ("tongue", 6.0)):
        place = h.vertices[h.grids[part].ravel()]
        assert h.sdf(place).max() < -depth, part
        assert place[:, 2].max() < seam[:, 2].max() - 3, part
    assert h.sdf(h.vertices[h.grids["mouth_bag"][1:].ravel()]).max() < 0.5
    assert (np.diff(h.vertices[h.grids["mouth_bag"]][:, :, 2].mean(1)) < 0).all()


@pytest.mark.parametrize("name", PEOPLE)
def test_tongue_keeps_clear_of_the_teeth(name):
    h = head(name)
    lower = h.vertices[h.grids["teeth"][h.teeth_jaw < 0].ravel()]
    for ring in h.vertices[h.grids["tongue"]]:
        near = lower[np.abs(lower[:, 2] - ring[0, 2]) < 3]
        if len(near):
            assert np.abs(ring[:, 0]).max() < np.abs(near[:, 0]).min() + 2.5


def test_upper_teeth_bite_over_lower_ones_and_each_lies_on_its_side():
    teen = head("teen")
    teeth = teen.vertices[teen.grids["teeth"]]
    upper, lower = teeth[teen.teeth_jaw > 0], teeth[teen.teeth_jaw < 0]
    assert upper[..., 2].max() > lower[..., 2].max()
    assert upper[:, -10:, 1].mean() < upper[:, :10, 1].mean()
    assert lower[:, -10:, 1].mean() > lower[:, :10, 1].mean()
    for jaw in (upper, lower):
        assert (np.diff(jaw.mean(1)[:, 0]) > 0).all()


@pytest.mark.parametrize("name", NAMES)
def test_lids_stay_outside_the_eyeball(name):
    h = head(name)
    eye = h.eyes["left"]
    for grid in ("eye_left", "lid_inner_left"):
        ids = h.grids[grid][:2].ravel()
        distance = np.linalg.norm(h.vertices[ids] - eye.centre, axis=1)
        assert distance.min() > eye.radius, grid
    rim, u, side = h.vertices[h.grids["eye_left"][0]], h.ring_parameter["eye_u"], h.ring_parameter["eye_side"]
    assert rim[np.argmax(u), 0] > eye.centre[0] > rim[np.argmin(u), 0]
    assert rim[side > 0, 1].mean() > rim[side < 0, 1].mean()
    assert (h.eyes["right"].centre == eye.centre * (-1, 1, 1)).all()


def test_a_count_that_the_template_does_not_meet_is_refused():
    recipe = dataclasses.replace(load_recipe("tiny"), vertices=17)
    with pytest.raises(InputError, match=r"vertices: expected \d+, .*, got 17"):
        build_head(recipe)
