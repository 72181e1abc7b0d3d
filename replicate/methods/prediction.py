"""How a method is read from its artefacts: what it predicts, and how many multiplications that takes.

Both follow from the method's model where it has one; a method without a model brings functions of its own.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from replicate.artefacts import built_rig
from replicate.artefacts.plan import reference
from replicate.config import Config
from replicate.engine.exceptions import RunError
from replicate.engine.schema import cut
from replicate.engine.stage import stage_function
from replicate.methods.method import Method, Model

FAR_MM = 1e15  # where no vertex is; its square is a float32


@dataclass(frozen=True)
class ModelNumbers:
    """Which model is read: "module:function" of the method's `model`."""

    model: str


@dataclass(frozen=True)
class Reading:
    """The functions that a method is read with; other processes find them at the top of their modules.

    load: (inputs, numbers) → predict, as `Method` says. multiplications: (inputs, numbers) → how many a pose takes;
    None where they are not counted. numbers: what both take beside the artefacts. sources: the functions whose code
    decides what is predicted.
    """

    load: Callable[[Mapping[str, Path], object], Callable]
    multiplications: Callable[[Mapping[str, Path], object], int] | None
    numbers: object
    sources: tuple[Callable, ...]


def reading(method: Method, config: Config) -> Reading:
    """Return how a method is read under a configuration."""
    if method.model is None:
        return Reading(method.load, method.multiplications, method.numbers(config), (method.load,))
    return Reading(load, multiplications, ModelNumbers(reference(method.model)), (load, method.model))


def load(inputs: Mapping[str, Path], numbers: ModelNumbers) -> Callable:
    """Return parameters (b, m) → vertices (b, n, 3), mm, of a method that has a model."""
    return vertices_of(inputs, stage_function(numbers.model)(inputs), numbers.model)


def multiplications(inputs: Mapping[str, Path], numbers: ModelNumbers) -> int:
    """Return how many multiplications one pose takes of a method that has a model."""
    from replicate.approximation.multiplications import of_model

    return of_model(stage_function(numbers.model)(inputs))


def vertices_of(inputs: Mapping[str, Path], model: Model, name: str) -> Callable:
    """Return parameters (b, m) → vertices (b, n, 3), mm, of a model that predicts offsets; on the CPU, one thread.

    name: the model's, for messages. They raise RunError for offsets of another shape, which NumPy might spread.
    """
    from replicate.approximation.training import prepare

    prepare("cpu")
    mesh = built_rig.load_mesh(inputs)

    def vertices(params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        offsets, shape = model.offsets(params), (len(params), *mesh.neutral.shape)
        if getattr(offsets, "shape", None) != shape:
            raise RunError(f"model {name}: expected offsets {shape}, got {_in_words(offsets)}")
        return mesh.neutral + offsets

    return vertices


def checked(predicted: object, shape: tuple[int, int, int], method: str) -> Float[np.ndarray, "b n 3"]:
    """Return what a method's predict has returned as an array of real and finite vertices of a shape (b, n, 3).

    method: its name. Raises RunError, naming it, for anything else. It takes microseconds.
    """
    demand = f"method {method}: expected vertices {shape}, real and finite, got"
    try:
        array = np.asarray(predicted)
    except Exception as error:  # whatever an object of somebody's raises
        raise RunError(f"{demand} {_in_words(predicted)} ({cut(' '.join(str(error).split()))})") from None
    if array.shape != shape or array.dtype.kind not in "fiu":
        raise RunError(f"{demand} {_in_words(predicted if predicted is None else array)}")
    if array.dtype.kind != "f":
        array = array.astype(np.float32)
    flat = array.reshape(-1)
    with np.errstate(over="ignore", invalid="ignore"):
        square = flat @ flat  # a tenth of the time that the look at each number takes
    if not square < FAR_MM**2 and not (near := np.abs(flat) < FAR_MM).all():  # NaN is not near either
        pose, vertex, axis = np.unravel_index(np.argmin(near), shape)
        raise RunError(f"{demand} {flat[np.argmin(near)]:g} at [{pose}, {vertex}, {axis}]")
    return array


def _in_words(found: object) -> str:
    """Return what something is that is no prediction."""
    if found is None:
        return "None"
    kind = type(found).__name__
    return f"{kind} {found.shape} of {found.dtype}" if isinstance(found, np.ndarray) else f"a value of the type {kind}"
