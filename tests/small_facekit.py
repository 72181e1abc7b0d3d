"""A small folder in ICT-FaceKit's format, in cm: a mask of a face, quads and triangles, charts cut open, two teeth."""

import json
from pathlib import Path

import numpy as np

PARTS = ("face", "head", "mouth", "eye_socket_left", "eye_socket_right", "gums_tongue", "teeth")
BALLS = ("eyeball_left", "eyeball_right")
PIVOT, ANGLE = np.array([0.0, -0.5, 2.0]), np.deg2rad(20.0)
# Multi-PIE's points as (x, y) in cm: chin line, brows, nose, eyes, mouth; for a mask of about the model's size.
EYE = [(-0.13, 0.0), (-0.07, 0.05), (0.04, 0.05), (0.13, 0.0), (0.05, -0.04), (-0.06, -0.04)]
LEFT_EYE = [(-x, y) for x, y in (EYE[3], EYE[2], EYE[1], EYE[0], EYE[5], EYE[4])]
OUTER_LIPS = [(2.5 * np.cos(a), -3.5 + 0.9 * np.sin(a)) for a in np.deg2rad(np.arange(180, -180, -30))]
INNER_LIPS = [(2.0 * np.cos(a), -3.5 + 0.3 * np.sin(a)) for a in np.deg2rad(np.arange(180, -180, -45))]
MARKS = [
    *[(7 * np.sin(a), -1.0 - 6.5 * np.cos(a)) for a in np.deg2rad(np.linspace(-80, 80, 17))],
    *[(x, 5.9 - 0.03 * (x + 3) ** 2) for x in (-5.6, -4.7, -3.5, -2.3, -1.2)],
    *[(x, 5.9 - 0.03 * (x - 3) ** 2) for x in (1.2, 2.3, 3.5, 4.7, 5.6)],
    *[(0, y) for y in (3.7, 2.6, 1.6, 0.4)],
    *[(x, -1.2) for x in (-1.2, -0.6, 0, 0.6, 1.2)],
    *[(-3.15 + 10 * x, 3.5 + 10 * y) for x, y in EYE],
    *[(3.15 + 10 * x, 3.5 + 10 * y) for x, y in LEFT_EYE],
    *OUTER_LIPS,
    *INNER_LIPS,
]


def depth(x, y):
    """The mask's z."""
    return 12 - 0.085 * x**2 - 0.03 * (y - 1) ** 2


class _Obj:
    def __init__(self):
        self.v, self.vt, self.f, self.parts = [], [], [], {}

    def part(self, name, vertices, uv, quads, uv_quads=None):
        first, coordinate = len(self.v), len(self.vt)
        self.v += np.asarray(vertices, float).tolist()
        self.vt += np.asarray(uv, float).tolist()
        for quad, texture in zip(quads, quads if uv_quads is None else uv_quads, strict=True):
            self.f.append([(a + first, b + coordinate) for a, b in zip(quad, texture, strict=True)])
        start = self.parts.get(name, (first, 0))[0]
        self.parts[name] = (start, len(self.v) - 1)

    def text(self, offset=0.0):
        rows = [f"v {a:.6f} {b:.6f} {c:.6f}" for a, b, c in np.array(self.v) + offset]
        rows += [f"vt {a:.6f} {b:.6f}" for a, b in self.vt]
        rows += ["f " + " ".join(f"{a + 1}/{b + 1}" for a, b in corners) for corners in self.f]
        return "# a comment\n" + "\n".join(rows) + "\n"


def _grid(rows, columns):
    """Unit coordinates and quads of a grid."""
    v, u = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij"))
    at = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    return u, v, np.stack([at, at + 1, at + columns + 1, at + columns], 1).tolist()


def _mesh():
    obj = _Obj()
    u, v, quads = _grid(37, 31)
    x, y = 15 * u - 7.5, 19 * v - 8
    quads = [*quads[:-1], quads[-1][:3], [quads[-1][0], *quads[-1][2:]]]  # the last one as two triangles
    obj.part("face", np.stack([x, y, depth(x, y)], 1), np.stack([u, v], 1), quads)

    u, v, quads = _grid(7, 13)  # a tube whose chart is cut open: its first and last column are one
    angle = 2 * np.pi * u
    ring = lambda a: a // 13 * 12 + a % 13 % 12  # noqa: E731
    tube = np.stack([6 * np.cos(angle), -9 - 8 * v, 6 * np.sin(angle)], 1)[np.arange(91) % 13 != 12]
    obj.part("head", tube, np.stack([1 + u, v], 1), [[ring(a) for a in quad] for quad in quads], quads)

    def patch(name, centre, size, rows, columns):
        u, v, quads = _grid(rows, columns)
        flat = np.stack([size * (u - 0.5), size * (v - 0.5), -0.3 * ((u - 0.5) ** 2 + (v - 0.5) ** 2)], 1)
        obj.part(name, flat + centre, np.stack([2 + 0.4 * u, 0.3 + 0.4 * v], 1), quads)

    patch("mouth", (0, -3.5, 9.0), 3.0, 6, 7)
    patch("eye_socket_left", (3.15, 3.5, 8.5), 1.5, 5, 5)
    patch("eye_socket_right", (-3.15, 3.5, 8.5), 1.5, 5, 5)
    patch("gums_tongue", (0, -2.6, 9.5), 2.0, 4, 6)
    cube = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) - 0.5
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    for height in (-3.0, -4.0):
        corners = [(3.1 + i / 8 + 0.1 * (k in (1, 2)), 0.5 + 0.1 * (k > 1)) for i in range(6) for k in range(4)]
        obj.part("teeth", 0.8 * cube + (0, height, 10), corners, sides, np.arange(24).reshape(6, 4).tolist())

    lon, lat, quads = _grid(9, 13)
    a, b = 2 * np.pi * lon, np.pi * (0.02 + 0.96 * lat)
    ball = 1.4 * np.stack([np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b)], 1)
    for name, x in (("eyeball_left", 3.15), ("eyeball_right", -3.15)):
        obj.part(name, ball + np.array([x, 3.5, 8.0]), np.stack([5 + lon, lat], 1), quads)
    return obj


def _bump(v, x, y, radius):
    return np.exp(-((v[:, 0] - x) ** 2 + (v[:, 1] - y) ** 2) / radius**2)[:, None]


def expressions(obj):
    """Return the shapes' offsets in cm."""
    v = np.array(obj.v)
    skin = np.zeros(len(v), bool)
    skin[: obj.parts["mouth"][1] + 1] = True
    first, last = obj.parts["teeth"]
    lower = np.arange((first + last + 1) // 2, last + 1)
    jaw = np.clip((-2.5 - v[:, 1]) / 2.5, 0, 1) * np.clip((v[:, 2] - 2) / 4, 0, 1) * skin
    jaw[lower] = 1.0
    c, s = np.cos(ANGLE * jaw), np.sin(ANGLE * jaw)
    y, z = (v - PIVOT)[:, 1], (v - PIVOT)[:, 2]
    turned = np.stack([v[:, 0], c * y - s * z + PIVOT[1], s * y + c * z + PIVOT[2]], 1)
    side = {"L": 1.0, "R": -1.0}
    shapes = {
        "jawOpen": turned - v,
        "jawForward": jaw[:, None] * (0, 0, 0.8),
        "jawLeft": jaw[:, None] * (0.7, 0, 0),
        "jawRight": jaw[:, None] * (-0.7, 0, 0),
        "mouthClose": 0.8 * (v - turned) * _bump(v, 0, -3.9, 1.5),
        "mouthPucker": _bump(v, 0, -3.5, 2.0) * (0, 0, 0.9),
    }
    height = np.clip((v[:, 1] - 5) / 5, 0, 1)
    lift = np.where(v[:, 1] > 4, 1 - height, np.clip((v[:, 1] - 2) / 2, 0, 1))[:, None]
    above_lids = np.clip(v[:, 1:2] - 3.1, 0, 1.2)
    for letter, sign in side.items():
        half = 1 / (1 + np.exp(-sign * v[:, :1]))
        shapes |= {
            f"browInnerUp_{letter}": lift * half * np.exp(-((v[:, :1] / 3) ** 2)) * (0, 0.9, 0),
            f"browOuterUp_{letter}": lift * half * (1 - np.exp(-((v[:, :1] / 3) ** 2))) * (0, 0.8, 0),
            f"browDown_{letter}": lift * half * (-0.2 * sign, -0.5, 0),
            f"eyeBlink_{letter}": np.minimum(1, 1.5 * _bump(v, 3.15 * sign, 3.7, 1.3)) * above_lids * (0, -0.9, 0),
            f"eyeSquint_{letter}": _bump(v, 3.15 * sign, 2.9, 0.8) * (0, 0.3, 0),
            f"eyeLookUp_{letter}": _bump(v, 3.15 * sign, 4.2, 0.8) * (0, 0.3, 0),
            f"mouthSmile_{letter}": _bump(v, 2.5 * sign, -3.5, 1.6) * (0.6 * sign, 0.7, -0.3),
        }
    return {name: np.where(skin[:, None] | (jaw[:, None] > 0), offset, 0) for name, offset in shapes.items()}


def write_facekit(folder: Path) -> Path:
    """Write the folder, as the repository has it, and a recipe for it; return the recipe."""
    obj = _mesh()
    data = folder / "FaceXModel"
    data.mkdir(parents=True)
    shapes = expressions(obj)
    (data / "generic_neutral_mesh.obj").write_text(obj.text())
    for name, offset in shapes.items():
        (data / f"{name}.obj").write_text(obj.text(offset))
    x, y = np.array(obj.v)[: obj.parts["face"][1] + 1, :2].T
    marks = [int(np.argmin((x - a) ** 2 + (y - b) ** 2)) for a, b in MARKS]
    table = {"expressions": list(shapes), "idx_to_landmark_verts": marks}
    (data / "vertex_indices.json").write_text(json.dumps(table))
    recipe = folder / "mask.toml"
    parts = "".join(f"{name} = [{obj.parts[name][0]}, {obj.parts[name][1]}]\n" for name in (*PARTS, *BALLS))
    recipe.write_text(
        f'name = "mask"\nmodel = "ict_facekit"\nvertices = {len(obj.v)}\n[parts]\n{parts}'
        "[folds]\nrows = 5\n[acting]\nclips = 6\nclip_s = 3.0\n"
    )
    return recipe
