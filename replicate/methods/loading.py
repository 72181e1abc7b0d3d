"""Every method of Table 2 as one kind of function, from rig parameters to a full posed mesh."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from replicate.approximation.evaluation import Predictor
from replicate.approximation.rigid import Attachments, attach
from replicate.geometry.mesh import Mesh


def load_predictor(settings, inputs: Mapping[str, Path], mesh: Mesh, attachments: Attachments) -> Predictor:
    """Return predict(params (b, m), truth (b, n, 3)) → vertices (b, n, 3) mm of one method.

    settings: its `method`, and what that needs besides. inputs: the artefacts of the stages that made it. LBS, the
    floors and "attachment" are oracles: they read the truth; the other methods do not.

    "attachment" is the rigid step alone: the true mesh with its rigid segments replaced by their placement.
    """
    method = settings.method
    if method == "neutral":
        return lambda params, truth: np.broadcast_to(mesh.neutral, truth.shape)
    if method.startswith("lbs"):
        return _skinned(inputs[method] / "skin.npz", settings)
    if method == "driven":
        driven = _network(method, inputs)
        return lambda params, truth: mesh.neutral + driven.offsets(params)
    deform = _deformation(settings, inputs, mesh)
    return lambda params, truth: attach(mesh, attachments, deform(params, truth))


def _deformation(settings, inputs: Mapping[str, Path], mesh: Mesh) -> Callable:
    """Return the method's deformable vertices; what it gives for rigid segments is replaced by their placement."""
    method = settings.method
    if method == "attachment":
        return lambda params, truth: truth
    if method.startswith("floor"):
        return _projected(settings, inputs, mesh)
    model = _network(method, inputs)
    return lambda params, truth: mesh.neutral + model.offsets(params)


def _network(method: str, inputs: Mapping[str, Path]):
    from replicate.approximation.training import prepare

    prepare("cpu")
    if method == "driven":
        from replicate.approximation.skinning.bone_network import load_driven

        return load_driven(inputs["driven"])
    if method == "dense":
        from replicate.approximation.dense import load_dense

        return load_dense(inputs["dense"])
    from replicate.approximation.cnn import load_coarse

    coarse = load_coarse(inputs["coarse"])
    if method == "coarse":
        return coarse
    from replicate.approximation.refinement import load_refined

    return load_refined(inputs["refined"], coarse)


def _projected(settings, inputs: Mapping[str, Path], mesh: Mesh) -> Callable:
    from replicate.approximation.deformation_map import Floor
    from replicate.approximation.segments import coarse_segments, load_segments

    moves = np.load(inputs["influence"] / "influence.npy")
    rigid = Attachments.load(inputs["rigid"] / "attachments.npz").segment
    segments = coarse_segments(mesh, rigid.tolist(), moves)
    refinement = load_segments(inputs["selection"] / "segments.npz") if settings.method == "floor_refined" else ()
    floor = Floor(segments, settings.map_size, refinement, settings.refined_map_size)
    return lambda params, truth: mesh.neutral + floor(truth - mesh.neutral)


def _skinned(file: Path, settings) -> Predictor:
    from replicate.approximation.skinning.ssdr import Skin, refit

    skin = Skin.load(file)

    def predict(params: np.ndarray, truth: np.ndarray) -> np.ndarray:
        return skin.deform(*refit(skin, truth, settings.refit_sweeps, settings.refit_settled))

    return predict
