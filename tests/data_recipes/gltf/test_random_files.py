"""Files by the hundred: read as what they are, or refused in a sentence."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from gltf_writer import Gltf
from random_gltf import Truth, random_gltf

from data_recipes.gltf.gltf_face import GltfFace, read_gltf
from replicate.base.exceptions import InputError

SEED = int(os.environ.get("GLTF_SEED", "0"))
CLOSE = {"rtol": 1e-6, "atol": 1e-6}


def agree(face: GltfFace, truth: Truth, nodes: list[dict]) -> None:
    """Assert that a face is what the file was made of."""
    counts = [len(vertices) for vertices in truth.vertices]
    firsts = np.cumsum([0, *counts])
    np.testing.assert_allclose(face.vertices, np.concatenate(truth.vertices), **CLOSE)
    faces = [own + first for own, first in zip(truth.faces, firsts, strict=False)]
    np.testing.assert_array_equal(face.faces, np.concatenate(faces))
    assert face.nodes == tuple(name for name, own in zip(truth.nodes, faces, strict=True) for _ in own)
    sets = [f"TEXCOORD_{k}" for k in range(3)]
    whole = [name for name in sets if all(name in own for own in truth.uv)]
    chosen = (whole or [name for name in sets if any(name in own for own in truth.uv)] or [""])[0]
    assert face.has_uv.tolist() == [chosen in own for own, n in zip(truth.uv, counts, strict=True) for _ in range(n)]
    assert (face.uv is None) == (chosen == "")
    for own, first, count in zip(truth.uv, firsts, counts, strict=False):
        if chosen in own:
            np.testing.assert_allclose(face.uv[first : first + count], own[chosen], **CLOSE)
    assert set(face.targets) == set(face.weights) == {name for own in truth.targets for name in own}
    for name, offsets in face.targets.items():
        known = [own.get(name, np.zeros((n, 3))) for own, n in zip(truth.targets, counts, strict=True)]
        np.testing.assert_allclose(offsets, np.concatenate(known), **CLOSE)
    if not any(own is not None for own in truth.joints):
        assert face.skin is None
        return
    known = np.concatenate(
        [np.zeros((n, len(nodes))) if own is None else own for own, n in zip(truth.joints, counts, strict=True)]
    )
    skin, world, columns = face.skin, [], []
    for parent, local, bind in zip(skin.parents, skin.local, skin.bind, strict=True):
        world.append(local if parent < 0 else world[parent] @ local)
        np.testing.assert_allclose(world[-1] @ bind, np.eye(4), atol=1e-6)
        columns.append(min(truth.bones, key=lambda node: np.abs(truth.bones[node] - world[-1]).max()))
        np.testing.assert_allclose(world[-1], truth.bones[columns[-1]], **CLOSE)
    assert len(set(columns)) == len(columns) and known.sum() == pytest.approx(known[:, columns].sum())
    np.testing.assert_allclose(skin.weights.toarray(), known[:, columns], **CLOSE)


def spoil(tree: dict, rng: np.random.Generator) -> None:
    """Change one value somewhere in a file's JSON into what it shouldn't be."""
    places = []

    def walk(table: dict | list) -> None:
        for key, value in table.items() if isinstance(table, dict) else enumerate(table):
            places.append((table, key))
            if isinstance(value, (dict, list)):
                walk(value)

    walk(tree)
    table, key = places[rng.integers(len(places))]
    values = [None, -1, 0, 1, 3, 2**31, 2**63, 10**30, 1.5, 1e300, True, "", "POSITION", [], [0], {}, [[]], "\ud800\n"]
    table[key] = values[rng.integers(len(values))]


@pytest.mark.parametrize("part", range(6))
def test_300_random_files_are_read_as_they_were_made(tmp_path, part):
    names = ("a.glb", "a.vrm", "a.gltf")
    for k in range(50):
        rng = np.random.default_rng([SEED, part, k])
        g, truth = random_gltf(rng)
        file = g.write(tmp_path / names[k % 3], embedded=k % 2 == 0)
        if not sum(map(len, truth.faces)):
            with pytest.raises(InputError, match="expected a scene with triangles"):
                read_gltf(file)
            continue
        try:
            agree(read_gltf(file), truth, g.tree["nodes"])
        except (AssertionError, InputError) as error:
            raise AssertionError(f"file {k} of {[SEED, part]}: {error}") from error


@pytest.mark.parametrize("part", range(6))
def test_300_spoilt_files_are_read_or_refused_in_a_sentence(tmp_path, part):
    refusals = 0
    for k in range(50):
        rng = np.random.default_rng([SEED, 100 + part, k])
        g, _ = random_gltf(rng)
        for _ in range(1 + rng.integers(2)):
            spoil(g.tree, rng)
        refusals += is_refused(write_spoilt(g, tmp_path / "a.glb", rng))
    assert refusals > 10


def write_spoilt(g: Gltf, file: Path, rng: np.random.Generator) -> Path:
    """Write a file, some of them with bytes that are others or are missing."""
    data = bytearray(g.glb())
    if rng.random() < 0.2:
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
    if rng.random() < 0.1:
        del data[rng.integers(len(data)) :]
    file.write_bytes(data)
    return file


def is_refused(file: Path) -> bool:
    """Return whether a file is refused: in one sentence, or else what is read is whole."""
    try:
        face = read_gltf(file)
    except InputError as error:
        text = str(error)
        assert text.startswith(f"{file}: ") and "\n" not in text and len(text) < 600
        return True
    assert len(face.faces) and 0 <= face.faces.min() <= face.faces.max() < len(face.vertices)
    assert len(face.nodes) == len(face.materials) == len(face.faces)
    for array in (face.vertices, *face.targets.values(), *([] if face.uv is None else [face.uv])):
        assert len(array) == len(face.vertices) and np.isfinite(array).all()
    json.dumps([face.nodes, face.materials, list(face.targets)]).encode()
    return False
