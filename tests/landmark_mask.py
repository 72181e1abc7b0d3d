"""A mask with Multi-PIE's 68 points for vertices and a few of ARKit's shapes, as a GLB and as a folder of samples."""

from pathlib import Path

import numpy as np
from gltf_writer import Gltf
from scipy.spatial import Delaunay
from small_facekit import MARKS, depth

from data_recipes.catalogue import FACE_LANDMARKS

CORNERS = [(-9.0, -11.0), (9.0, -11.0), (9.0, 8.0), (-9.0, 8.0)]
PLACES = np.array([*MARKS, *CORNERS])
REST = 10 * np.column_stack([PLACES, depth(*PLACES.T)])  # (72, 3) mm
FACES = Delaunay(PLACES).simplices
LOW = PLACES[:, 1] < -2.5


def _shapes() -> dict[str, np.ndarray]:
    shapes = {
        name: np.zeros_like(REST)
        for name in (
            "jawOpen",
            "eyeBlinkLeft",
            "eyeBlinkRight",
            "mouthSmileLeft",
            "mouthSmileRight",
            "browInnerUp",
            "browDownLeft",
            "browDownRight",
        )
    }
    shapes["jawOpen"][LOW, 1] = 6 * (PLACES[LOW, 1] + 2.5)
    shapes["eyeBlinkLeft"][43:45, 1] = shapes["eyeBlinkRight"][37:39, 1] = -6
    shapes["mouthSmileLeft"][[53, 54, 55, 63, 64, 65]] = (4, 7, -2)
    shapes["mouthSmileRight"][[48, 49, 59, 60, 61, 67]] = (-4, 7, -2)
    shapes["browInnerUp"][20:24, 1] = 8
    shapes["browDownLeft"][22:27, 1] = shapes["browDownRight"][17:22, 1] = -6
    return shapes


SHAPES = _shapes()


def vertices_at(params: np.ndarray) -> np.ndarray:
    """Return the vertices (b, 72, 3) for weights (b, 8), mm."""
    return REST + np.tensordot(np.asarray(params, float), np.stack(list(SHAPES.values())), 1)


def write_glb(folder: Path, left_out: tuple[str, ...] = (), jaw: str = "jawOpen") -> Path:
    """Write mask.glb, whose middle vertices are there twice, and a face.toml with its landmarks but those left out.

    jaw: what the shape jawOpen is called.
    """
    folder.mkdir(parents=True, exist_ok=True)
    right = PLACES[FACES].mean(axis=1)[:, 0] < 0
    halves = [np.unique(FACES[side]) for side in (~right, right)]
    of_file = np.concatenate(halves)  # which of the mask's vertices each of the file's is
    place = [
        {vertex: first + k for k, vertex in enumerate(half)}
        for half, first in zip(halves, (0, len(halves[0])), strict=True)
    ]
    corners = np.array(
        [[place[int(side)][vertex] for vertex in face] for face, side in zip(FACES.tolist(), right, strict=True)]
    )
    g = Gltf(scene=0)
    primitive = {
        "attributes": {"POSITION": g.numbers(REST[of_file] / 1000)},
        "indices": g.numbers(corners.reshape(-1, 1), "u4"),
        "targets": [{"POSITION": g.numbers(shape[of_file] / 1000)} for shape in SHAPES.values()],
    }
    names = [jaw if name == "jawOpen" else name for name in SHAPES]
    g.add("scenes", nodes=[g.show(primitive, mesh={"extras": {"targetNames": names}}, name="Head")])
    (folder / "mask.glb").write_bytes(g.glb())
    numbers = {name: int(np.flatnonzero(of_file == number)[-1]) for name, number in FACE_LANDMARKS.items()}
    (folder / "face.toml").write_text("[acting]\nseed = 1\nclips = 12\n" + _named(numbers, left_out))
    return folder / "mask.glb"


def write_samples(folder: Path) -> Path:
    """Write the mask as a folder of samples that names its landmarks."""
    (folder / "poses").mkdir(parents=True)
    head = 'name = "mask"\nunit = "mm"\nup = "y"\nmesh = "mesh.obj"\nsegments = "groups"\n'
    (folder / "face.toml").write_text(head + _named(FACE_LANDMARKS))
    rows = "".join(f"{name},0,0,1,face\n" for name in SHAPES)
    (folder / "controls.csv").write_text("name,lower,default,upper,region\n" + rows)
    lines = [f"v {x} {y} {z}" for x, y, z in REST.tolist()]
    (folder / "mesh.obj").write_text(
        "\n".join([*lines, "g face", *(f"f {a} {b} {c}" for a, b, c in (FACES + 1).tolist())]) + "\n"
    )
    rng = np.random.default_rng(0)
    acted = rng.uniform(0, 1, (160, len(SHAPES))) * (rng.uniform(0, 1, (160, len(SHAPES))) < 0.4)
    acted[0] = 0
    acted = acted.astype(np.float32)
    poses = {"params": acted, "vertices": vertices_at(acted).astype(np.float32)}
    poses |= {"clip": np.array(["talk"] * 160), "frame": np.arange(160), "drawn": np.zeros(160, bool)}
    np.savez(folder / "poses" / "000.npz", **poses)
    return folder


def _named(numbers: dict[str, int], left_out: tuple[str, ...] = ()) -> str:
    lines = [f"{name} = {number}" for name, number in numbers.items() if name not in left_out]
    return "\n[points.face_landmarks]\n" + "\n".join(lines) + "\n"


def live_link(names=tuple(SHAPES), frames: int = 120) -> str:
    """Return a recording of Live Link Face, 60 frames a second, in which one shape after the other comes and goes."""
    lines = [",".join(["Timecode", "BlendShapeCount", *(name[0].upper() + name[1:] for name in names), "HeadYaw"])]
    for k in range(frames):
        weights = weights_at(k / 60, len(names))
        cells = [f"{weight:.6f}" for weight in weights]
        lines.append(",".join([f"10:00:{k // 60:02d}:{k % 60:02d}.000", "61", *cells, "0.1"]))
    return "\n".join(lines) + "\n"


def weights_at(seconds: float, count: int) -> np.ndarray:
    """Return the weights (count,) that `live_link` has at a time."""
    return np.exp(-(((seconds - 0.3 - 0.2 * np.arange(count)) / 0.15) ** 2))
