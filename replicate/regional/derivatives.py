"""The rig's exact derivatives at many poses, each along another direction: what Sobolev training fits as well.

Czarnecki et al. (Sobolev Training for Neural Networks, 2017) train a network on a function's values and on its
derivatives. A rig that JAX can trace gives the latter by forward differentiation.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Float32

from data_recipes.rig import BATCH, Rig


def derivative_batches(
    rig: Rig, params: Float[np.ndarray, "s m"], directions: Float[np.ndarray, "s m"]
) -> Iterator[Float32[np.ndarray, "b n 3"]]:
    """Yield ∂V/∂p · d in mm of each pose and its direction d, exactly, in batches.

    rig: one whose function JAX can trace, as it can those of our rigs.
    """
    import jax

    push = jax.jit(lambda poses, along: jax.jvp(rig.function, (poses,), (along,))[1])
    for start in range(0, len(params), BATCH):
        both = np.asarray([array[start : start + BATCH] for array in (params, directions)], np.float32)
        count = both.shape[1]
        padded = np.concatenate([both, np.repeat(both[:, -1:], BATCH - count, axis=1)], axis=1)
        yield np.asarray(push(*padded), np.float32)[:count]
