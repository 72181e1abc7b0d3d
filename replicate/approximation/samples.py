"""The training samples (p, V), validation and test poses of one character, read by memory map (§3.5).

50,000 poses of 12,510 vertices would take 7.5 GB as float32. Training offsets V − V⁰ are therefore stored as int16
multiples of a step, which differs from pose to pose: the smallest that can hold the pose's largest offset, about a
micrometre for a face. Test poses stay float32, so that no measured error contains a quantisation error; that of the
training samples is in samples.json.
"""

import hashlib
import json
import shutil
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int, Int16

from data_recipes.rig import BATCH, Clip, KnownPoses, Rig, has_function, within_limits
from replicate.approximation.sampling import (
    augment,
    balance_bins,
    bin_index,
    draw_from_index,
    hold_out,
    sample_uniform,
    split_clips,
    split_frames,
)
from replicate.base.exceptions import InputError
from replicate.base.files import read_sealed, write_sealed
from replicate.config import SamplesConfig

CHUNK = 10 * BATCH  # poses between two checkpoints
INT16_MAX = 32767
PARTS = ("training", "validation", "test")


@dataclass(frozen=True)
class SampleSet:
    """The samples of one character, memory-mapped.

    params: (N, m) float32, raw control values.
    quantised: (N, n, 3) int16, offsets in steps.
    steps_mm: (N,) float32.
    bins: (N,) int16, each sample's bin for balanced draws.
    validation_params, validation_offsets: (V, m) and (V, n, 3) mm, float32; poses that are in no other part.
    test_params, test_offsets: (T, m) and (T, n, 3) mm, float32.
    facts: the contents of samples.json.
    """

    params: np.ndarray
    quantised: np.ndarray
    steps_mm: np.ndarray
    bins: np.ndarray
    validation_params: np.ndarray
    validation_offsets: np.ndarray
    test_params: np.ndarray
    test_offsets: np.ndarray
    facts: dict

    @classmethod
    def open(cls, folder: Path) -> "SampleSet":
        """Open what `write_samples` wrote; raise InputError if a file is missing or can't be read."""
        folder = Path(folder)
        held_out = [f"{part}_{name}" for part in ("validation", "test") for name in ("params", "offsets")]
        names = ("params", "offsets", "steps", "bins", *held_out)
        try:
            arrays = [np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False) for name in names]
            facts = json.loads((folder / "samples.json").read_text())
        except (OSError, ValueError) as error:
            raise InputError(f"{folder}: the samples can't be read ({error})") from error
        return cls(*arrays, facts)

    def __len__(self) -> int:
        return len(self.params)

    @property
    def default(self) -> Float32[np.ndarray, " m"]:
        """The controls' defaults, at which nothing moves."""
        return np.array(self.facts["default"], np.float32)

    def offsets(self, indices: Int[np.ndarray, " b"]) -> Float32[np.ndarray, "b n 3"]:
        """Return the offsets V − V⁰ of some samples, in mm."""
        return self.quantised[indices] * self.steps_mm[indices][:, None, None]

    def vertices_subset(
        self, indices: Int[np.ndarray, " b"], vertex_ids: Int[np.ndarray, " k"]
    ) -> Float32[np.ndarray, "b k 3"]:
        """Return the offsets V − V⁰ of some vertices in some samples, in mm."""
        rows = np.take(self.quantised[indices], vertex_ids, axis=1)  # six times as fast as indexing both at once
        return rows * self.steps_mm[indices][:, None, None]

    def draw(self, generator: np.random.Generator, batch: int) -> Int[np.ndarray, " batch"]:
        """Draw sample indices, balanced: a bin uniformly, then a sample of that bin uniformly (§3.5)."""
        return draw_from_index(*self._index, batch, generator)

    def draw_for_step(
        self, seed: int, stream: str, step: int, batch: int, draws: str = "balanced"
    ) -> Int[np.ndarray, " batch"]:
        """Draw the batch of one training step; it depends on seed, stream and step alone, so resuming needs no state.

        stream: names the sequence of draws.
        draws: "balanced" as in `draw`, or "uniform" for all samples equally often.
        """
        generator = np.random.default_rng([seed, zlib.crc32(stream.encode()), step])
        return self.draw(generator, batch) if draws == "balanced" else generator.integers(len(self), size=batch)

    @cached_property
    def _index(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return bin_index(self.bins)


@dataclass(frozen=True)
class PosedSamples:
    """The training samples' vertices (N, n, 3) in mm, read some at a time: `posed[:100]`. neutral: (n, 3), mm."""

    neutral: np.ndarray
    samples: SampleSet

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, rows: slice) -> Float32[np.ndarray, "k n 3"]:
        return self.neutral + self.samples.offsets(np.arange(*rows.indices(len(self))))


def quantise(offsets: Float32[np.ndarray, "b n 3"]) -> tuple[Int16[np.ndarray, "b n 3"], Float32[np.ndarray, " b"]]:
    """Return offsets as whole steps, and each pose's step in mm: its largest offset over 32767."""
    steps = np.abs(offsets).max(axis=(1, 2)).astype(np.float32) / np.float32(INT16_MAX)
    steps = np.maximum(steps, np.float32(1e-9))  # a pose at rest
    whole = np.clip(np.rint(offsets / steps[:, None, None]), -INT16_MAX, INT16_MAX)
    return whole.astype(np.int16), steps


def choose_poses(
    rig: Rig, config: SamplesConfig, rng: Callable[[str], np.random.Generator]
) -> dict[str, Float32[np.ndarray, "k m"]]:
    """Return a rig's poses by part: "training", "validation" and "test".

    rng: a stream's name → its generator.

    With clips, training poses are Eq. 5 on the training animation without the poses held out for validation; without
    clips, all poses are uniform. If the rig is known only by its samples, all poses are among those.
    """
    if not has_function(rig):
        return choose_known(rig.known_poses, rig.clips, config, rng)
    if rig.clips is None:
        counts = {"uniform": config.count, "uniform_validation": config.validation, "uniform_test": config.uniform_test}
        poses = [sample_uniform(rig.lower, rig.upper, count, rng(stream)) for stream, count in counts.items()]
        return dict(zip(PARTS, poses, strict=True))
    split = {"frames": split_frames, "clips": split_clips}[config.split]
    animation, test = split([clip.values for clip in rig.clips], rng("split"), config.held_out)
    animation, validation = hold_out(animation, config.validation, rng("validation"))
    training = within_limits(rig, augment(animation, config.count, rng("augment"), config.low, config.high))
    return dict(zip(PARTS, (training, validation, test), strict=True))


def write_samples(
    rig: Rig,
    config: SamplesConfig,
    folder: Path,
    rng: Callable[[str], np.random.Generator],
    scratch: Path,
    progress: Callable,
) -> dict:
    """Evaluate a rig at its training, validation and test poses, and write the set that `SampleSet.open` reads.

    folder: where the set is written, when all is done.
    rng: as for `choose_poses`.
    scratch: a folder that stays between calls: after a kill, work goes on with the chunk it broke off in, to the same
        bytes.
    progress: (total, label, initial) → a context manager with update(k).

    Returns the facts of samples.json. Raises InputError, naming pose and vertex, if the rig gives NaN or infinity.
    """
    # the poses, and a draft of the arrays
    poses_of = choose_poses(rig, config, rng)
    params, n = poses_of["training"], len(rig.mesh.neutral)
    rows = {
        "training": {
            "offsets": (np.int16, (n, 3)),
            "steps": (np.float32, ()),
            "squared_error": (np.float64, ()),
            "landmarks": (np.float32, (len(rig.landmarks), 3)),
        },
        **{part: {f"{part}_offsets": (np.float32, (n, 3))} for part in PARTS[1:]},
    }
    key = sha256(b"".join(poses.tobytes() for poses in poses_of.values()) + rig.mesh.neutral.tobytes()).hexdigest()
    drafts = Scratch(scratch, key, CHUNK, {part: (len(poses_of[part]), rows[part]) for part in PARTS})
    arrays = drafts.arrays

    def store(part: str, rows: slice, offsets: np.ndarray) -> None:
        if part != "training":
            arrays[f"{part}_offsets"][rows] = offsets
            return
        arrays["offsets"][rows], arrays["steps"][rows] = whole, steps = quantise(offsets)
        error = whole * steps[:, None, None] - offsets
        arrays["squared_error"][rows] = (error**2).mean(axis=(1, 2), dtype=np.float64)
        arrays["landmarks"][rows] = offsets[:, rig.landmarks]

    # the rig's vertices, chunk by chunk
    with progress(sum(map(len, poses_of.values())), "samples", sum(map(drafts.finished_poses, PARTS))) as bar:
        for part, poses in poses_of.items():
            while (first := drafts.finished_poses(part)) < len(poses):
                for rows, vertices in evaluate(rig, poses[first : first + CHUNK]):
                    rows = slice(first + rows.start, first + rows.stop)
                    _check_finite(rig.name, part, rows.start, vertices)
                    store(part, rows, vertices - rig.mesh.neutral)
                    bar.update(len(vertices))
                drafts.checkpoint(part)
    # balance and quantisation error, and the files
    facts = {
        "poses": len(params),
        "default": rig.default.tolist(),
        "validation_poses": len(poses_of["validation"]),
        "test_poses": len(poses_of["test"]),
        "largest_step_mm": float(arrays["steps"].max()),
        "mean_step_mm": float(arrays["steps"].mean(dtype=np.float64)),
        "quantisation_rms_mm": float(np.sqrt(arrays["squared_error"].mean())),
    }
    bins = balance_bins(arrays["landmarks"], config.bins)
    small = {
        "params": params,
        "validation_params": poses_of["validation"],
        "test_params": poses_of["test"],
        "bins": bins,
    }
    for name, array in small.items():
        np.save(Path(folder) / f"{name}.npy", array)
    facts["samples_per_bin"] = np.bincount(bins, minlength=config.bins).tolist()
    (Path(folder) / "samples.json").write_text(json.dumps(facts, indent=1) + "\n")
    del arrays
    drafts.move(["offsets", "steps", "validation_offsets", "test_offsets"], Path(folder))
    return facts


def evaluate(rig: Rig, params: Float32[np.ndarray, "b m"]) -> Iterator[tuple[slice, Float32[np.ndarray, "k n 3"]]]:
    """Yield (rows, posed vertices in mm); the rig is called with batches of one size, the last one padded."""
    for start in range(0, len(params), BATCH):
        part = params[start : start + BATCH]
        padded = np.concatenate([part, np.repeat(part[-1:], BATCH - len(part), axis=0)])
        yield slice(start, start + len(part)), np.asarray(rig(padded), dtype=np.float32)[: len(part)]


def _check_finite(name: str, part: str, first: int, vertices: np.ndarray) -> None:
    bad = np.argwhere(~np.isfinite(vertices).all(axis=-1))
    if len(bad):
        pose, vertex = bad[0]
        where = f"rig '{name}': vertex {vertex} of {part} pose {first + pose}"
        raise InputError(f"{where}: expected finite mm, got {vertices[pose, vertex].tolist()}")


# The unfinished arrays of a set of samples, from which a killed run can continue.

STATE = "state.sealed"


class Scratch:
    """Memory-mapped arrays in a folder, of which the first rows are done.

    folder: stays between calls.
    key: what the contents depend on; a folder with another key is begun anew.
    chunk: poses between two checkpoints.
    parts: by name, the number of poses and the arrays, name → (dtype, shape of one row).

    Rows of an earlier call are checked: those from the first damaged chunk of a part on are made again, and standard
    error says so.
    """

    def __init__(
        self, folder: Path, key: str, chunk: int, parts: Mapping[str, tuple[int, Mapping[str, tuple]]]
    ) -> None:
        self.folder, self.key, self.chunk = Path(folder), key, chunk
        self.poses = {part: count for part, (count, _) in parts.items()}
        self._names = {part: tuple(rows) for part, (_, rows) in parts.items()}
        self._sums: dict[str, list[str]] = {part: [] for part in parts}
        self.folder.mkdir(parents=True, exist_ok=True)
        shapes = {
            name: (np.dtype(dtype), (count, *row))
            for count, rows in parts.values()
            for name, (dtype, row) in rows.items()
        }
        self.arrays = self._reopen(shapes)
        if self.arrays is None:
            self._remove(shapes)
            make = np.lib.format.open_memmap
            self.arrays = {name: make(self._file(name), "w+", *shape) for name, shape in shapes.items()}

    def finished_poses(self, part: str) -> int:
        """Return how many of a part's poses have all their rows."""
        return min(len(self._sums[part]) * self.chunk, self.poses[part])

    def checkpoint(self, part: str) -> None:
        """Record that the next chunk of a part is done; all of its rows are filled."""
        for name in self._names[part]:
            self.arrays[name].flush()
        self._sums[part].append(self._sum(part, len(self._sums[part])))
        state = {"key": self.key, "headers": self._headers(), "sums": self._sums}
        write_sealed(self.folder / STATE, lambda stream: stream.write(json.dumps(state).encode()))

    def move(self, names: list[str], target: Path) -> None:
        """Move finished arrays into another folder; they are never in two places, where a write would change both.

        If the run is killed after this, the next one evaluates all samples again, to the same bytes.
        """
        del self.arrays
        (self.folder / STATE).unlink()
        for name in names:
            shutil.move(self._file(name), target / f"{name}.npy")

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.npy"

    def _reopen(self, shapes: dict) -> dict[str, np.memmap] | None:
        """Return the arrays of an earlier call with this key, or None to begin anew; damaged chunks are forgotten."""
        state = read_sealed(self.folder / STATE, json.load)
        if state is None or state["key"] != self.key:
            return None
        with suppress(OSError, ValueError):
            arrays = {name: np.load(self._file(name), mmap_mode="r+", allow_pickle=False) for name in shapes}
            if all((arrays[name].dtype, arrays[name].shape) == shapes[name] for name in shapes):
                self.arrays = arrays
                if self._headers() == state["headers"]:
                    for part, sums in state["sums"].items():
                        self._sums[part] = self._sound(part, sums)
                    return arrays
        self._report("an array is gone or its header is damaged", "all samples")
        return None

    def _sound(self, part: str, sums: list[str]) -> list[str]:
        """Return the checksums of a part up to the first damaged chunk."""
        for chunk, checksum in enumerate(sums):
            if self._sum(part, chunk) != checksum:
                first = chunk * self.chunk
                self._report(f"{part} poses from {first} on differ from their checksum", "they")
                return sums[:chunk]
        return sums

    def _sum(self, part: str, chunk: int) -> str:
        rows = slice(chunk * self.chunk, (chunk + 1) * self.chunk)
        digest = hashlib.sha256()
        for name in self._names[part]:
            digest.update(np.ascontiguousarray(self.arrays[name][rows]))
        return digest.hexdigest()

    def _headers(self) -> str:
        """Return a checksum of the files' headers."""
        digest = hashlib.sha256()
        for name, array in self.arrays.items():
            with open(self._file(name), "rb") as stream:
                digest.update(stream.read(array.offset))
        return digest.hexdigest()

    def _remove(self, names: Mapping) -> None:
        for file in (self.folder / STATE, *map(self._file, names)):
            file.unlink(missing_ok=True)

    def _report(self, damage: str, lost: str) -> None:
        print(f"{self.folder}: damaged ({damage}); {lost} are evaluated again", file=sys.stderr, flush=True)


# Training, validation and test poses of a rig that is known only by its samples.

ENOUGH = 0.5  # share of the wanted training poses, below which frames are added to the drawn ones


def choose_known(
    known: KnownPoses, clips: Sequence[Clip] | None, config: SamplesConfig, rng: Callable[[str], np.random.Generator]
) -> dict[str, Float32[np.ndarray, "k m"]]:
    """Return known poses by part: "training", "validation" and "test"; raise InputError if a part would be empty.

    rng: a stream's name → its generator.

    Without clips, all poses are split like the frames of one clip, and the test keeps at most `config.uniform_test`.
    """
    split = split_clips if clips and config.split == "clips" else split_frames
    values = [clip.values for clip in clips] if clips else [np.asarray(known.frame_params)]
    animation, test = split(values, rng("split"), config.held_out)
    animation, validation = hold_out(animation, config.validation, rng("validation"))
    if not clips:
        test = _some(test, config.uniform_test, rng("uniform_test"))
        training = animation
    else:
        held_out = {pose.tobytes() for pose in (*test, *validation)}
        # drawn poses that are not held out, nor is the frame that they were drawn from
        leaks = np.array([pose.tobytes() in held_out for pose in np.asarray(known.frame_params)])
        source = np.asarray(known.drawn_source)
        fit = (source < 0) | ~leaks[source]  # −1 stands for no source; it reads the last frame, which is ignored
        fit &= np.array([pose.tobytes() not in held_out for pose in np.asarray(known.drawn_params)], bool)
        training = np.asarray(known.drawn_params)[fit]
        if len(training) < ENOUGH * config.count:
            training = np.concatenate([training, _some(animation, config.count - len(training), rng("frames"))])
    training = _some(training, config.count, rng("training"))
    if not len(training):
        raise InputError("the samples: expected at least one pose to train on, got none")
    return dict(zip(PARTS, (training, validation, test), strict=True))


def _some(poses: np.ndarray, count: int, generator: np.random.Generator) -> np.ndarray:
    """Return at most `count` of some poses, drawn at random, in their order."""
    if len(poses) <= count:
        return poses
    return poses[np.sort(generator.choice(len(poses), count, replace=False))]
