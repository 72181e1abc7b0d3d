"""Models that leave the suite: an ONNX file a method, the mesh as GLB, and our method as C99; for any character."""

import argparse
from collections.abc import Sequence

from replicate.artefacts import built_rig, rigid_segments
from replicate.artefacts.plan import Plan, reference
from replicate.deployment.c_templates import TEMPLATES
from replicate.engine import paths
from replicate.engine.exceptions import InputError
from replicate.engine.stage import Stage, StageContext
from replicate.engine.word_lists import words
from replicate.methods import coarse, dense_network, linear, measurement, refined, regional
from replicate.methods.method import Method
from replicate.report.publication import publish_files
from replicate.targets.deploy.deploy_settings import DeployedMethod, DeploySettings
from replicate.targets.options import OF_A_RUN, methods
from replicate.targets.running import make

ABOUT = "models for other programs: ONNX a method, the mesh as GLB, and our method as one C99 file"
WRITES = "results/runs/<profile>/"
OPTIONS = (*OF_A_RUN, "methods")
METHODS = tuple(module.METHOD.name for module in (coarse, refined, dense_network, regional, linear))


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's models, those that train first; each model is measured too.

    Methods without a model are left out.
    """
    methods = [method for method in methods if method.model]
    slow = [stage for method in methods for stage in method.stages(plan)]
    measured = [measurement.stage(plan, method) for method in methods]
    inputs = {stage.title: stage for stage in (built_rig.stage(plan), rigid_segments.stage(plan), *slow, *measured)}
    written = tuple(DeployedMethod(m.name, m.label, reference(m.model), m.rigid_step) for m in methods)
    settings = DeploySettings(plan.character, plan.config.profile, plan.config.seed, written)
    functions = ", ".join(dict.fromkeys([reference(write), *(one.model for one in written)]))
    return [*inputs.values(), plan.stage("deploy", functions, settings, *inputs.values(), files=TEMPLATES)]


def write(context: StageContext) -> None:
    """Write the files of one character, and see that onnxruntime gives with them what Python gives."""
    from replicate.targets.deploy.deployed_files import write_files

    write_files(context)


def run(options: argparse.Namespace) -> None:
    """Write the models of every character and publish them."""
    from replicate.engine.store import read_manifest

    results = make(options, lambda plan: stages(plan, deployable(methods(options, plan.config), options.methods)))
    folder, files = publish_files("deploy", results)
    notes = {name: text for one in results for name, text in read_manifest(one.folder)["notes"]["files"].items()}
    for name in (name for own in files.values() for name in own):
        print(f"written to {paths.display_path(folder / name)}: {notes.get(name, 'see REPRODUCING')}")


def deployable(chosen: Sequence[Method], text: str | Sequence[str]) -> list[Method]:
    """Return the methods that have a model; words for many methods, as all, may name others.

    Raises InputError where a method without a model is named itself, and where none is left.
    """
    named = set(words(text))
    have = [method for method in chosen if method.model]
    for method in chosen:
        if not method.model and (method.name in named or not have):
            raise InputError(f"method {method.name!r} has no model to write: it is no function of rig parameters alone")
    return have
