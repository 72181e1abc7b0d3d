"""Put models of a run into the repository, so that a face can be posed before one trains: for maintainers.

    python -m replicate.targets.trained_models

It takes them from the cache, trains what is missing there, and rewrites results/trained. Weights are stored in 16 bits,
of our method's shapes the first ones of each region; errors are measured after that.
"""

import argparse
import copy
import json
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Int
from torch import nn

from replicate.base.command_line import guard
from replicate.base.exceptions import InputError
from replicate.base.files import write_bytes, write_text
from replicate.base.paths import display_path
from replicate.base.progress import progress
from replicate.capture import landmark_rig
from replicate.cli.options import configurations
from replicate.cli.parser import parser
from replicate.config import Config
from replicate.engine.provenance import core_count, git_state, provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage, StageContext, stream_rng
from replicate.engine.store import MANIFEST, read_manifest
from replicate.inverse import ik_stage
from replicate.methods import artefacts, coarse, measurement, regional, trained
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.regional.model import RegionalModel, StoredBasis

MODELS = {  # the first one's also capture a face, and have a page
    "teen": (regional.METHOD, coarse.METHOD),
    "woman": (regional.METHOD,),
    "dragon": (regional.METHOD,),
    "toon": (regional.METHOD,),
}
CAPTURED = regional.METHOD  # whose IK networks go by landmarks
SHAPES, PAGE_SHAPES = 56, 24  # of each region, in a model and in the page that lies ready to be opened
PAGE = "pose_the_{}.html"
POSES = 100  # test poses that the manifest's errors are of
WEIGHTS, SHRUNK = "weights.safetensors", (".weight", ".bias")
LEFT_OUT = ("log.csv", measurement.POSE)


def main(arguments: Sequence[str]) -> None:
    """Rewrite the models of some characters."""
    about = argparse.ArgumentParser(
        "python -m replicate.targets.trained_models", description=str(__doc__).split("\n")[0]
    )
    about.add_argument("--characters", nargs="+", default=list(MODELS), choices=list(MODELS))
    words = about.parse_args(arguments)
    options = parser().parse_args(["poser", "--characters", *words.characters])
    trained.FOLDER.mkdir(parents=True, exist_ok=True)
    for config in configurations(options):
        for file in put(config, MODELS[config.character], config.character == next(iter(MODELS))):
            print(f"written to {display_path(file)} ({file.stat().st_size / 1e6:.1f} MB)")


def put(config: Config, methods: Sequence[Method], is_first: bool) -> list[Path]:
    """Put one character's models into results/trained and return the new files.

    is_first: whether IK networks for capture are among them, and a page is written.

    What the cache has was made by the sources as they are, since a stage's key holds them. So these have to be those of
    a commit: raises InputError, before it trains or writes anything, for a tree with changes.
    """
    git = git_state()
    if not (git and git["clean"]):
        raise InputError("the models would be of a tree with changes: commit them, then put the models there")
    plan = Plan(config)
    kept = {
        stage.name: stage
        for stage in (
            artefacts.rigid_stage(plan),
            artefacts.influence_stage(plan),
            *(stage for method in methods for stage in (*method.stages(plan), ik_stage.stage(plan, method))),
            *([landmark_rig.ik_stage_of(plan, CAPTURED)] if is_first else []),
        )
    }
    measured = [measurement.stage(plan, method) for method in methods]
    facts = provenance(["python", "-m", "replicate.targets.trained_models"], config.profile, [config.seed], 1)
    folders = run([*kept.values(), *measured], core_count(), facts)
    inputs = {stage.name: folders[stage.title] for each in measured for stage in (each, *each.inputs)}
    inputs |= {name: folders[stage.title] for name, stage in kept.items()}
    git = read_manifest(inputs[methods[0].name])["run"]["git"] or git
    samples = artefacts.load_samples(inputs)
    poses = measurement.measured_poses(samples.test_params, methods[0].poses(config), config.seed)
    rows = np.linspace(0, len(poses) - 1, min(POSES, len(poses))).astype(int)
    with tempfile.TemporaryDirectory() as name:
        small = {stage: _shrunk(stage, inputs[stage], Path(name) / stage) for stage in kept}
        errors = {}
        for method, stage in zip(methods, measured, strict=True):
            small[stage.name] = _measured(stage, inputs | small, Path(name))
            before, after = (_means(folder, rows) for folder in (inputs[stage.name], small[stage.name]))
            errors[method.name] = {**after, "as_trained": before}
        file = trained.FOLDER / f"{config.character}.zip"
        _write_zip(file, small, inputs, samples.test_params[poses[rows]])
        page = _write_page(config, inputs | small, git["commit"], poses[rows]) if is_first else {}
    entry = {
        "file": file.name,
        "sha256": trained.digest(file),
        "profile": config.profile,
        "seed": config.seed,
        "commit": git["commit"],
        "poses": len(rows),
        "errors": errors,
        "stages": {stage: _bytes_in(file, stage) for stage in small},
        **({"page": page} if page else {}),
    }
    everything = trained.entries() | {config.character: entry}
    ordered = {character: everything[character] for character in MODELS if character in everything}
    write_text(trained.FOLDER / trained.MANIFEST, json.dumps(ordered, indent=1) + "\n")
    return [file, *([trained.FOLDER / page["file"]] if page else []), trained.FOLDER / trained.MANIFEST]


def _shrunk(stage: str, artefact: Path, folder: Path) -> Path:
    """Copy a stage's artefact with weights of 16 bits, and our method with fewer shapes."""
    from safetensors.torch import load_file, save_file

    from replicate.regional import model as regional_model

    folder.mkdir()
    for file in artefact.iterdir():
        if file.name not in LEFT_OUT and not file.name.startswith("manifest."):
            shutil.copyfile(file, folder / file.name)
    notes = read_manifest(artefact)["notes"]
    if stage == regional.METHOD.name:
        model = with_fewer_shapes(regional_model.load(artefact), SHAPES)
        regional_model.save(model, folder)
        notes |= {"size_mb": model.size_mb(), "multiplications": model.multiplications()}
    elif (folder / WEIGHTS).is_file():
        arrays = load_file(folder / WEIGHTS)
        save_file({n: a.half() if n.endswith(SHRUNK) else a for n, a in arrays.items()}, folder / WEIGHTS)
    (folder / MANIFEST).write_text(json.dumps({"notes": notes}) + "\n", encoding="utf-8")
    return folder


def _measured(stage: Stage, inputs: Mapping[str, Path], folder: Path) -> Path:
    """Measure the models as they are stored, as the stage does those of the cache."""
    out = folder / stage.name
    out.mkdir()
    measurement.measure(StageContext(stage.name, stage.config, inputs, out, folder))
    for name in LEFT_OUT:
        (out / name).unlink(missing_ok=True)
    (out / MANIFEST).write_text(json.dumps({"notes": {}}) + "\n", encoding="utf-8")
    return out


def _means(folder: Path, rows: Int[np.ndarray, " k"]) -> dict[str, float]:
    errors = measurement.load_errors(folder)
    return {
        "distance_mm": round(float(errors.pose_mm[rows].mean()), 5),
        "normal_deg": round(float(errors.pose_deg[rows].mean()), 4),
    }


def _write_zip(file: Path, small: Mapping[str, Path], inputs: Mapping[str, Path], test_poses: np.ndarray) -> None:
    """Write the artefacts' folders into a zip, with what the rig is known by; the same ones give the same bytes."""
    rig = artefacts.load_rig(inputs)
    with tempfile.TemporaryDirectory() as name:
        for array, what in ((rig.mesh.neutral, trained.NEUTRAL), (np.asarray(test_poses), trained.TEST_POSES)):
            np.save(Path(name) / what, array)
        (Path(name) / trained.CONTROLS).write_text(json.dumps(trained.controls_of(rig)), encoding="utf-8")
        files = {path.name: path for path in sorted(Path(name).iterdir())}
        files |= {f"{stage}/{path.name}": path for stage, folder in small.items() for path in sorted(folder.iterdir())}
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
            for inside, path in files.items():
                info = zipfile.ZipInfo(inside)  # without the time of day
                info.external_attr = 0o644 << 16
                archive.writestr(info, path.read_bytes(), zipfile.ZIP_DEFLATED, 9)


def _bytes_in(file: Path, stage: str) -> int:
    """Return how many bytes of a zip belong to a stage."""
    with zipfile.ZipFile(file) as archive:
        return sum(info.compress_size for info in archive.infolist() if info.filename.startswith(f"{stage}/"))


def _write_page(config: Config, inputs: Mapping[str, Path], commit: str, poses: Int[np.ndarray, " k"]) -> dict:
    """Write a character's posing page, with fewer shapes still, and return what the manifest says of it."""
    from replicate.approximation.metrics import evaluate
    from replicate.approximation.rigid import attach
    from replicate.poser.face_page import face_page
    from replicate.poser.notebook import read_face

    model, name = with_fewer_shapes(regional.load_model(inputs), PAGE_SHAPES), regional.METHOD.name
    face, samples = read_face(inputs, model, name), artefacts.load_samples(inputs)
    mesh = face.rig.mesh

    def predict(params: np.ndarray, _: np.ndarray) -> np.ndarray:
        return attach(mesh, face.attachments, mesh.neutral + model.offsets(params))

    errors = evaluate(mesh, samples.test_params[poses], samples.test_offsets[poses], {name: predict})[name]
    made_by = (
        f"{config.profile}, seed {config.seed}, commit {commit[:7]}; {PAGE_SHAPES} shapes a region, so that the file "
        f"stays small; `make poser CHARACTERS={config.character}` writes it with all that its models have"
    )
    text = face_page(face, stream_rng(config.seed, "poser", "checks"), progress, made_by)
    file = trained.FOLDER / PAGE.format(config.character)
    write_bytes(file, text.encode())
    means = {"distance_mm": round(errors.pose_mm.mean(), 5), "normal_deg": round(errors.pose_deg.mean(), 4)}
    return {"file": file.name, "sha256": trained.digest(file), "errors": means}


if __name__ == "__main__":
    sys.exit(guard(lambda: main(sys.argv[1:])))


# A trained model with fewer shapes a region, for a smaller file: nothing is trained again.


def with_fewer_shapes(model: RegionalModel, count: int) -> RegionalModel:
    """Return a copy of a model with at most `count` components of each basis, the first ones, which move most."""
    kept = [basis.steps[:count] for basis in model.bases]
    bases = [
        StoredBasis(b.vertices, b.weights, b.mean, b.fine[:count], b.rough[: max(0, count - len(b.fine))], steps)
        for b, steps in zip(model.bases, kept, strict=True)
    ]
    firsts = np.cumsum([0, *(len(basis.steps) for basis in model.bases)])
    rows = np.concatenate([first + np.arange(len(steps)) for first, steps in zip(firsts, kept, strict=False)])
    network, first = copy.deepcopy(model.network), 0
    for part in network.networks:
        last = first + part.output.out_features
        own = torch.from_numpy(rows[(rows >= first) & (rows < last)] - first)
        part.output, part.line = _narrowed(part.output, own), part.line and _narrowed(part.line, own)
        first = last
    return RegionalModel(network, bases, model.scale.numpy(), model.length, model.vertex_count, model.rest)


def _narrowed(layer: nn.Linear, rows: Int[torch.Tensor, " k"]) -> nn.Linear:
    """Return a layer with some of another one's outputs."""
    twin = nn.Linear(layer.in_features, len(rows), bias=layer.bias is not None)
    with torch.no_grad():
        twin.weight.copy_(layer.weight[rows])
        if layer.bias is not None:
            twin.bias.copy_(layer.bias[rows])
    return twin
