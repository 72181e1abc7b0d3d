"""Random glTF files with features that files in the world have, and what each must be read as."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gltf_writer import Gltf
from scipy.spatial.transform import Rotation

NAMES = ("head", "head", "eye", "顔", "", None)
TARGETS = ("jawOpen", "smile", "blink", "jawOpen")
LIMITS = {"i1": 127, "u1": 255, "i2": 32767, "u2": 65535}


@dataclass
class Truth:
    """What a file must be read as.

    An entry a part: vertices, faces from 0 on, sets of texture coordinates, name of the node, targets, and the weights
    of vertices (rows) and nodes of the file (columns). bones: where each joint is, by its node.
    """

    vertices: list[np.ndarray] = field(default_factory=list)
    faces: list[np.ndarray] = field(default_factory=list)
    uv: list[dict[str, np.ndarray]] = field(default_factory=list)
    nodes: list[str] = field(default_factory=list)
    targets: list[dict[str, np.ndarray]] = field(default_factory=list)
    joints: list[np.ndarray | None] = field(default_factory=list)
    bones: dict[int, np.ndarray] = field(default_factory=dict)


@dataclass
class Primitive:
    """A primitive as it is in its mesh: vertices without transforms, faces, target → offsets, joints of a vertex."""

    entry: dict[str, Any]
    vertices: np.ndarray
    faces: np.ndarray
    uv: dict[str, np.ndarray]
    targets: list[np.ndarray]
    weights: np.ndarray | None


def chance(rng: np.random.Generator, share: float) -> bool:
    return bool(rng.random() < share)


def stored(g: Gltf, rng: np.random.Generator, values: np.ndarray) -> tuple[int, np.ndarray]:
    """Add an accessor of these values in some type, perhaps sparse or padded, and return it with what it holds."""
    pad = int(rng.choice([0, 0, 4, 12]))
    dtype = "f4" if chance(rng, 0.6) else str(rng.choice([*LIMITS]))
    if dtype == "f4":
        held = values.astype(np.float32)
        if chance(rng, 0.25):
            some = np.sort(rng.choice(len(held), rng.integers(1, len(held)), replace=False))
            if chance(rng, 0.5):
                base = np.zeros_like(held)
                base[some] = held[some]
                return g.numbers(held.shape, sparse=(some, held[some])), base.astype(float)
            other = held.copy()
            other[some] = rng.normal(size=other[some].shape)
            return g.numbers(other, pad=pad, sparse=(some, held[some])), held.astype(float)
        return g.numbers(held, pad=pad), held.astype(float)
    limit, normalized = LIMITS[dtype], chance(rng, 0.5)
    values = np.clip(values, 0 if dtype[0] == "u" else -1, 1)
    whole = np.rint(values * (limit if normalized else 9)).astype(dtype)
    pad = -whole[0].nbytes % 4 + pad
    held = whole / limit if normalized else whole.astype(float)
    return g.numbers(whole, dtype, pad=pad, **({"normalized": True} if normalized else {})), held


def shape(g: Gltf, rng: np.random.Generator, count: int) -> tuple[dict[str, Any], np.ndarray]:
    """Return mode and indices of a primitive of so many vertices, and the triangles that they mean, [] for points."""
    mode = int(rng.choice([0, 1, 3, 4, 4, 4, 4, 5, 6, 6]))
    corners, entry = np.arange(count), {} if mode == 4 and chance(rng, 0.5) else {"mode": mode}
    if chance(rng, 0.8) or (mode == 4 and count % 3):
        corners = rng.integers(0, count, 3 * rng.integers(1, 8))
        dtype = str(rng.choice(["u1", "u2", "u4"]))
        entry["indices"] = g.numbers(corners[:, None], dtype)
    c = corners.tolist()
    triangles = {
        4: [c[k : k + 3] for k in range(0, len(c), 3)],
        5: [c[k : k + 3] if k % 2 == 0 else [c[k], c[k + 2], c[k + 1]] for k in range(len(c) - 2)],
        6: [[c[k + 1], c[k + 2], c[0]] for k in range(len(c) - 2)],
    }.get(mode, [])
    solid = [face for face in triangles if mode == 4 or len(set(face)) == 3]
    return entry, np.array(solid, int).reshape(-1, 3)


def primitive(g: Gltf, rng: np.random.Generator, joints: int, targets: int) -> Primitive:
    count = int(rng.integers(3, 13))
    place, vertices = stored(g, rng, rng.normal(size=(count, 3)) / 2)
    attributes, uv = {"POSITION": place}, {}
    for k in range(3):
        if chance(rng, 0.5):
            attributes[f"TEXCOORD_{k}"], held = stored(g, rng, rng.uniform(0, 1, (count, 2)))
            uv[f"TEXCOORD_{k}"] = held * [1, -1] + [0, 1]
    offsets, entries = [], []
    for _ in range(targets):
        kind = rng.integers(4)
        entries.append({"NORMAL": g.numbers(np.zeros((count, 3)))} if kind == 0 else {})
        offsets.append(np.zeros((count, 3)))
        if kind > 0:
            entries[-1]["POSITION"], offsets[-1] = stored(g, rng, rng.normal(size=(count, 3)) / 5)
    weights = None
    if joints:
        weights = np.zeros((count, joints))
        for k in range(1 + chance(rng, 0.3)):
            which = rng.integers(0, joints, (count, 4))
            shares = rng.integers(0, 256, (count, 4)) * (rng.random((count, 4)) < 0.6)
            shares[:, 0] += k == 0
            shares = np.minimum(shares, 255)
            attributes[f"JOINTS_{k}"] = g.numbers(which, str(rng.choice(["u1", "u2"])))
            dtype = str(rng.choice(["u1", "f4"]))
            normal = {"normalized": True} if dtype == "u1" else {}
            attributes[f"WEIGHTS_{k}"] = g.numbers(shares if normal else shares / 255, dtype, **normal)
            np.add.at(weights, (np.arange(count)[:, None], which), shares)
        weights /= weights.sum(axis=1, keepdims=True)
    entry, faces = shape(g, rng, count)
    entry |= {"attributes": attributes} | ({"targets": entries} if entries else {})
    return Primitive(entry, vertices, faces, uv, offsets, weights)


def transform(rng: np.random.Generator, still: float) -> tuple[dict[str, Any], np.ndarray]:
    """Return a node's transform as it is written, perhaps as a matrix, mirrored; none at all with a chance of still."""
    if chance(rng, still):
        return {}, np.eye(4)
    turn, scale, shift = (
        Rotation.random(random_state=int(rng.integers(2**31))),
        rng.uniform(0.5, 2, 3),
        rng.normal(size=3),
    )
    scale = scale * rng.choice([1, 1, 1, -1], 3)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.as_matrix() * scale, shift
    if chance(rng, 0.4):
        return {"matrix": matrix.T.ravel().tolist()}, matrix
    parts = {"rotation": turn.as_quat().tolist(), "scale": scale.tolist(), "translation": shift.tolist()}
    return parts, matrix


def random_gltf(rng: np.random.Generator) -> tuple[Gltf, Truth]:
    """Return a random file and what it must be read as."""
    g, total = Gltf(), int(rng.integers(2, 9))
    bones = int(rng.choice([0, 0, 1, 3]))
    # nodes: each below an earlier one or a root; joints are the last of them
    parents = [-1 if k == 0 or chance(rng, 0.4) else int(rng.integers(k)) for k in range(total + bones)]
    order = rng.permutation(total + bones)  # of nodes in the file
    at = np.argsort(order)
    entries, world = [{} for _ in order], [np.eye(4)] * len(order)
    children = {int(k): [int(at[c]) for c in rng.permutation(len(order)) if parents[c] == k] for k in range(len(order))}
    for k, parent in enumerate(parents):
        written, local = transform(rng, 0.25 if k < total else 0)
        world[k] = local if parent < 0 else world[parent] @ local
        name = NAMES[rng.integers(len(NAMES))]
        entries[at[k]] |= written | ({"name": name} if name is not None else {})
        if children[k]:
            entries[at[k]]["children"] = children[k]
    # skins
    binds = rng.normal(size=(bones, 4, 4)) / 3 + np.eye(4) if bones else np.zeros((0, 4, 4))
    binds[:, 3] = [0, 0, 0, 1]
    binds = binds.astype(np.float32).astype(float)
    skins, joint_nodes = int(bones > 0) + chance(rng, 0.3) * (bones > 1), [[*range(total, total + bones)]]
    for k in range(skins):
        own = slice(k, None)
        joint_nodes.append([int(at[node]) for node in joint_nodes[0][own]])
        matrices = g.numbers(binds[own].transpose(0, 2, 1).reshape(-1, 16))
        g.add("skins", joints=joint_nodes[-1], inverseBindMatrices=matrices)
    # meshes
    meshes = []
    for _ in range(int(rng.integers(1, 4))):
        skin = int(rng.integers(skins)) if skins and chance(rng, 0.7) else None
        targets = int(rng.choice([0, 0, 1, 3]))
        joints = bones - skin if skin is not None else 0
        found = [primitive(g, rng, joints, targets) for _ in range(rng.integers(1, 4))]
        mesh: dict[str, Any] = {"primitives": [part.entry for part in found]}
        names = [f"target_{k:02d}" for k in range(targets)]
        if targets and chance(rng, 0.6):
            names = [str(name) for name in rng.choice(["jawOpen", "smile", "blink", "wide"], targets, replace=False)]
            owner = mesh if chance(rng, 0.6) else None
            for holder in [owner] if owner is not None else mesh["primitives"]:
                holder["extras"] = {"targetNames": names}
        meshes.append((g.add("meshes", **mesh), found, names, skin))
    shown = {k: meshes[rng.integers(len(meshes))] for k in range(total) if k == 0 or chance(rng, 0.7)}
    for k, (index, _, _, skin) in shown.items():
        entries[at[k]] |= {"mesh": index} | ({"skin": skin} if skin is not None else {})
    g.tree["nodes"] = entries
    roots = [int(at[k]) for k in rng.permutation(len(order)) if parents[k] < 0]
    if chance(rng, 0.8):
        some = [[roots[0]], roots] if chance(rng, 0.5) else [roots]
        g.tree |= {"scenes": [{"nodes": own} for own in some], "scene": len(some) - 1}
    else:
        roots.sort()
    # what must be read: depth first
    truth, taken, stack = Truth(bones={int(at[k]): world[k] for k in range(total, len(order))}), set(), roots[::-1]
    while stack:
        k = int(order[stack.pop()])
        stack += children[k][::-1]
        if k not in shown:
            continue
        _, found, names, skin = shown[k]
        name = entries[at[k]].get("name") or f"node_{at[k]}"
        unique = next(n for n in (name, *(f"{name}_{j}" for j in range(2, 99))) if n not in taken)
        taken.add(unique)
        for part in found:
            if part.entry.get("mode", 4) < 4:
                continue
            place = np.tile(world[k], (len(part.vertices), 1, 1))
            joints = None
            if part.weights is not None:
                nodes = joint_nodes[0][skin:]
                placed = [world[node] @ bind for node, bind in zip(nodes, binds[skin:], strict=True)]
                place = sum(part.weights[:, j, None, None] * placed[j] for j in range(len(nodes)))
                joints = np.zeros((len(part.vertices), len(order)))
                joints[:, at[nodes]] = part.weights
            turn = place[:, :3, :3]
            faces = part.faces.copy()
            mirrored = np.linalg.det(turn)[faces[:, 0]] < 0
            faces[mirrored] = faces[mirrored][:, [0, 2, 1]]
            truth.vertices.append(np.einsum("nij,nj->ni", turn, part.vertices) + place[:, :3, 3])
            truth.faces.append(faces)
            truth.uv.append(part.uv)
            truth.nodes.append(unique)
            moved = [np.einsum("nij,nj->ni", turn, offsets) for offsets in part.targets]
            truth.targets.append(dict(zip(names, moved, strict=True)))
            truth.joints.append(joints)
    return g, truth
