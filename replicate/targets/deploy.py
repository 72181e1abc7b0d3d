"""Write a character's models for use elsewhere: an ONNX file for each method, the mesh as GLB, our method as C99.

Or, in the other form, a GLB with shapes and an ONNX file that gives their weights, for each method that has some.
"""

import argparse
import json
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from data_recipes.rig import Rig
from replicate.approximation.metrics import Errors
from replicate.approximation.rigid import Attachments, attach
from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.base.schema import either, shown
from replicate.base.user_files import words
from replicate.cli.options import methods
from replicate.cli.running import make, plan_with_trained
from replicate.cli.target_list import targets
from replicate.config import Config
from replicate.deployment import model_facts
from replicate.deployment.c_face import TEMPLATES, CFace, c_files
from replicate.deployment.model_facts import LICENCE, PATENTS, FaceFacts, about_face, about_model, in_words
from replicate.engine.stage import Stage, StageContext, stage_function
from replicate.engine.store import read_manifest
from replicate.export.files import glb, posed_parts
from replicate.export.usd import BlendShape, has_usd, shaped_usd
from replicate.methods import artefacts, measurement, regional
from replicate.methods.measurement import vertices_of
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference
from replicate.methods.trained import TrainedPlan, entries, origin
from replicate.report import manifest
from replicate.report.publication import publish_files, results_folder

VERTICES, SHAPES = "vertices", "shapes"  # what a model gives
FORMS = (VERTICES, SHAPES)
OF_SHAPES = ("regional", "pca", "linear", "morph")  # the methods that are written as shapes if none is named
SHAPED = (*OF_SHAPES, "pca_line", "morph_best")  # those that can be
OUTPUT = {
    VERTICES: "deploy",
    SHAPES: "deploy_shapes",
}  # what files of a form are called, and the stage that writes them


def stages(plan: Plan, methods: Sequence[Method] = (), form: str = VERTICES) -> list[Stage]:
    """Return the stages that train, measure and write one character's models; methods without a model are left out.

    form: one of `FORMS`.
    """
    methods = [method for method in methods if method.model]
    slow = [stage for method in methods for stage in method.stages(plan)]
    measured = [measurement.stage(plan, method) for method in methods]
    inputs = {
        stage.title: stage for stage in (artefacts.rig_stage(plan), artefacts.rigid_stage(plan), *slow, *measured)
    }
    written = tuple(DeployedMethod(m.name, m.label, reference(m.model), m.rigid_step) for m in methods)
    usd = form == SHAPES and has_usd()
    settings = DeploySettings(plan.character, plan.config.profile, plan.config.seed, written, origin(plan), usd)
    function, files = (write, TEMPLATES) if form == VERTICES else (write_shapes, ())
    functions = ", ".join(dict.fromkeys([reference(function), *(method.model for method in written)]))
    return [*inputs.values(), plan.stage(OUTPUT[form], functions, settings, *inputs.values(), files=files)]


def run(options: argparse.Namespace) -> None:
    """Write the models of every character and publish them. Raises InputError for an unknown form."""
    if options.form not in FORMS:
        raise InputError(f"form: expected {either(FORMS)}, got {shown(options.form)}")
    usual = targets()["deploy"].methods
    if options.form == SHAPES and words(options.methods) == list(usual):
        options.methods = list(OF_SHAPES)
    form, stem = options.form, OUTPUT[options.form]
    results = make(options, lambda plan: stages(plan, written(options, plan), form), partial(plan_of, options))
    earlier = manifest.entries(results_folder(options.profile), stem)
    folder, files = publish_files(stem, results)
    notes = {name: text for result in results for name, text in read_manifest(result.folder)["notes"]["files"].items()}
    for name in (name for names in files.values() for name in names):
        print(f"written to {paths.display_path(folder / name)}: {notes.get(name, 'see REPRODUCING')}")
    for character, names in files.items():
        gone = [name for name in earlier.get(character, {}).get("files", ()) if name not in names]
        if gone:
            print(f"removed, being of an earlier call: {', '.join(gone)}; METHODS= with the methods of both writes all")
        every = usual if form == VERTICES else OF_SHAPES
        left_out = [method for method in every if f"{stem}_{character}_{method}.onnx" not in names]
        if left_out and _names_none(options):
            print(f"{character}: METHODS={','.join(left_out)} names the others, which have to be trained")


def _names_none(options: argparse.Namespace) -> bool:
    """Return whether the command line names no methods."""
    return words(options.methods) == list(targets()["deploy"].methods if options.form == VERTICES else OF_SHAPES)


def plan_of(options: argparse.Namespace, config: Config) -> Plan:
    """Return a character's plan, where it can be with the models that come with the repository."""
    shown = with_trained_models(options, config)
    needed = [name for method in shown for name in (method.name, f"{measurement.PREFIX}{method.name}")]
    return plan_with_trained(options, config, shown, [*needed, "rigid"]) if shown else Plan(config)


def written(options: argparse.Namespace, plan: Plan) -> list[Method]:
    """Return the methods whose models are written under a plan."""
    if isinstance(plan, TrainedPlan):
        return with_trained_models(options, plan.config)
    return deployable(methods(options, plan.config), options.methods, options.form)


def with_trained_models(options: argparse.Namespace, config: Config) -> list[Method]:
    """Return the chosen methods, or those with models in the repository if the command line names none."""
    chosen = deployable(methods(options, config), options.methods, options.form)
    if not _names_none(options):
        return chosen
    facts = entries().get(config.character)
    return [method for method in chosen if facts and method.name in facts["stages"]]


def deployable(chosen: Sequence[Method], text: str | Sequence[str], form: str = VERTICES) -> list[Method]:
    """Return the chosen methods that can be written in a form: they have a model, or one with shapes.

    text: the user's choice; a word for several methods, such as all, may include some that can't. Raises InputError for
    a method that can't and is named itself, and where none is left.
    """
    named = set(words(text))
    have = [method for method in chosen if method.model and (form == VERTICES or method.name in SHAPED)]
    for method in chosen:
        if method not in have and (method.name in named or not have):
            if method.model:
                raise InputError(f"method {method.name!r} has no shapes: expected {either(SHAPED)}, or FORM={VERTICES}")
            raise InputError(f"method {method.name!r} has no model to write: it needs more than rig parameters")
    return have


# The settings of the stage that writes models.


@dataclass(frozen=True)
class DeployedMethod:
    """A method whose model is written. model: "module:function" of the function that reads it."""

    name: str
    title: str
    model: str
    rigid_step: bool


@dataclass(frozen=True)
class DeploySettings:
    """The settings of a character's models.

    seed: the seed that the test poses are drawn with, too
    origin: where the models come from, if not from this run
    usd: whether shapes are written as USD too
    """

    character: str
    profile: str
    seed: int
    methods: tuple[DeployedMethod, ...]
    origin: str = ""
    usd: bool = False


# The files of one character: each method's model as ONNX in two precisions, the mesh as GLB, our method as C99.

POSES = 100  # on which a written model is compared with Python
TOLERANCE_MM = 1e-3  # what float32 may be off,
TOLERANCE_SHARE = 1e-5  # or this share of the largest movement, for methods that throw vertices far away
C_LINE = 112  # characters in a line of C's comments


@dataclass(frozen=True)
class DeployedFace:
    """All that a character's files are written from.

    rig, attachments, facts: the rig, the attachments of its rigid segments, and what the files say about it
    params: poses in which models are compared with Python, (b, m)
    inputs: folders of artefacts by the names of their stages
    """

    rig: Rig
    attachments: Attachments
    facts: FaceFacts
    params: Float32[np.ndarray, "b m"]
    inputs: Mapping[str, Path]


def write(context: StageContext) -> None:
    """Write all files of one character to the artefact's folder, and note what each of them is, in words.

    Raises RuntimeError if a float32 model computes other vertices in onnxruntime than in Python.
    """
    settings, stem = context.config, f"deploy_{context.config.character}"
    face = _face(context)
    notes = {
        f"{stem}.glb": "the neutral mesh, in metres, with texture coordinates",
        f"{stem}.json": "controls with their limits, units and axes, where a program can't read them in the models",
    }
    with context.progress(len(settings.methods), "models") as bar:
        for method in settings.methods:
            folder = measurement.error_folders(context.inputs)[method.name]
            errors = measurement.load_errors(folder)
            for name, data, text in _models(face, method, errors):
                (context.out / f"{stem}_{name}.onnx").write_bytes(data)
                notes[f"{stem}_{name}.onnx"] = text
            if method.name == regional.METHOD.name:
                notes |= _write_c(face, in_words(face.facts, method.title, errors), context.out, stem)
            bar.update(1)
    head = posed_parts(face.rig, face.rig.default)[0]
    about = {"character": settings.character, "made_by": face.facts.made_by}
    (context.out / f"{stem}.glb").write_bytes(glb([head], about))
    text = json.dumps(about_face(face.facts), indent=1) + "\n"
    (context.out / f"{stem}.json").write_text(text, encoding="utf-8")
    context.note(files=notes)


def _face(context: StageContext) -> DeployedFace:
    from replicate.deployment.onnx_model import drawn_poses

    settings, rig = context.config, artefacts.load_rig(context.inputs)
    attachments, names = artefacts.load_attachments(context.inputs), rig.mesh.segment_names
    made_by = (
        f"make deploy CHARACTERS={settings.character} PROFILE={settings.profile}, seed {settings.seed}{settings.origin}"
    )
    rigid = [names[k] for k in attachments.segment]
    of_file = np.asarray(getattr(rig, "file_vertices", ())).tolist()
    facts = FaceFacts(settings.character, rig.controls, names, rigid, made_by, len(rig.mesh.neutral), of_file)
    params = drawn_poses(rig.controls, POSES, context.rng("checks"))
    return DeployedFace(rig, attachments, facts, params, context.inputs)


def _models(face: DeployedFace, method: DeployedMethod, errors: Errors) -> list[tuple[str, bytes, str]]:
    """Return (name, bytes, description) of a method's models, float32 and float16.

    errors: the method's errors on held-out poses.
    """
    import onnx

    from replicate.deployment.onnx_model import largest_distance, onnx_model, posed

    mesh, model = face.rig.mesh, stage_function(method.model)(face.inputs)
    placing = face.attachments if method.rigid_step else None
    wanted = vertices_of(face.inputs, model, method.model)(face.params)
    wanted = attach(mesh, placing, wanted) if placing else wanted
    allowed = max(TOLERANCE_MM, TOLERANCE_SHARE * largest_distance(wanted, mesh.neutral))
    files = []
    for half in (False, True):
        about = about_model(face.facts, method.name, method.title, errors, half)
        written = onnx_model(model, mesh, placing, half, about, in_words(face.facts, method.title, errors))
        off = largest_distance(posed(written, face.params), wanted)
        if not (half or off < allowed):
            raise RuntimeError(f"{method.name} as ONNX is {off:.2g} mm off; expected at most {allowed:.2g} mm")
        about["largest_difference_mm"] = f"{off:.2g}"  # from Python with float32, on poses within the limits and beyond
        onnx.helper.set_model_props(written, about)
        data = written.SerializeToString()
        text = f"{method.title}, {about['weights']}; {len(data) / 1e6:.1f} MB, within {off:.1g} mm of Python"
        files.append((f"{method.name}{'_float16' if half else ''}", data, text))
    return files


def write_shapes(context: StageContext) -> None:
    """Write each method of one character as shapes: an ONNX file gives their weights, and a GLB and a USD have them.

    Raises RuntimeError if the two together, in float32, give other vertices than Python.
    """
    settings, stem = context.config, f"{OUTPUT[SHAPES]}_{context.config.character}"
    face, notes = _face(context), {}
    with context.progress(len(settings.methods), "models") as bar:
        for method in settings.methods:
            errors = measurement.load_errors(measurement.error_folders(context.inputs)[method.name])
            for ending, data, text in _shapes(face, method, errors, settings.usd):
                (context.out / f"{stem}_{method.name}.{ending}").write_bytes(data)
                notes[f"{stem}_{method.name}.{ending}"] = text
            bar.update(1)
    context.note(files=notes)


def _shapes(face: DeployedFace, method: DeployedMethod, errors: Errors, as_usd: bool) -> list[tuple[str, bytes, str]]:
    """Return (ending, bytes, description) of a method's files.

    errors: the method's, on held-out poses. as_usd: whether one of them is a USD.
    """
    import onnx

    from replicate.deployment.onnx_model import largest_distance
    from replicate.deployment.shapes import add_targets, found_weights, shaped_face, weights_model

    # the shapes, and whether they give what the method gives
    mesh, model = face.rig.mesh, stage_function(method.model)(face.inputs)
    placing = face.attachments if method.rigid_step else None
    wanted = vertices_of(face.inputs, model, method.model)(face.params)
    wanted = attach(mesh, placing, wanted) if placing else wanted
    shaped = shaped_face(model, mesh, placing, face.rig.controls)
    written = weights_model(shaped, words=in_words(face.facts, method.title, errors))
    off = largest_distance(shaped.posed(found_weights(written, face.params)), wanted)
    allowed = max(TOLERANCE_MM, TOLERANCE_SHARE * largest_distance(wanted, mesh.neutral))
    if not off < allowed:
        raise RuntimeError(f"{method.name} as shapes is {off:.2g} mm off; expected at most {allowed:.2g} mm")

    # the files, which say what they are
    about = about_model(face.facts, method.name, method.title, errors, shaped.has_halves)
    about |= {"vertices": model_facts.OF_SHAPES, "shapes": json.dumps(shaped.names)}
    about |= {"largest_difference_mm": f"{off:.2g}"}  # of vertices from Python's, as for other models
    onnx.helper.set_model_props(written, about)
    network = written.SerializeToString()
    in_file = {name: about[name] for name in ("character", "method", "title", "licence", "patents", "made_by")}
    head = posed_parts(face.rig, face.rig.default)[0]
    shapes = glb([head], in_file, partial(add_targets, shaped))
    count = f"{len(shaped.shapes):,} shapes as morph targets of the neutral mesh"
    within = f"with the GLB within {off:.1g} mm of Python"
    files = [("glb", shapes, f"{count}; {len(shapes) / 1e6:.1f} MB")]
    if as_usd:
        blend = [BlendShape(shape.name, shape.offsets, shape.vertices) for shape in shaped.shapes]
        whole = shaped_usd(head, mesh, blend, in_file, weights=shaped.at_rest[None])
        files.append(("usdc", whole, f"the same shapes as blend shapes of UsdSkel; {len(whole) / 1e6:.1f} MB"))
    return [
        *files,
        ("onnx", network, f"{method.title}, the shapes' weights; {len(network) / 1e6:.1f} MB, {within}"),
    ]


def _write_c(face: DeployedFace, words: str, out: Path, stem: str) -> dict[str, str]:
    """Write our method as C99 and return a description of each file. words: the description of the model."""
    about, licence = (
        "\n   ".join(textwrap.wrap(text, C_LINE))
        for text in (f"{words} Made by {face.facts.made_by}.", f"{LICENCE} {PATENTS}")
    )
    facts, mesh, model = face.facts, face.rig.mesh, regional.load_model(face.inputs)
    c_face = CFace(facts.character, facts.controls, mesh, face.attachments, model, f"{stem}.glb", about, licence)
    for name, text in c_files(c_face, stem).items():
        (out / name).write_text(text, encoding="ascii")
    size = (out / f"{stem}.c").stat().st_size / 1e6
    return {f"{stem}.h": "how the C file is used", f"{stem}.c": f"our method in C99; {size:.1f} MB of source"}
