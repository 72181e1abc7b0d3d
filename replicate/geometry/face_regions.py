"""The regions of a face: forehead, eyes, mouth and so on, as the marks of its rig name them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from replicate.geometry.mesh import Mesh

# Readers' names for the regions of marks; other names stay. Marks on the brows stand for the forehead.
READERS_NAMES = {"brows": "forehead", "eye_left": "eyes", "eye_right": "eyes"}
NO_REGION = -1


def face_regions(
    mesh: Mesh, marks: Int[np.ndarray, " k"], regions: Sequence[str]
) -> tuple[tuple[str, ...], Int[np.ndarray, " f"]]:
    """Return the names of a face's regions, from top to bottom, and the index of each mesh face's region.

    marks: vertices all over the face.
    regions: the region of each mark.

    A mesh face belongs to the region of the mark nearest to its centre in the neutral pose. Mesh faces of segments
    without marks (skull, neck, teeth …) have `NO_REGION`.
    """
    from scipy.spatial import cKDTree  # slow

    if not len(marks):
        return (), np.full(len(mesh.faces), NO_REGION, np.int8)
    places = mesh.neutral[marks]
    labels = np.array([READERS_NAMES.get(region, region) for region in regions])
    names = sorted(set(labels.tolist()), key=lambda name: -float(places[labels == name, 1].mean()))
    nearest = cKDTree(places).query(mesh.neutral[mesh.faces].mean(1))[1]
    index = np.array([names.index(name) for name in labels], np.int8)[nearest]
    skin = np.isin(mesh.segment[mesh.faces], mesh.segment[marks]).all(1)
    return tuple(names), np.where(skin, index, np.int8(NO_REGION))
