"""The posing page as a widget for notebooks (§5.3.1): the same front end, and the errors against the rig in colours.

The face is posed in the browser, as in the page. After each drag the widget sends the rig parameters; Python evaluates
the rig at them and answers with a colour for each vertex. While an answer is on its way, the widget sends nothing.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import anywidget
import numpy as np
import traitlets
from jaxtyping import Float

from data_recipes.recipe_paths import in_command
from replicate.base.exceptions import InputError
from replicate.base.paths import cache_folder, display_path
from replicate.base.progress import progress
from replicate.config import resolve
from replicate.engine.device import choose_device
from replicate.engine.provenance import core_count, provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage
from replicate.engine.store import load
from replicate.inverse import ik_stage
from replicate.inverse.control_points import control_points, targets_of_drags
from replicate.methods import artefacts, regional
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.methods.trained import TrainedPlan, plan_for
from replicate.methods.trained import entries as trained_entries
from replicate.poser.contents import PosedFace, face_contents
from replicate.poser.display_parts import display_contents
from replicate.poser.face_page import posed_vertices
from replicate.poser.pack import FRONT, SCRIPTS, STYLES, joined, packed
from replicate.poser.rig_errors import NORMAL, SCALES, RigErrors, rig_errors
from replicate.poser.saved_pose import SLACK, read_pose, write_pose
from replicate.report.manifest import command_of, entries
from replicate.report.notebooks import folder_of

if TYPE_CHECKING:
    from replicate.poser.contents import Approximation


BAR_STEPS = 24  # colours of the legend's bar
AS_LISTS = {
    "sync": True,
    "to_json": lambda array, widget: np.asarray(array, float).round(7).tolist(),
    "from_json": lambda values, widget: np.array(values, np.float32),
}


class Poser(anywidget.AnyWidget):
    """A face to pose, and how far it is from its rig; it works without a browser too.

    params: (m,) raw rig parameters within their limits; when they are set, the control points go with the face.
    targets: (c, 3) where the control points are wanted, mm; of a point that is set, x and y count. kind: "normal" or
    "distance", which error the colours show. judged: the errors of the pose, a `RigErrors`.

    Raises InputError, and changes nothing, for too many or too few parameters, or one that isn't finite or is beyond a
    limit.
    """

    _esm = joined((*SCRIPTS, FRONT / "errors.js", FRONT / "widget.js"))
    _css = joined((STYLES[0], FRONT / "widget.css"))
    packed = traitlets.Bytes().tag(sync=True)
    params = traitlets.Any().tag(**AS_LISTS)
    targets = traitlets.Any().tag(**AS_LISTS)
    asked = traitlets.Int(0).tag(sync=True)  # how often the browser has asked for the errors
    kind = traitlets.Enum(tuple(SCALES), NORMAL).tag(sync=True)
    errors = traitlets.Dict().tag(sync=True)

    def __init__(self, face: PosedFace):
        self.face, self.judged = face, None
        self._points = control_points(face.rig, face.influence)
        self._held = True  # while several things change at once
        header, arrays = face_contents(face)
        words, values = display_contents(face.rig, progress)
        rest = np.array(face.rig.default, np.float32)
        contents = packed(header | words, arrays | values)
        super().__init__(packed=contents, params=rest, targets=self._reached(rest))
        self._held = False
        self._judge()

    @property
    def points(self) -> tuple[str, ...]:
        """The control points' names, in the order of `targets`."""
        return self._points.names

    def drag(self, **moves: tuple[float, float]) -> None:
        """Drag control points, by name, (x, y) mm from where they are wanted; the IK networks pose the face (Eq. 7).

        The parameters change by as much as the networks' answer does, within their limits (D25). Raises InputError for
        an unknown control point, and for a move that is not finite.
        """
        targets = targets_of_drags(self.targets, self.points, list(moves.items()))
        self._set(self.face.dragged(self.params, self.targets, targets), targets)

    def reset(self) -> None:
        """Go back to the neutral pose."""
        self.params = self.face.rig.default

    def save(self, file: Path | str) -> None:
        """Write the pose as the posing page does."""
        write_pose(Path(file), self.face.rig, self.params, self.points, self.targets)

    def load(self, file: Path | str) -> None:
        """Pose the face as a file says. Raises InputError, and changes nothing, for a bad file, as `read_pose` does."""
        params, targets = read_pose(Path(file), self.face.rig, self.points)
        self._set(params, self._reached(params) if targets is None else targets)

    def set_state(self, sync_data: Mapping[str, object]) -> None:
        """Take what the browser sends: it sets parameters and points together, then asks for the errors."""
        self._held = True
        try:
            super().set_state(sync_data)
        finally:
            self._held = False
        self._judge()

    def _set(self, params: Float[np.ndarray, " m"], targets: Float[np.ndarray, "c 3"]) -> None:
        self._held = True
        try:
            with self.hold_sync():
                self.params, self.targets = params, targets
        finally:
            self._held = False
        self._judge()

    def _reached(self, params: np.ndarray) -> np.ndarray:
        return posed_vertices(self.face, params[None])[0, self._points.vertices]

    @traitlets.validate("params")
    def _check_params(self, proposal: Mapping) -> np.ndarray:
        rig = self.face.rig
        params = _finite(proposal["value"], rig.default.shape, "params")
        outside = np.flatnonzero((params < rig.lower - SLACK) | (params > rig.upper + SLACK))
        if len(outside):
            j = outside[0]
            raise InputError(
                f"control {rig.controls[j].name!r}: expected a number from {rig.lower[j]:g} to {rig.upper[j]:g}, "
                f"got {params[j]:g}"
            )
        return np.clip(params, rig.lower, rig.upper)

    @traitlets.validate("targets")
    def _check_targets(self, proposal: Mapping) -> np.ndarray:
        return _finite(proposal["value"], (len(self.points), 3), "targets")

    @traitlets.observe("params")
    def _follow(self, change: Mapping) -> None:
        if not self._held:
            self._set(self.params, self._reached(self.params))

    @traitlets.observe("kind")
    def _recolour(self, change: Mapping) -> None:
        if not self._held:
            self._judge()

    def _judge(self) -> None:
        """Compare the face with the rig, unless this pose is judged already, and tell the browser."""
        if self.judged is None or not np.array_equal(self._posed, self.params):
            self.judged, self._posed = rig_errors(self.face, self.params), self.params.copy()
        self.errors = {**colours_in_words(self.judged, self.kind), "asked": self.asked}


def colours_in_words(errors: RigErrors, kind: str) -> dict[str, object]:
    """Return what a legend says of some errors, and the vertices' colours: red, green and blue in turn, as bytes."""
    scale = SCALES[kind]
    bar = scale.colours(scale.limit * np.linspace(0, 1, BAR_STEPS) ** 2)
    return {
        "title": f"{scale.title}, {scale.unit}",
        "words": errors.in_words(),
        "bar": [f"#{bytes(colour).hex()}" for colour in bar.tolist()],
        "ticks": [[scale.place(tick), f"{tick:g}{'+' if tick == scale.limit else ''}"] for tick in scale.ticks],
        "colours": scale.colours(errors.of(kind)).tobytes(),
    }


def _finite(value: object, shape: tuple[int, ...], name: str) -> np.ndarray:
    try:
        array = np.array(value, np.float32)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != shape or not np.isfinite(array).all():
        found = f"an array of shape {array.shape}" if np.isfinite(array).all() else "an array with NaN or infinity"
        raise InputError(f"{name}: expected finite numbers in the shape {shape}, got {found}")
    return array


# Faces to pose, from the artefacts of a folder of results; nothing is trained.

NETWORKS = f"{ik_stage.PREFIX}_"
SHOWN = "figure11"  # whose networks pose a face; its IK networks are trained through the first method that it shows
REFERENCE, THROUGH = "reference", regional.METHOD


def open_poser(results: str, character: str) -> "Poser":
    """Return a widget to pose a character in, with the networks that its Figure 11 was made with.

    results: "reference", or the profile of a run of yours. Raises InputError as `open_face` does.
    """
    return Poser(open_face(results, character))


def what_is_missing(results: str, character: str) -> str:
    """Return "" if `open_poser` works, else a sentence with the command that makes what is missing."""
    try:
        artefacts_of_run(results, character)
    except InputError as error:
        return "" if _plan_of_face(results, character) else str(error)
    return ""


def open_face(results: str, character: str) -> PosedFace:
    """Return what poses a character: the rig, our method's model and the IK networks.

    Where the cache doesn't hold those of the results, it is your own model of the same profile, or the one that comes
    with the repository, and a line says so. Raises InputError where there is none of them.
    """
    try:
        inputs = artefacts_of_run(results, character)
    except InputError:
        plan = _plan_of_face(results, character)
        if plan is None:
            raise
        if isinstance(plan, TrainedPlan):
            print(plan.in_words())
        stages = stages_of_face(plan)
        folders = run(stages, facts=provenance(["python", *sys.orig_argv[1:]], results, [0], core_count()))
        inputs = {stage.name: folders[stage.title] for stage in stages}
    (networks,) = (name for name in inputs if name.startswith(NETWORKS))
    return read_face(inputs, regional.load_model(inputs), networks.removeprefix(NETWORKS))


def _plan_of_face(results: str, character: str) -> Plan | None:
    """Return the plan of networks that stand in for those of some results, and that need no training; else None.

    They are the models that come with the repository, or of the same profile and seed, trained here.
    """
    facts = trained_entries().get(character)
    if facts is None or results not in (REFERENCE, facts["profile"]):
        return None
    config = resolve(character, facts["profile"], seed=facts["seed"], device=choose_device("auto"))
    networks = (regional.METHOD.name, ik_stage.stage_name(regional.METHOD.name))
    plan = plan_for(config, [regional.METHOD], [*networks, "rigid", "influence"])
    if isinstance(plan, TrainedPlan) or all(load(stage.identifier) for stage in stages_of_face(plan)):
        return plan
    return None


def stages_of_face(plan: Plan, methods: Sequence[Method] = (regional.METHOD,)) -> list[Stage]:
    """Return the stages whose artefacts `read_face` reads; its IK networks are trained through our method.

    methods: whose models are read.
    """
    shared = [artefacts.rig_stage(plan), artefacts.rigid_stage(plan), artefacts.influence_stage(plan)]
    return [*shared, *(stage for method in methods for stage in method.stages(plan)), ik_stage.stage(plan, THROUGH)]


def read_face(inputs: Mapping[str, Path], model: "Approximation", trained_through: str) -> PosedFace:
    """Return what poses a character. trained_through: the method that the IK networks are trained through."""
    return PosedFace(
        artefacts.load_rig(inputs),
        model,
        artefacts.load_attachments(inputs),
        ik_stage.load(inputs, trained_through),
        artefacts.load_influence(inputs),
    )


def artefacts_of_run(results: str, character: str) -> dict[str, Path]:
    """Return the verified artefact folders that `open_face` reads, by stage name.

    Raises InputError as `open_face` does, with the command that makes what is missing.
    """
    folder = folder_of(results)
    facts = entries(folder, SHOWN).get(character)
    if facts is None:
        command = f"make {command_of(SHOWN)} CHARACTERS={in_command(character)}"
        raise InputError(f"{display_path(folder)}: there is no {SHOWN} of {character}; `{command}` makes it.")
    needed = ("rig", "rigid", "influence", regional.METHOD.name)
    found: dict[str, Path] = {}
    for title, stage in facts["stages"].items():
        name = title.partition("-")[0]
        if name in needed or name.startswith(NETWORKS):
            artefact = load(f"{title}-{stage['key']}")
            if artefact is None:
                command = f"make {command_of(SHOWN)} CHARACTERS={in_command(character)} PROFILE={facts['profile']}"
                raise InputError(
                    f"The cache, {display_path(cache_folder())}, does not hold {title} as these results have it. "
                    f"`{command}` trains what is missing; then open the results of {facts['profile']!r}."
                )
            found[name] = artefact
    return found
