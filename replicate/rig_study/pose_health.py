"""Which of thousands of poses are broken, and how badly: their skin and, on request, mouth and lids."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from data_recipes.rig import Rig
from replicate.approximation.samples import evaluate
from replicate.base.progress import progress
from replicate.geometry.mesh import Mesh, face_vectors
from replicate.rig_study.eyelids import Eyes, Lids, measure_lids
from replicate.rig_study.mouth_contents import Mouth, deepest, depths

# The skin in a pose: is it torn, folded over or far away, however the head as a whole moves.

INSIDE = ("tooth", "teeth", "gum", "tongue", "mouth", "lid")  # beginnings of the names of segments that are not skin


@dataclass(frozen=True)
class Skin:
    """A mesh's skin. Triangles that look flipped at rest already are never counted as flipped."""

    mesh: Mesh

    @cached_property
    def face_indices(self) -> Int[np.ndarray, " f"]:
        """The indices of the skin's triangles among the mesh's."""
        skin = [not name.startswith(INSIDE) for name in self.mesh.segment_names]
        return np.flatnonzero(np.array(skin)[self.mesh.segment[self.mesh.faces]].all(1))

    @cached_property
    def faces(self) -> Int[np.ndarray, "f 3"]:
        """The skin's triangles."""
        return self.mesh.faces[self.face_indices]

    @cached_property
    def _around(self) -> sparse.csr_matrix:
        """The triangles about each triangle: (f, f), 1 for a shared vertex, 2 for a shared edge, 0 for itself."""
        f = len(self.faces)
        corner = sparse.csr_matrix((np.ones(3 * f, np.float32), (np.repeat(np.arange(f), 3), self.faces.ravel())))
        around = (corner @ corner.T).tolil()
        around.setdiag(0)
        return around.tocsr()

    @cached_property
    def _sharp(self) -> Bool[np.ndarray, " f"]:
        return self._is_against_mean(self.mesh.neutral[None])[0]

    def _is_against_mean(self, vertices: np.ndarray) -> Bool[np.ndarray, "b f"]:
        vectors = face_vectors(vertices, self.faces)
        f = len(self.faces)
        mean = self._around @ np.ascontiguousarray(vectors.transpose(1, 0, 2)).reshape(f, -1)
        return (mean.reshape(f, -1, 3).transpose(1, 0, 2) * vectors).sum(-1) < 0

    def flipped(self, vertices: Float[np.ndarray, "b n 3"]) -> Bool[np.ndarray, "b f"]:
        """Return which of the skin's triangles are flipped in each pose."""
        return self._is_against_mean(vertices) & ~self._sharp

    def furthest(self, vertices: Float[np.ndarray, "b n 3"]) -> Float[np.ndarray, " b"]:
        """Return how far the furthest vertex is from the head's middle, in sizes of the head: 1 in the neutral pose."""
        centre = self.mesh.neutral.mean(0)
        size = np.linalg.norm(self.mesh.neutral - centre, axis=1).max()
        return np.linalg.norm(vertices - centre, axis=-1).max(-1) / size


@dataclass(frozen=True)
class Health:
    """What is broken in some poses; arrays have one entry a pose.

    params: raw rig parameters
    bad: how many vertices are NaN or infinite; such poses have zeros for all else
    flipped: share of the skin's triangles that are flipped
    furthest: distance of the furthest vertex from the middle, in head sizes
    through: kind of mouth part → depth in mm; empty if not measured
    lids: (pose, side, Lids) for each eye that blinks fully
    """

    params: Float[np.ndarray, "b m"]
    bad: np.ndarray
    flipped: np.ndarray
    furthest: np.ndarray
    through: dict[str, np.ndarray] = field(default_factory=dict)
    lids: tuple[tuple[int, str, Lids], ...] = ()


def measure(
    rig: Rig,
    params: Float[np.ndarray, "b m"],
    skin: Skin,
    mouth: Mouth | None = None,
    eyes: Eyes | None = None,
    label: str = "poses",
) -> Health:
    """Evaluate a rig at many poses and return what is broken in them.

    params: raw rig parameters
    skin: the rig's
    mouth: the rig's; None leaves it out
    eyes: the rig's; None leaves them out
    label: the progress bar's
    """
    count = len(params)
    bad, flipped, furthest = np.zeros(count, int), np.zeros(count), np.zeros(count)
    kinds = mouth.kinds if mouth is not None else ()
    through = {kind: np.zeros(count) for kind in kinds}
    lids = []
    with progress(count, label) as bar:
        for rows, vertices in evaluate(rig, np.asarray(params, np.float32)):
            finite = np.isfinite(vertices).all(-1)
            bad[rows] = (~finite).sum(-1)
            sound = np.flatnonzero(finite.all(-1))
            at = sound + rows.start
            flipped[at] = skin.flipped(vertices[sound]).mean(-1)
            furthest[at] = skin.furthest(vertices[sound])
            for k, pose in zip(sound, at, strict=True):
                if mouth is not None:
                    for kind, value in deepest(mouth, depths(mouth, vertices[k])).items():
                        through[kind][pose] = value
                if eyes is not None:
                    by_side = measure_lids(rig, eyes, params[pose], vertices[k])
                    lids += [(int(pose), side, lid) for side, lid in by_side.items()]
            bar.update(len(vertices))
    return Health(np.asarray(params), bad, flipped, furthest, through, tuple(lids))


def worst(values: np.ndarray, count: int) -> np.ndarray:
    """Return the indices of the largest values above 0, largest first."""
    order = np.argsort(-values, kind="stable")[:count]
    return order[values[order] > 0]


def strongest(controls: Sequence, params: Float[np.ndarray, " m"], count: int = 5) -> str:
    """Return the controls that a pose uses most, with their values as shares of their limits, in words."""
    reach = np.array([max(abs(c.upper - c.default), abs(c.lower - c.default)) for c in controls])
    used = (params - np.array([c.default for c in controls])) / reach
    order = np.argsort(-np.abs(used), kind="stable")[:count]
    return ", ".join(f"{controls[k].name} {used[k]:+.2f}" for k in order if used[k])


def each_alone(rig: Rig) -> tuple[list[str], Float[np.ndarray, "b m"]]:
    """Return poses of one control each, at its ends: names as "jaw_open 1", and parameters (b, m)."""
    names, poses = [], []
    for k, control in enumerate(rig.controls):
        for value in (control.lower, control.upper):
            if value != control.default:
                pose = rig.default.copy()
                pose[k] = value
                names.append(f"{control.name} {value:g}")
                poses.append(pose)
    return names, np.stack(poses)
