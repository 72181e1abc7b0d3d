"""Training, validation and test poses of a rig that is known by its samples alone: all are among these.

With clips, test and validation poses are frames that are held out as of any animation (D3). Training poses are those
that whoever brought the rig has drawn (Eq. 5), less those drawn from a frame that is held out, as far as it is known
what each was drawn from. Where they are fewer than half of what the configuration asks for, training frames join them;
not where they are more, since frames are nearer to the test poses than what Eq. 5 draws, and errors would be smaller.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float32

from data_recipes.rig import Clip, KnownPoses
from replicate.approximation.sampling import hold_out, split_clips, split_frames
from replicate.config import SamplesConfig
from replicate.engine.exceptions import InputError

ENOUGH = 0.5  # of the training poses that are asked for
PARTS = ("training", "validation", "test")


def choose_known(
    known: KnownPoses, clips: Sequence[Clip] | None, config: SamplesConfig, rng: Callable[[str], np.random.Generator]
) -> dict[str, Float32[np.ndarray, "k m"]]:
    """Return known poses by part: "training", "validation" and "test".

    Without clips all poses are split like the frames of one clip, and the test keeps `config.uniform_test` of them at
    most. rng: a stream's name → its generator. Raises InputError where a part would be empty.
    """
    split = split_clips if clips and config.split == "clips" else split_frames
    values = [clip.values for clip in clips] if clips else [np.asarray(known.frame_params)]
    animation, test = split(values, rng("split"), config.held_out)
    animation, validation = hold_out(animation, config.validation, rng("validation"))
    if not clips:
        test = _some(test, config.uniform_test, rng("uniform_test"))
        training = animation
    else:
        held_out = {pose.tobytes() for pose in (*test, *validation)}
        leaks = np.array([pose.tobytes() in held_out for pose in np.asarray(known.frame_params)])
        source = np.asarray(known.drawn_source)
        fit = (source < 0) | ~leaks[source]  # −1 reads the last frame, and doesn't count
        fit &= np.array([pose.tobytes() not in held_out for pose in np.asarray(known.drawn_params)], bool)
        training = np.asarray(known.drawn_params)[fit]
        if len(training) < ENOUGH * config.count:
            training = np.concatenate([training, _some(animation, config.count - len(training), rng("frames"))])
    training = _some(training, config.count, rng("training"))
    if not len(training):
        raise InputError("the samples: no pose is left to train on; allowed is one at least")
    return dict(zip(PARTS, (training, validation, test), strict=True))


def _some(poses: np.ndarray, count: int, generator: np.random.Generator) -> np.ndarray:
    """Return so many of some poses at most, drawn at random, in their order."""
    if len(poses) <= count:
        return poses
    return poses[np.sort(generator.choice(len(poses), count, replace=False))]
