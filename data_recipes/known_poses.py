"""The poses that a rig is known by, in mm from its neutral pose: memory-mapped arrays in a folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

INT16_MAX = 32767
ROUNDED = ("drawn_whole", "drawn_steps")
NAMES = ("frame_params", "frame_offsets", "drawn_params", *ROUNDED, "drawn_source")


@dataclass(frozen=True)
class KnownPoses:
    """Frames of clips, from which test poses are taken, and poses that are drawn at random, rounded as in D4.

    frame_params (a, m), frame_offsets (a, n, 3) float32 mm; drawn_params (d, m), drawn_whole (d, n, 3) int16 in steps
    of drawn_steps (d,) mm; drawn_source (d,): the frame that each was drawn from, or −1. Of a rig without clips all
    poses stand among the frames.
    """

    frame_params: np.ndarray
    frame_offsets: np.ndarray
    drawn_params: np.ndarray
    drawn_whole: np.ndarray
    drawn_steps: np.ndarray
    drawn_source: np.ndarray

    @classmethod
    def open(cls, folder: Path) -> KnownPoses:
        """Open what `create` made. Raises OSError or ValueError for a file that is missing or damaged."""
        return cls(*(np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False) for name in NAMES))

    def __len__(self) -> int:
        return len(self.frame_params) + len(self.drawn_params)

    @cached_property
    def places(self) -> Mapping[bytes, int]:
        """Where poses stand by the bytes of their parameters: frames first, the first of equal ones."""
        rows = [*self.frame_params, *self.drawn_params]
        return {pose.tobytes(): k for k, pose in reversed(list(enumerate(rows)))}

    def offsets(self, place: int) -> Float32[np.ndarray, "n 3"]:
        """Return the offsets of a pose of `places`."""
        k = place - len(self.frame_params)
        return self.frame_offsets[place] if k < 0 else self.drawn_whole[k] * self.drawn_steps[k]

    def find(self, params: Float[np.ndarray, " m"]) -> int | None:
        """Return where the pose of these parameters stands, or None."""
        return self.places.get((np.asarray(params, np.float32) + np.float32(0)).tobytes())


def create(folder: Path, frames: int, drawn: int, vertices: int, controls: int) -> KnownPoses:
    """Return arrays to fill, in files of a folder."""
    shapes = {
        "frame_params": (np.float32, (frames, controls)),
        "frame_offsets": (np.float32, (frames, vertices, 3)),
        "drawn_params": (np.float32, (drawn, controls)),
        "drawn_whole": (np.int16, (drawn, vertices, 3)),
        "drawn_steps": (np.float32, (drawn,)),
        "drawn_source": (np.int64, (drawn,)),
    }
    make = np.lib.format.open_memmap
    return KnownPoses(*(make(folder / f"{name}.npy", "w+", *shapes[name]) for name in NAMES))
