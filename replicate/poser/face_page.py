"""The posing page of one character, and the poses that it is checked with."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from replicate.approximation.rigid import attach
from replicate.poser.contents import PosedFace, face_contents, halved
from replicate.poser.display_parts import display_contents
from replicate.poser.pack import Parts, indices, page


def face_page(face: PosedFace, rng: np.random.Generator, progress: Callable, made_by: str) -> str:
    """Return the HTML of a face's page. rng: draws the poses with which the page checks itself.

    progress: as `StageContext.progress`. made_by: where it comes from, in a sentence.
    """
    header, arrays = {}, {}
    for words, values in (face_contents(face), check_contents(face, rng), display_contents(face.rig, progress)):
        header |= words
        arrays |= values
    return page(header, arrays, made_by)


# Poses with their known answers, with which a page can check its arithmetic on any machine.

VERTICES = 1_500  # whose right places the page knows, spread over the mesh
POSES = 4
PULL_MM = 6.0  # how far the control points of a check are pulled, at most, along each axis


@dataclass(frozen=True)
class Answers:
    """Python's results for some poses.

    targets: (b, c, 3) control points, mm. solved: (b, m) rig parameters that the IK networks give for them. params:
    (b, m) rig parameters within their limits. vertices: (b, n, 3) mm, of the approximation for `params`.
    """

    targets: Float32[np.ndarray, "b c 3"]
    solved: Float32[np.ndarray, "b m"]
    params: Float32[np.ndarray, "b m"]
    vertices: Float32[np.ndarray, "b n 3"]


def answers(face: PosedFace, rng: np.random.Generator) -> Answers:
    """Return random poses of the controls and of the control points, and Python's results for them."""
    rig = face.rig
    rest = face.ik.neutral.numpy()
    targets = rest + rng.uniform(-PULL_MM, PULL_MM, (POSES, *rest.shape)).astype(np.float32)
    share = rng.uniform(0, 1, (POSES, len(rig.controls))) * (rng.uniform(0, 1, (POSES, len(rig.controls))) < 0.3)
    ends = np.where(rng.uniform(0, 1, share.shape) < 0.5, rig.lower, rig.upper)
    params = (rig.default + share * (ends - rig.default)).astype(np.float32)
    vertices = posed_vertices(face, params)
    return Answers(targets, halved(face.ik).solve(targets), params, vertices)


def posed_vertices(face: PosedFace, params: Float[np.ndarray, "b m"]) -> Float32[np.ndarray, "b n 3"]:
    """Return an approximation's face with its rigid segments in place, mm; a single pose by a fast evaluation."""
    if len(params) == 1 and face.evaluate:
        return face.evaluate(params)
    mesh = face.rig.mesh
    return attach(mesh, face.attachments, mesh.neutral + face.model.offsets(params))


def check_contents(face: PosedFace, rng: np.random.Generator) -> Parts:
    """Return the answers at some of the vertices, as a page carries them."""
    known = answers(face, rng)
    count = len(face.rig.mesh.neutral)
    shown = np.unique(np.linspace(0, count - 1, min(VERTICES, count)).astype(int))
    return {"checks": POSES}, {
        "check.targets": known.targets,
        "check.solved": known.solved,
        "check.params": known.params,
        "check.shown": indices(shown, count),
        "check.vertices": np.ascontiguousarray(known.vertices[:, shown]),
    }
