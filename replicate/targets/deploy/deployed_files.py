"""The files of one character: each method's model as ONNX in two precisions, the mesh as GLB, our method as C99."""

import textwrap
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx

from data_recipes.rig import Rig
from replicate.approximation.evaluation import Errors
from replicate.approximation.rigid import Attachments, attach
from replicate.artefacts import built_rig, rigid_segments
from replicate.deployment.agreement import drawn_poses, largest_distance, posed
from replicate.deployment.c_face import CFace, c_files
from replicate.deployment.model_facts import LICENCE, PATENTS, FaceFacts, about_model, in_words
from replicate.deployment.onnx_model import onnx_model
from replicate.engine.stage import StageContext, stage_function
from replicate.export.files import glb
from replicate.export.parts import posed_parts
from replicate.methods import measurement, regional
from replicate.methods.prediction import vertices_of
from replicate.targets.deploy.deploy_settings import DeployedMethod

POSES = 32  # on which a written model is compared with Python
TOLERANCE_MM = 1e-3  # what float32 may be off
C_LINE = 112


def write_files(context: StageContext) -> None:
    """Write all files of one character to the artefact's folder, and note what each of them is, in words.

    Raises RuntimeError for a model of float32 that gives other vertices than Python.
    """
    settings, inputs, stem = context.config, context.inputs, f"deploy_{context.config.character}"
    rig, attachments = built_rig.load(inputs), rigid_segments.load(inputs)
    names = rig.mesh.segment_names
    made_by = f"make deploy CHARACTERS={settings.character} PROFILE={settings.profile}, seed {settings.seed}"
    facts = FaceFacts(settings.character, rig.controls, names, [names[k] for k in attachments.segment], made_by)
    params = drawn_poses(rig.controls, POSES, context.rng("checks"))
    notes = {f"{stem}.glb": "the neutral mesh, in metres, with texture coordinates"}
    with context.progress(len(settings.methods), "models") as bar:
        for method in settings.methods:
            errors = measurement.load_errors(measurement.error_folders(inputs)[method.name])
            for name, model, text in _models(method, inputs, rig, attachments, facts, errors, params):
                (context.out / f"{stem}_{name}.onnx").write_bytes(model)
                notes[f"{stem}_{name}.onnx"] = text
            if method.name == regional.METHOD.name:
                notes |= _write_c(
                    context.out, stem, rig, attachments, inputs, facts, in_words(facts, method.title, errors)
                )
            bar.update(1)
    head = posed_parts(rig, rig.default)[0]
    (context.out / f"{stem}.glb").write_bytes(glb([head], {"character": settings.character, "made_by": made_by}))
    context.note(files=notes)


def _models(
    method: DeployedMethod,
    inputs: Mapping[str, Path],
    rig: Rig,
    attachments: Attachments,
    facts: FaceFacts,
    errors: Errors,
    params: np.ndarray,
) -> list[tuple[str, bytes, str]]:
    """Return (name, bytes, what it is) of a method's models: float32 and float16."""
    model = stage_function(method.model)(inputs)
    wanted = vertices_of(inputs, model)(params)
    placing = attachments if method.rigid_step else None
    wanted = attach(rig.mesh, attachments, wanted) if placing else wanted
    files = []
    for half in (False, True):
        about = about_model(facts, method.name, method.title, errors, half)
        written = onnx_model(model, rig.mesh, placing, half, about, in_words(facts, method.title, errors))
        off = largest_distance(posed(written, params), wanted)
        if not (half or off < TOLERANCE_MM):
            raise RuntimeError(f"{method.name} as ONNX is {off:.2g} mm off, where {TOLERANCE_MM} mm are allowed")
        about["largest_difference_mm"] = f"{off:.2g}"  # from Python with float32, on poses within the limits and beyond
        onnx.helper.set_model_props(written, about)
        data = written.SerializeToString()
        text = f"{method.title}, {about['weights']}; {len(data) / 1e6:.1f} MB, within {off:.1g} mm of Python"
        files.append((f"{method.name}{'_float16' if half else ''}", data, text))
    return files


def _write_c(
    out: Path,
    stem: str,
    rig: Rig,
    attachments: Attachments,
    inputs: Mapping[str, Path],
    facts: FaceFacts,
    words: str,
) -> dict[str, str]:
    """Write our method as C99; return what the files are."""
    lines = "\n   ".join(textwrap.wrap(f"{words} Made by {facts.made_by}.", C_LINE))
    licence = "\n   ".join(textwrap.wrap(f"{LICENCE} {PATENTS}", C_LINE))
    model = regional.load_model(inputs)
    face = CFace(facts.character, rig.controls, rig.mesh, attachments, model, f"{stem}.glb", lines, licence)
    for name, text in c_files(face, stem).items():
        (out / name).write_text(text, encoding="ascii")
    size = (out / f"{stem}.c").stat().st_size / 1e6
    return {
        f"{stem}.h": "the C face: counts, controls, units",
        f"{stem}.c": f"our method in C99, {size:.1f} MB of source",
    }
