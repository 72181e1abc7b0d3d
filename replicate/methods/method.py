"""A method: a row of the tables with a label, the stages that make it, and a model or function that predicts."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
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
Metric = tuple[str, str, float]  # metric, unit (one of report.results.UNITS), value


@runtime_checkable
class Model(Protocol):
    """Predicts the offsets of the whole mesh from rig parameters.

    Multiplications are counted over its `networks`, unless it has a method `multiplications()`.
    """

    def offsets(self, params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        """Return the offsets from the neutral pose in mm, for raw rig parameters; zero where nothing moves."""
        ...


def no_settings(config: Config) -> None:
    """Return None: the method needs only its artefacts."""
    return None


def all_test_poses(config: Config) -> int:
    """Return how many unique test poses a method is measured on; 0 for all."""
    return config.evaluation.test_poses


@dataclass(frozen=True)
class Method:
    """A row of the tables. Its functions stand at the top of a module, where worker processes find them.

    name: as in `METHODS=` and in results; letters, digits and _.
    label: as in tables and figures.
    stages: plan → the stages whose artefacts `model` or `load` reads. If one of them has the method's name, its note
        `size_mb` is the method's size, and its log.csv the training curve.
    load: (inputs, settings) → predict, for a method without `model`. inputs has the folder of each artefact by stage
        name: those of `stages`, "rig", "samples" and "rigid". predict is parameters (b, m) → vertices (b, n, 3), mm; an
        oracle's predict also gets the true vertices (b, n, 3).
    place: rows are sorted by it, those of the paper first.
    oracle: whether it sees the truth.
    rigid_step: whether rigid segments are placed by their attachments (§3.4), in place of what it predicts for them.
    in_paper: whether the paper has the row.
    note: a footnote, in one sentence.
    mark: the footnote's sign; without one, the footnote is printed with the label.
    colour: in charts.
    in_figures: whether figures show its mesh.
    in_charts: whether charts show its errors.
    standard: whether tables have the row unless METHODS asks for others.
    floor_of: the method that it is the floor of, if any.
    needs_derivatives: whether its stages differentiate the rig, which needs more than samples.
    settings: configuration → what `load` needs beside the artefacts, a frozen dataclass.
    poses: configuration → on how many test poses it is measured, 0 for all.
    facts: (inputs, mesh) → more metrics for Table 2.
    multiplications: (inputs, settings) → how many a pose needs, for a method with `load`, counted as in
        `baselines.multiplications`; None if that makes no sense, as for the truth seen through maps.
    default_section: profile → the method's section of the configuration, a `Checked` dataclass; `[name]` in CONFIG.
    model: inputs → the model that predicts offsets; predictions and multiplications follow from it.

    Raises ValueError for a method with neither `model` nor `load`, with both, or with `multiplications` beside a model.
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
    settings: Callable[[Config], object] = no_settings
    poses: Callable[[Config], int] = all_test_poses
    facts: Callable[[Mapping[str, Path], Mesh], list[Metric]] | None = None
    multiplications: Callable[[Mapping[str, Path], Any], int] | None = None
    default_section: Callable[[str], Checked] | None = None
    model: Callable[[Mapping[str, Path]], Model] | None = None

    def __post_init__(self):
        if (self.model is None) == (self.load is None):
            found = "neither model nor load" if self.model is None else "both model and load"
            raise ValueError(f"method {self.name!r} has {found}: give it one of the two")
        if self.model and self.multiplications:
            raise ValueError(f"method {self.name!r} has a model, which is counted: leave its multiplications out")

    def section(self, config: Config) -> Any:
        """Return the method's section of a configuration, or that of its profile if the configuration has none.

        Raises ValueError for a method that has no section.
        """
        if self.default_section is None:
            raise ValueError(f"method {self.name!r} has no section: give it `default_section`")
        return getattr(config, self.name, None) or self.default_section(config.profile)

    @property
    def title(self) -> str:
        """The label with the mark of its footnote."""
        return f"{self.label} {self.mark}".rstrip()


def variant(method: Method, name: str, label: str, place: float, **fields: object) -> Method:
    """Return a variant of a method, as a row that only METHODS can ask for and figures don't show.

    fields: other fields of `Method` that differ. The facts of the varied method are left out, and a model that is read
    by a stage's name is read by this one.
    """
    ours: dict[str, object] = {"in_paper": False, "in_figures": False, "standard": False, "facts": None}
    if isinstance(method.model, partial):
        ours["model"] = partial(method.model.func, name)
    return replace(method, name=name, label=label, place=place, **(ours | fields))
