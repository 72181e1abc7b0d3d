"""What it takes to train a method: the time of the stages behind its errors, from their artefacts' manifests."""

from pathlib import Path

from replicate.engine.store import artefact_folder, read_manifest

SHARED = "replicate.artefacts."  # modules of what all methods share: rig, samples, segments


def training_s(errors: Path) -> float | None:
    """Return the seconds of all stages that made a method, one core each; None where there is none.

    errors: the folder of the method's errors. What its stages build on counts too (a coarse model below its refinement,
    the networks that are compacted), once; what all methods share does not. None also where a stage was stopped and
    went on from a checkpoint: its manifest has the time of the last part alone. Wall times: they are longer on a
    machine that does something else besides. None, too, where an artefact is gone from the cache.
    """
    try:
        manifests = _behind(errors, {})
    except FileNotFoundError:
        return None
    if not manifests or any(manifest.get("resumed") for manifest in manifests.values()):
        return None
    return float(sum(manifest["wall_s"] * max(1, manifest["threads"]) for manifest in manifests.values()))


def _behind(folder: Path, found: dict[str, dict]) -> dict[str, dict]:
    """Return the manifests of a method's stages by identifier: those that a folder's artefact was made from."""
    for identifier in read_manifest(folder)["inputs"].values():
        source = artefact_folder(identifier)
        manifest = read_manifest(source)
        if identifier not in found and not manifest["function"].startswith(SHARED):
            found[identifier] = manifest
            _behind(source, found)
    return found
