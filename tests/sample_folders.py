"""A small folder of samples for tests: a bent sheet with three controls."""

from pathlib import Path

import numpy as np

NAMES = ("jaw", "brow_up", "smile")
ROWS, COLUMNS = 6, 5
FACE = """\
name = "box"
unit = "mm"
up = "y"
mesh = "mesh.obj"
segments = "groups"
"""
CONTROLS = "name,lower,default,upper,region\njaw,0,0,1,mouth\nbrow_up,-1,0,1,brows\nsmile,0,0,1,mouth\n"


def neutral() -> np.ndarray:
    """Return a bent sheet of the size of a face, (30, 3) mm."""
    x, y = np.meshgrid(np.linspace(-90, 90, COLUMNS), np.linspace(-100, 100, ROWS))
    return np.stack([x.ravel(), y.ravel(), 60 - (x.ravel() / 15) ** 2], axis=1)


def vertices_at(params: np.ndarray) -> np.ndarray:
    """Return the vertices (b, 30, 3) of parameters (b, 3), mm."""
    rest, p = neutral(), np.asarray(params, float)
    low, high = np.maximum(-rest[:, 1], 0) / 100, np.maximum(rest[:, 1], 0) / 100
    moved = np.repeat(rest[None], len(p), axis=0)
    moved[:, :, 1] += -20 * p[:, :1] * low + 8 * p[:, 1:2] * high
    moved[:, :, 2] += 5 * p[:, 2:] * low + 3 * p[:, 1:2] ** 2 * high
    return moved


def obj(with_uv: bool = True) -> str:
    """Return the sheet as OBJ: quads in two groups."""
    lines = [f"v {x} {y} {z}" for x, y, z in neutral().tolist()]
    lines += [f"vt {k % COLUMNS / (COLUMNS - 1)} {k // COLUMNS / (ROWS - 1)}" for k in range(ROWS * COLUMNS)]
    for row in range(ROWS - 1):
        lines.append("g lower" if row < 3 else "g upper")
        for column in range(COLUMNS - 1):
            first = row * COLUMNS + column + 1
            corners = (first, first + 1, first + COLUMNS + 1, first + COLUMNS)
            lines.append("f " + " ".join(f"{k}/{k}" if with_uv else str(k) for k in corners))
    return "\n".join(lines) + "\n"


def shard(first: int, count: int = 20, seed: int = 0) -> dict[str, np.ndarray]:
    """Return the arrays of a shard: frames of a clip from `first` on, and as many poses drawn from them."""
    generator = np.random.default_rng([seed, first])
    acted = generator.uniform(0, 1, (count, 3))
    params = np.concatenate([acted, acted * generator.uniform(0.25, 3, acted.shape)]).astype(np.float32)
    return {
        "params": params,
        "vertices": vertices_at(params).astype(np.float32),
        "clip": np.array(["talk"] * 2 * count),
        "frame": np.tile(np.arange(first, first + count), 2),
        "drawn": np.repeat([False, True], count),
    }


def write(folder: Path, shards: int = 2) -> Path:
    """Write a good folder."""
    (folder / "poses").mkdir(parents=True)
    (folder / "face.toml").write_text(FACE)
    (folder / "controls.csv").write_text(CONTROLS)
    (folder / "mesh.obj").write_text(obj())
    for k in range(shards):
        np.savez(folder / "poses" / f"{k:03d}.npz", **shard(20 * k))
    return folder
