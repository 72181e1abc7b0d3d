"""A small folder of samples of one of our rigs, so that the format can be tried before a rig of one's own is there."""

from pathlib import Path

from replicate.artefacts.built_rig import rig_of
from replicate.config import SamplesConfig
from replicate.engine import paths
from replicate.export.drawn_shards import drawn_shards

CHARACTER = "toon"  # it has no clips, so that few poses will do
SAMPLES = SamplesConfig(count=120, validation=8, uniform_test=40)


def example_folder() -> Path:
    """Return a folder of the toon's samples; it is written where it isn't there yet (half a minute, 10 MB)."""
    from data_recipes.catalogue import write_folder
    from data_recipes.recipe_paths import FACE_FILE

    folder = paths.run_folder("export") / f"{CHARACTER}_example"
    if not (folder / FACE_FILE).is_file():
        rig = rig_of(CHARACTER)
        write_folder(rig, folder, *drawn_shards(rig, SAMPLES, seed=0))
    return folder
