"""Write a rig as a folder of samples, which this program and others can read, as for rigs without a function."""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Int

from data_recipes.catalogue import check_empty, write_folder
from data_recipes.recipe_paths import FACE_FILE, character_label, in_command
from data_recipes.rig import Rig
from replicate.approximation.influence import influence, influence_poses
from replicate.approximation.samples import PARTS, choose_poses
from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.cli.options import characters, seeds
from replicate.config import SamplesConfig, resolve
from replicate.engine.stage import stream_rng
from replicate.methods import artefacts
from replicate.methods.artefacts import rig_of


def run(options: argparse.Namespace) -> None:
    """Write a folder of samples of every character."""
    names = characters(options)
    if options.to is not None and len(names) > 1:
        raise InputError(f"{len(names)} characters can't all be written to {options.to}: name one, or leave out to")
    if len(seeds(options)) > 1:
        raise InputError("several seeds are named; name one, whose poses are written")
    file = paths.with_home(options.config, "CONFIG") if options.config else None
    overrides = {"samples": {"split": options.split}}
    for character in names:
        config = resolve(character, options.profile, overrides if options.split else None, file, seed=seeds(options)[0])
        usual = paths.run_folder("export") / f"{character_label(character)}_samples"
        folder = paths.with_home(options.to, "to").absolute() if options.to is not None else usual
        check_empty(folder)
        rig = artefacts.rig_of(character)
        count, shards = drawn_shards(rig, config.samples, config.seed)
        moves = tried_influence(rig, config.samples, config.seed, progress)
        write_folder(rig, folder, count, shards, progress, moves)
        command = f"make table2 CHARACTERS={in_command(str(folder))}"
        print(f"written to {paths.display_path(folder)}: {count:,} poses; `{command}` reads them")


# The poses of a rig that is written as a folder of samples (data_recipes/sampled): as in §3.5 every frame of the clips,
# and what Eq. 5 draws from the training frames of a split, each with the frame that it was drawn from. Read with the
# same seed, split and configuration, they give the training, validation and test poses of the rig itself.

POSES_A_SHARD = 256
STAGE = "samples"  # the stage whose random streams draw the poses
INFLUENCE = "influence"  # the stage whose random streams draw the poses in which controls are tried


def drawn_shards(rig: Rig, config: SamplesConfig, seed: int) -> tuple[int, Iterator[dict[str, np.ndarray]]]:
    """Return how many samples a rig has, and the arrays of each shard without its vertices."""
    parts = choose_poses(rig, config, lambda stream: stream_rng(seed, STAGE, stream))
    if rig.clips is None:
        every = np.concatenate([parts[part] for part in PARTS])
        return len(every), _in_shards({"params": every})
    clips = [np.asarray(clip.values, np.float32) + np.float32(0) for clip in rig.clips]
    frames = np.concatenate(clips)
    names = np.repeat([clip.name for clip in rig.clips], [len(values) for values in clips])
    positions = np.concatenate([np.arange(len(values)) for values in clips])
    drawn = parts["training"]
    source = _sources(frames, parts, config, seed)
    acted = {"params": frames, "clip": names, "frame": positions}
    random = {"params": drawn, "clip": names[source], "frame": positions[source], "drawn": np.ones(len(drawn), bool)}
    return len(frames) + len(drawn), (shard for arrays in (acted, random) for shard in _in_shards(arrays))


def tried_influence(
    rig: Rig, config: SamplesConfig, seed: int, progress: Callable | None = None
) -> Bool[np.ndarray, "n m"]:
    """Return which control moves which vertex, found by trying as the artefact "influence" does (DEVIATIONS D7)."""
    rng = lambda stream: stream_rng(seed, INFLUENCE, stream)  # noqa: E731
    return influence(
        rig, influence_poses(rig, choose_poses(rig, config, rng)["training"], rng("poses")), progress=progress
    )


def _sources(
    frames: Float32[np.ndarray, "a m"], parts: dict[str, np.ndarray], config: SamplesConfig, seed: int
) -> Int[np.ndarray, " count"]:
    """Return which frame each training pose was drawn from.

    Eq. 5 begins by drawing frames from the animation without what is held out; this repeats that draw.
    """
    held_out = {pose.tobytes() for part in PARTS[1:] for pose in parts[part]}
    kept = np.flatnonzero([pose.tobytes() not in held_out for pose in frames])
    return kept[stream_rng(seed, STAGE, "augment").integers(len(kept), size=len(parts["training"]))]


def _in_shards(arrays: dict[str, np.ndarray]) -> Iterator[dict[str, np.ndarray]]:
    for first in range(0, len(arrays["params"]), POSES_A_SHARD):
        yield {name: array[first : first + POSES_A_SHARD] for name, array in arrays.items()}


# A small folder of samples of one of our rigs, so that the format can be tried without another rig.

CHARACTER = "toon"  # it has no clips, so that few poses will do
SAMPLES = SamplesConfig(count=120, validation=8, uniform_test=40)


def example_folder() -> Path:
    """Return a folder of the toon's samples, written if it is missing (half a minute, 10 MB)."""
    folder = paths.run_folder("export") / f"{CHARACTER}_example"
    if not (folder / FACE_FILE).is_file():
        rig = rig_of(CHARACTER)
        write_folder(rig, folder, *drawn_shards(rig, SAMPLES, seed=0))
    return folder
