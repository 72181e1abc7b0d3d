"""The artefacts of a stand-in character on disk, as the stages of methods read them."""

import json
from pathlib import Path

import numpy as np
from small_face import M, SmallSamples, exact_samples, small_influence, small_mesh, small_samples

from replicate.approximation import spectrum
from replicate.approximation.rigid import find_attachments
from replicate.approximation.samples import quantise
from replicate.approximation.spectrum import slow_waves
from replicate.config import resolve
from replicate.engine.stage import StageContext
from replicate.methods import artefacts
from replicate.methods.measurement import reading
from replicate.methods.method import Method

SHOWN_POSE = 3


def write_artefacts(folder: Path, samples: SmallSamples | None = None) -> dict[str, Path]:
    """Write rig (its mesh alone), samples, influence, rigid segments, waves and the shown pose; return the folders."""
    mesh = small_mesh()
    samples = samples or small_samples(mesh)
    inputs = {name: folder / name for name in ("rig", "samples", "influence", "rigid", "waves", "wrinkled")}
    for place in inputs.values():
        place.mkdir(parents=True)
    mesh.save(inputs["rig"] / "mesh.npz")
    np.save(inputs["influence"] / "influence.npy", small_influence(mesh))
    attachments = find_attachments(mesh, mesh.neutral + samples.offsets(np.arange(32)), 0.3, 4)
    attachments.save(inputs["rigid"] / "attachments.npz")
    slow_waves(mesh, ~np.isin(mesh.segment, attachments.segment)).save(inputs["waves"] / spectrum.FILE)
    (inputs["wrinkled"] / artefacts.SHOWN_POSE).write_text(json.dumps({"pose": SHOWN_POSE}))
    offsets, steps = quantise(samples.offsets(np.arange(len(samples))))
    arrays = {
        "params": samples.params,
        "offsets": offsets,
        "steps": steps,
        "bins": np.zeros(len(steps), np.int16),
        "validation_params": samples.validation_params,
        "validation_offsets": samples.validation_offsets,
        "test_params": samples.validation_params,
        "test_offsets": samples.validation_offsets,
    }
    for name, array in arrays.items():
        np.save(inputs["samples"] / f"{name}.npy", array)
    (inputs["samples"] / "samples.json").write_text(json.dumps({"poses": len(steps), "default": [0.0] * M}))
    return inputs


def predicted(method: Method, inputs: dict[str, Path], params: np.ndarray) -> np.ndarray:
    """Return the vertices (b, n, 3), mm, that a method gives for parameters (b, m), read as the suite reads it."""
    read = reading(method, resolve("tiny", "quick"))
    return read.load(inputs, read.settings)(np.array(params))


def straight_samples() -> SmallSamples:
    """Return samples whose offsets are a linear function of the parameters, with a constant, that influence allows."""
    mesh, rng = small_mesh(), np.random.default_rng(3)
    moves = small_influence(mesh).T[:, :, None]
    slopes, constant = rng.normal(size=(M, len(mesh.neutral), 3)) * moves, rng.normal(size=(len(mesh.neutral), 3))
    constant *= (mesh.segment < 2)[:, None]
    training, fresh = (rng.uniform(-1, 1, (n, M)).astype(np.float32) for n in (200, 24))
    truth, held_out = ((np.tensordot(params, slopes, 1) + constant).astype(np.float32) for params in (training, fresh))
    return exact_samples(training, truth, fresh, held_out)


def run_stage(function, inputs: dict[str, Path], name: str, config, folder: Path) -> tuple[dict[str, Path], dict]:
    """Run a stage's function; return the inputs with its artefact among them, and what it noted."""
    out, scratch = folder / name, folder / f"{name}-scratch"
    out.mkdir()
    scratch.mkdir()
    context = StageContext(name, config, inputs, out, scratch)
    function(context)
    return inputs | {name: out}, context.notes
