"""Train the paper's coarse networks on one character and see how far off they are: the suite on one page.

    python examples/train_one.py                      # a tiny head: about a minute of one core
    python examples/train_one.py teen --steps 2000    # a character of Table 2

`make` does the same in stages that are kept. `%run examples/train_one.py` in IPython leaves all that is named here.
"""

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the project's folder, wherever this is run from

from data_recipes.catalogue import build_rig
from replicate.approximation import cnn, influence, metrics, rigid
from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.samples import PosedSamples, SampleSet, write_samples
from replicate.approximation.segments import coarse_segments, whole_mesh
from replicate.approximation.training import train_segments
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.baselines.line import line_model
from replicate.config import resolve
from replicate.drawing.characters import character_surfaces
from replicate.drawing.heatmap import normal_bar, normal_heat
from replicate.drawing.light import PORTRAIT
from replicate.drawing.panels import Words, panel_grid, png
from replicate.drawing.render import render
from replicate.drawing.scene import camera_for, frame_surfaces
from replicate.methods.linear import LinearConfig, best_weights

parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
parser.add_argument("character", nargs="?", default="tiny", help="tiny, teen, woman, dragon, toon, or a recipe's path")
parser.add_argument("--steps", type=int, default=400, help="of the training (default: %(default)s)")
parser.add_argument("--out", type=Path, help="the picture's file (default: train_one_CHARACTER.png)")
words = parser.parse_args()
try:  # the paper's values, with the few samples of the profile `quick` and its one-cycle schedule (DEVIATIONS D6)
    config = resolve(words.character, "quick", {"coarse": {"training": {"steps": words.steps}}})
    rig = build_rig(config.character)  # controls p (m,) → vertices V (n, 3), mm: what the paper had a film studio's of
except InputError as error:
    parser.error(str(error))
mesh, start, folder = rig.mesh, time.monotonic(), Path((temporary := tempfile.TemporaryDirectory()).name)


def say(text: str) -> None:
    print(f"{time.monotonic() - start:4.0f} s  {text}", file=sys.stderr)


def rng(stream: str) -> np.random.Generator:  # one a purpose, so that another draw moves no other numbers
    return np.random.default_rng([config.seed, *stream.encode()])


# §3.5: the animation's frames times random factors (Eq. 5) are for training; §5.1: a tenth of its frames is held out.
say(f"{rig.name}: {len(mesh.neutral):,} vertices, {len(rig.controls)} controls; {config.samples.count:,} poses to draw")
write_samples(rig, config.samples, folder, rng, folder / "scratch", progress)
samples = SampleSet.open(folder)

# §3.4: segments that move rigidly (Eq. 3), such as teeth, will follow the vertices that move most as they do (Eq. 4).
attachments = rigid.find_attachments(mesh, PosedSamples(mesh.neutral, samples))  # τ = 0.3 mm, c = 10

# §3.1: every other segment gets a network that sees the controls which can move one of its vertices.
say(f"{len(attachments.segment)} of {len(mesh.segment_names)} segments are rigid; trying what each control moves")
tries = influence.influence_poses(rig, samples.params, rng("influence"))
moves = influence.influence(rig, tries, progress=progress)  # (n, m)
segments = coarse_segments(mesh, attachments.segment.tolist(), moves)

# Fig. 3: dense layers, then convolutions, make a map of 32×32 offsets I_k, which vertices read at their UVs (Fig. 2).
networks = [cnn.make_network(segment, cnn.shape_facts(config.coarse)) for segment in segments]

# Eq. 1: the L1 distance of vertices plus α times that of face normals, by Adam, all networks together (§3.5).
say(f"training {len(networks)} networks for {words.steps:,} steps")
scale, run = parameter_scale(samples.params), (folder, progress, "coarse", config.seed)
model, log = train_segments(mesh, segments, networks, samples, config.coarse, *run, scale)

# Not in the paper, to know what the numbers are worth: a straight line (ridge regression), and no movement at all.
whole = [whole_mesh(mesh, len(scale))]
line = line_model(whole, best_weights(samples, whole, scale, LinearConfig().strengths)[0], scale, len(mesh.neutral))
predictors = {
    "CNN": lambda params, _: rigid.attach(mesh, attachments, mesh.neutral + model.offsets(params)),
    "linear": lambda params, _: mesh.neutral + line.offsets(params),
    "neutral": lambda params, _: np.broadcast_to(mesh.neutral, (len(params), *mesh.neutral.shape)),
}

# §5.1: mean distance of vertices, and mean angle between face normals (Eq. 11), on all unique held-out poses.
say(f"measuring on {len(samples.test_params):,} held-out poses")
errors = metrics.evaluate(mesh, samples.test_params, samples.test_offsets, predictors)
measured = [[metrics.summary(tally).mean for tally in (own.vertex, own.normal)] for own in errors.values()]
print(f"{'':10}" + "".join(f"{name:>21}" for name in errors))
print(f"{rig.name:10}" + "".join(f"{mm:11.3f} mm {degrees:5.2f}°" for mm, degrees in measured))

# Fig. 10: the held-out pose that moves the controls most, and the CNN's normal error in it as colours.
params, limit = samples.test_params[np.abs(samples.test_params).sum(1).argmax()], config.evaluation.heatmap_deg
view = camera_for("front", mesh.neutral)
face, *props = character_surfaces(rig, params, view)  # props, such as hair and eyes, are the rig's in both pictures
guess = replace(face, vertices=predictors["CNN"](params[None], None)[0])
scenes = ([face, *props], [guess, *props], [normal_heat(guess.vertices, face.vertices, mesh.faces, limit)])
camera = frame_surfaces(view, scenes[0], 0.8)
pictures = [render(scene, camera, 400, 500, studio=PORTRAIT) for scene in scenes]
titles = [f"{rig.name}: the rig", f"CNN after {words.steps:,} steps", "the CNN's normal error"]
figure = panel_grid([pictures], titles, bar=(0, 0, lambda figure, axes: normal_bar(figure, axes, limit)))
out = words.out or Path(f"train_one_{rig.name}.png")
out.write_bytes(png(figure, Words(f"{', '.join(titles)}, in one held-out pose.", "")))
say(f"{out} shows the held-out pose that moves the controls most")
