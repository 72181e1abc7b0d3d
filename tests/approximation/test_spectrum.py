"""Errors by frequency: waves of a mesh, and what is left of an error without the slow ones."""

import numpy as np
import pytest

from replicate.approximation.spectrum import Spectrum, Waves, laplacian, octaves, slow_waves
from replicate.geometry.mesh import Mesh

SIDE = 16


def plate(parts: int = 1, height: float = 0.0) -> Mesh:
    """Return flat square plates of SIDE × SIDE vertices, 1 mm apart from each other in a plate."""
    grid = np.stack(np.meshgrid(*[np.arange(SIDE)] * 2, indexing="ij"), -1).reshape(-1, 2).astype(np.float32)
    corner = np.arange(SIDE * (SIDE - 1)).reshape(-1, SIDE)[:, :-1].ravel()
    square = np.stack([corner, corner + SIDE, corner + SIDE + 1, corner, corner + SIDE + 1, corner + 1], -1)
    faces = np.concatenate([square.reshape(-1, 3) + k * len(grid) for k in range(parts)])
    flat = np.concatenate([grid + np.array((0, 100 * k)) for k in range(parts)])
    vertices = np.column_stack([flat, np.full(len(flat), height)]).astype(np.float32)
    uv = np.tile(grid / (SIDE - 1), (parts, 1))
    segment = np.repeat(np.arange(parts), len(grid))
    return Mesh(vertices, faces, uv, segment, tuple(f"plate_{k}" for k in range(parts)))


@pytest.fixture(scope="module")
def waves() -> Waves:
    mesh = plate()
    return slow_waves(mesh, np.ones(len(mesh.neutral), bool), 32)


def cosine(times: float, mesh: Mesh) -> np.ndarray:
    """Return one pose whose errors are a cosine of so many half turns along the plate, across it, in mm."""
    along = np.cos(np.pi * times * mesh.neutral[:, 0] / (SIDE - 1))
    return np.stack([0 * along, 0 * along, along], -1)[None]


def test_areas_add_up_and_the_laplacian_of_a_flat_plate_gives_nothing_for_a_line_but_at_its_rim():
    mesh = plate()
    stiffness, areas = laplacian(mesh.neutral.astype(float), mesh.faces)
    assert areas.sum() == pytest.approx((SIDE - 1) ** 2)
    bent = (stiffness @ mesh.neutral[:, 0].astype(float)).reshape(SIDE, SIDE)
    assert np.abs(bent[1:-1]).max() < 1e-9 < np.abs(bent[0]).min()
    assert np.abs(stiffness @ np.ones(len(areas))).max() < 1e-9


def test_waves_are_orthonormal_by_area_and_have_the_frequencies_of_a_plate(waves):
    gram = waves.basis.T @ (waves.basis * waves.areas[:, None])
    assert np.abs(gram - np.eye(len(waves.frequencies))).max() < 1e-5
    assert waves.frequencies[0] == pytest.approx(0, abs=1e-6)
    assert waves.frequencies[1:3] == pytest.approx([(np.pi / (SIDE - 1)) ** 2] * 2, rel=0.02)
    assert (np.diff(waves.frequencies) >= 0).all()


def test_the_same_mesh_has_the_same_waves():
    mesh = plate(2)
    first, second = (slow_waves(mesh, np.ones(len(mesh.neutral), bool), 16) for _ in range(2))
    assert np.array_equal(first.basis, second.basis)
    assert first.frequencies[:2] == pytest.approx([0, 0], abs=1e-6) and first.frequencies[2] > 1e-3, "one for each part"


def test_a_slow_error_has_nothing_of_high_frequency_and_a_quick_one_nothing_else(waves):
    mesh = plate()
    slow, quick = Spectrum(waves), Spectrum(waves)
    slow.add(cosine(1, mesh))
    checks = np.where((mesh.neutral[:, :2].sum(1) % 2) == 0, 1.0, -1.0)
    quick.add(np.stack([checks, 0 * checks, 0 * checks], -1)[None])
    of_slow, of_quick = ({name: value for name, _, value in each.metrics()} for each in (slow, quick))
    assert of_slow["high_frequency_share"] < 0.02 and of_quick["high_frequency_share"] > 0.95
    assert of_quick["high_frequency_error_mean"] == pytest.approx(1.0, abs=0.05)
    bands = [of_slow[f"frequency_band_{k}"] for k in range(7)]
    assert np.argmax(bands) in (1, 2), "the second and third wave are one half turn"


def test_bands_add_up_to_the_whole_squared_error_over_the_surface(waves):
    errors = np.random.default_rng(3).normal(size=(4, SIDE**2, 3))
    both = Spectrum(waves)
    both.add(errors[:1])
    both.add(errors[1:])
    whole = ((errors**2).sum(-1) @ (waves.areas / waves.areas.sum())).mean()
    bands = [value for name, _, value in both.metrics() if name.startswith("frequency_band_")]
    assert sum(root**2 for root in bands) == pytest.approx(whole, rel=1e-4)


def test_vertices_of_rigid_segments_and_waves_beyond_a_quarter_of_the_vertices_are_left_out(tmp_path):
    mesh = plate(2)
    waves = slow_waves(mesh, mesh.segment == 1, 10_000)
    assert waves.vertices.tolist() == list(range(SIDE**2, 2 * SIDE**2)) and len(waves.frequencies) == SIDE**2 // 4
    waves.save(tmp_path / "waves.npz")
    assert np.array_equal(Waves.load(tmp_path / "waves.npz").basis, waves.basis)


def test_an_error_of_nothing_has_no_share(waves):
    nothing = Spectrum(waves)
    nothing.add(np.zeros((1, SIDE**2, 3)))
    assert all(value == 0 for _, _, value in nothing.metrics())


def test_octaves_cover_all_waves_once():
    assert octaves(8) == [(0, 1), (1, 2), (2, 4), (4, 8)] and octaves(6)[-1] == (4, 6) and octaves(1) == [(0, 1)]
