"""How much of an eye its lids leave open, and how far it sticks out of them."""

import numpy as np
import pytest
import trimesh
from plain_rig import PlainRig

from data_recipes.controls import Control
from replicate.geometry.mesh import Mesh
from replicate.rig_study.eyelids import find_eyes, measure_lids

RADIUS, LID = 10.0, 10.5


class Eyed(PlainRig):
    """Two eyes at (±40, 0, 0) behind lids that are parts of a sphere; the control of each closes them by its value."""

    def __init__(self, out_mm: float = 0.0, wall_mm: float | None = None):
        self.controls = tuple(Control(f"blink_{side}", 0.0, 0.0, 1.0, "eyes") for side in ("left", "right"))
        self.default, self.out_mm, self.wall_mm = np.zeros(2, np.float32), out_mm, wall_mm
        self.landmarks, self.landmark_names = np.zeros(0, np.int32), ()
        ball = trimesh.creation.icosphere(5, RADIUS)
        self.ball, self.ball_faces = np.asarray(ball.vertices), np.asarray(ball.faces)
        rows, columns = 20, 41
        grid = np.arange(rows * columns).reshape(rows, columns)
        a, b, c, d = grid[:-1, :-1].ravel(), grid[:-1, 1:].ravel(), grid[1:, 1:].ravel(), grid[1:, :-1].ravel()
        patch = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
        lid = rows * columns
        faces = np.concatenate([patch + k * lid for k in range(4)])  # left upper, left lower, right upper, right lower
        if wall_mm is not None:
            faces = np.concatenate([faces, 4 * lid + np.array([[0, 1, 2], [0, 2, 3]])])
        count = faces.max() + 1
        segment, uv = np.zeros(count, np.int32), np.zeros((count, 2), np.float32)
        self.mesh = Mesh(self(self.default), np.int32(faces), uv, segment, ("face",))

    def __call__(self, params):
        parts = []
        for side, blink in zip((1, -1), params, strict=True):
            azimuth = np.radians(np.linspace(-80, 80, 41))[None]
            for up in (1, -1):
                edge = 15 * (1 - float(blink))
                elevation = np.radians(up * np.linspace(edge, 80, 20))[:, None]
                x = np.sin(azimuth) * np.cos(elevation)
                sphere = np.stack([x, np.sin(elevation) + 0 * x, np.cos(azimuth) * np.cos(elevation)], -1)
                parts.append(LID * sphere.reshape(-1, 3) + (40 * side, 0, 0))
        if self.wall_mm is not None:
            parts.append(self.wall_mm * np.array([[-2, -2, 1], [2, -2, 1], [2, 2, 1], [-2, 2, 1]]))
        return np.float32(np.concatenate(parts))

    def pose_props(self, params):
        front = self.ball[self.ball_faces].mean(1)[:, 2] > 9
        iris, iris_faces = np.unique(self.ball_faces[front], return_inverse=True)
        props = []
        for side, name in ((40, "left"), (-40, "right")):
            at = self.ball + np.array([side, 0, self.out_mm if params[0] else 0])
            props.append((f"eye_white_{name}", at, self.ball_faces[~front], (1, 1, 1)))
            props.append((f"eye_iris_{name}", at[iris], iris_faces.reshape(-1, 3), (0, 0, 0)))
        return props


def test_closed_lids_hide_the_eye_and_half_closed_ones_show_their_share():
    rig = Eyed()
    eyes = find_eyes(rig)
    closed = np.ones(2, np.float32)
    lids = measure_lids(rig, eyes, closed, rig(closed))
    assert set(lids) == {"left", "right"}
    assert all(lid.shows == 0 and lid.sticks_out_mm == 0 for lid in lids.values())
    assert measure_lids(rig, eyes, rig.default, rig(rig.default)) == {}, "open eyes are not looked at"
    ajar = measure_lids(rig, eyes, closed, rig(closed - 1 / 3))
    assert all(lid.shows == pytest.approx(1 / 3, abs=0.08) for lid in ajar.values())


def test_what_stands_before_an_eye_hides_it_though_it_is_no_lid():
    rig = Eyed(wall_mm=6 * RADIUS)
    eyes, closed = find_eyes(rig), np.ones(2, np.float32)
    ajar = measure_lids(rig, eyes, closed, rig(closed - 1 / 3))
    assert all(lid.shows == 0 for lid in ajar.values())
    corners = 4 * 20 * 41 + np.arange(4)
    assert not any(np.isin(corners, around).any() for around in eyes.around.values()), "no part of an eye's socket"


def test_an_eyeball_that_pops_out_of_its_lids_sticks_out_by_so_much():
    rig = Eyed(out_mm=2.0)
    closed = np.ones(2, np.float32)
    lids = measure_lids(rig, find_eyes(rig), closed, rig(closed))
    assert lids["left"].sticks_out_mm == pytest.approx(2 - (LID - RADIUS), abs=0.1) and lids["left"].shows > 0.5


class OpenSheet(PlainRig):
    """A mesh without any props."""

    controls, default = (), np.zeros(0, np.float32)
    mesh = Mesh(
        np.eye(3, dtype=np.float32),
        np.int32([[0, 1, 2]]),
        np.zeros((3, 2), np.float32),
        np.zeros(3, np.int32),
        ("face",),
    )


def test_a_rig_without_eyeballs_has_no_eyes():
    assert find_eyes(OpenSheet()) is None
