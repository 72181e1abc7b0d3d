"""What a method is to the tables: a row with a label, stages that make it, and a model or function that predicts."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from replicate.base.schema import Checked
from replicate.config import Config
from replicate.engine.stage import Stage
from replicate.geometry.mesh import Mesh
from replicate.methods.plan import Plan

OTHER_COLOUR = "#7B4EA3"
Number = tuple[str, str, float]  # metric, unit (one of report.results.UNITS), value


@runtime_checkable
class Model(Protocol):
    """What predicts the offsets of the whole mesh from rig parameters.

    Its multiplications are those of its `networks`, unless it has a function `multiplications()` that counts them.
    """

    def offsets(self, params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        """Return the offsets from the neutral pose in mm, for raw rig parameters; zero where nothing moves."""
        ...


def no_numbers(config: Config) -> None:
    """Return that a method's function needs nothing besides its artefacts."""
    return None


def all_test_poses(config: Config) -> int:
    """Return how many unique test poses a method is measured on; 0 for all."""
    return config.evaluation.test_poses


@dataclass(frozen=True)
class Method:
    """A row of the tables. Functions stand at the top of the method's module, since worker processes look them up.

    name: as `METHODS=` and results have it; letters, digits and _. label: as tables and figures show it.
    stages: plan → the stages whose artefacts `model` or `load` reads. What the stage of the method's own name notes as
    `size_mb` is its size, and its log.csv its training curve.
    model: inputs → the model that predicts offsets; the prediction and the count of multiplications follow from it.
    load: in its place, (inputs, numbers) → predict. A method has one of the two. inputs: by stage name the folder of
    each artefact: those of `stages`, "rig", "samples" and "rigid". predict: parameters (b, m) → vertices (b, n, 3), mm;
    an oracle's also takes the true vertices (b, n, 3), which no other method is handed.
    oracle: whether it sees the truth. rigid_step: whether rigid segments are placed by their attachments (§3.4)
    afterwards; whatever it predicts for them is replaced then.
    in_paper: whether the paper has the row. place: rows are sorted by it, those of the paper first. note: a footnote,
    in one sentence; mark: its sign, else it is printed with the label. colour: in charts. in_figures: whether figures
    show its mesh. in_charts: whether charts show its errors. standard: whether tables have the row unless METHODS asks
    for others. floor_of: the method that it is the floor of, if any.
    numbers: configuration → what `load` needs besides, a frozen dataclass. poses: configuration → on how many test
    poses it is measured, 0 for all. facts: (inputs, mesh) → more numbers for Table 2.
    multiplications: beside `load`, (inputs, numbers) → how many a pose takes, as `approximation.multiplications` counts
    them; None where that makes no sense, as for the truth seen through maps.
    needs_derivatives: whether its stages differentiate the rig, as they can't where a rig is known by its samples.
    own: profile → the method's own section of the configuration, a `Checked` dataclass, where it has one: `[name]` in a
    CONFIG file.

    Raises ValueError for a method with neither `model` nor `load`, with both, and with a count beside a model.
    """

    name: str
    label: str
    stages: Callable[[Plan], tuple[Stage, ...]]
    load: Callable[[Mapping[str, Path], Any], Callable] | None = None
    place: float = 50.0
    oracle: bool = False
    rigid_step: bool = True
    in_paper: bool = False
    note: str = ""
    mark: str = ""
    colour: str = OTHER_COLOUR
    in_figures: bool = True
    in_charts: bool = True
    standard: bool = True
    floor_of: str = ""
    needs_derivatives: bool = False
    numbers: Callable[[Config], object] = no_numbers
    poses: Callable[[Config], int] = all_test_poses
    facts: Callable[[Mapping[str, Path], Mesh], list[Number]] | None = None
    multiplications: Callable[[Mapping[str, Path], Any], int] | None = None
    own: Callable[[str], Checked] | None = None
    model: Callable[[Mapping[str, Path]], Model] | None = None

    def __post_init__(self):
        if (self.model is None) == (self.load is None):
            found = "neither model nor load" if self.model is None else "both model and load"
            raise ValueError(f"method {self.name!r} has {found}: give it one of the two")
        if self.model and self.multiplications:
            raise ValueError(f"method {self.name!r} has a model, which is counted: leave its multiplications out")

    def section(self, config: Config) -> Any:
        """Return the method's own section of a configuration; the profile's where the configuration has none.

        Raises ValueError for a method that has no section.
        """
        if self.own is None:
            raise ValueError(f"method {self.name!r} has no section of its own: give it `own`")
        return getattr(config, self.name, None) or self.own(config.profile)

    @property
    def title(self) -> str:
        """The label with the mark of its note."""
        return f"{self.label} {self.mark}".rstrip()


def variant(method: Method, name: str, label: str, place: float, **fields: object) -> Method:
    """Return a row of ours that varies one of the paper's: tables have it where METHODS names it, figures never.

    fields: what else differs, by the names of `Method`'s fields. The facts of the paper's row are left out.
    """
    ours = {"in_paper": False, "in_figures": False, "standard": False, "facts": None}
    return replace(method, name=name, label=label, place=place, **ours, **fields)
