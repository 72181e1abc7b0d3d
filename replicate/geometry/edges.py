"""Edges of a triangle mesh."""

import numpy as np
from jaxtyping import Int


def edges(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "e 2"]:
    """Return every undirected edge once, smaller index first, sorted."""
    pairs = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(pairs, axis=0)


def inner_edges(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "e 2"]]:
    """Return the edges that exactly two faces share, as (vertex pairs, face pairs); the first face runs a → b."""
    directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(faces)), 3)
    undirected = np.sort(directed, axis=1)
    order = np.lexsort((directed[:, 0] > directed[:, 1], undirected[:, 1], undirected[:, 0]))
    ordered = undirected[order]
    starts = np.flatnonzero(np.r_[True, (ordered[1:] != ordered[:-1]).any(1)])
    pairs = starts[np.diff(np.r_[starts, len(ordered)]) == 2]
    return ordered[pairs], np.stack([owner[order[pairs]], owner[order[pairs + 1]]], 1)
