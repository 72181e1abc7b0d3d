"""The nearest training pose: what a look-up table would give."""

import numpy as np

from replicate.methods import artefacts
from replicate.methods.method import Method

COUNT = 1_000  # training poses in the table


def tabulate(context):  # runs once; what it writes to context.out is kept as long as nothing behind it changes
    samples = artefacts.load_samples(context.inputs)
    chosen = np.linspace(0, len(samples) - 1, min(COUNT, len(samples))).astype(int)
    np.save(context.out / "params.npy", samples.params[chosen])
    np.save(context.out / "offsets.npy", samples.offsets(chosen))
    context.note(size_mb=samples.offsets(chosen).nbytes / 1e6)


def stages(plan):
    return (plan.stage("nearest", tabulate, None, artefacts.samples_stage(plan)),)


def load(inputs, settings):  # rig parameters (b, m) → vertices (b, n, 3), mm
    params, offsets = (np.load(inputs["nearest"] / f"{name}.npy") for name in ("params", "offsets"))
    neutral = artefacts.load_mesh(inputs).neutral
    return lambda wanted: neutral + offsets[[np.square(params - pose).sum(1).argmin() for pose in wanted]]


METHOD = Method("nearest", "Nearest pose", stages, load, note="The training pose whose parameters are nearest.")
