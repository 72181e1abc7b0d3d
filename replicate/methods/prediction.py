"""How a method is read from its artefacts: what it predicts, and how many multiplications that takes.

Both follow from the method's model where it has one; a method without a model brings functions of its own.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from replicate.artefacts import built_rig
from replicate.artefacts.plan import reference
from replicate.config import Config
from replicate.engine.stage import stage_function
from replicate.methods.method import Method, Model


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
    return vertices_of(inputs, stage_function(numbers.model)(inputs))


def multiplications(inputs: Mapping[str, Path], numbers: ModelNumbers) -> int:
    """Return how many multiplications one pose takes of a method that has a model."""
    from replicate.approximation.multiplications import of_model

    return of_model(stage_function(numbers.model)(inputs))


def vertices_of(inputs: Mapping[str, Path], model: Model) -> Callable:
    """Return parameters (b, m) → vertices (b, n, 3), mm, of a model that predicts offsets; on the CPU, one thread."""
    from replicate.approximation.training import prepare

    prepare("cpu")
    mesh = built_rig.load_mesh(inputs)
    return lambda params: mesh.neutral + model.offsets(params)
