"""The graphs of stages behind the tables and figures; what each stage does is in `stage_bodies`.

rig ─┬─ samples ──┬─ rigid ─┬─ coarse ───┬─ refined
     └─ influence ┘         ├─ selection ┘
                            └─ dense
     samples ── lbs16, lbs24, lbs32 ── driven      each method ── its errors ── table2

Table 1 and Figures 5, 7 and 8 show rigs and segments, and need nothing that is trained:
     rig, influence, rigid, selection ── table1, figure08      rig, samples ── figure05      rig, rigid ── figure07

What linear blend skinning makes of a face, with more numbers of bones than Table 2:
     rig, samples ── lbs4 … lbs64 ── lbs
"""

from collections.abc import Iterable
from functools import partial

from data_recipes.rig import recipe_files
from replicate.config import Config
from replicate.engine.paths import recipe_file
from replicate.engine.stage import Stage
from replicate.stage_bodies import Character, Drawn, Measured, Reported, Section, Selection, Shape, Sized

BODIES = "replicate.stage_bodies"
SKINS = (4, 8, 16, 24, 32, 48, 64)  # numbers of bones of the figures about LBS
FIGURES = {
    "figure05": ("rig", "samples"),
    "figure07": ("rig", "rigid"),
    "figure08": ("rig", "selection"),
    "lbs": ("rig", "samples"),
}


def _stage(config: Config, name: str, settings: object, *inputs: Stage, body: str = "") -> Stage:
    character = recipe_file(config.character).stem
    label = f"{character}-seed{config.seed}" if config.seed else character
    return Stage(name, f"{BODIES}:make_{body or name}", settings, inputs, label)


def untrained_stages(config: Config) -> dict[str, Stage]:
    """Return, by name, the stages of one character that every graph shares and that train nothing."""
    stage = partial(_stage, config)
    rig = Stage(
        "rig",
        f"{BODIES}:make_rig",
        Character(config.character),
        label=recipe_file(config.character).stem,
        files=recipe_files(config.character),
    )
    samples = stage("samples", Section(config.samples, config.seed), rig)
    influence = stage("influence", Section(config.samples, config.seed), rig)
    rigid = stage("rigid", Section(config.rigid, config.seed), rig, samples)
    where = config.refinement
    deciding = Selection(where.poses, where.square, where.clusters_max, config.coarse.map_size)
    selection = stage("selection", Section(deciding, config.seed), rig, samples, influence, rigid)
    return {found.name: found for found in (rig, samples, influence, rigid, selection)}


def table1_graph(config: Config) -> list[Stage]:
    """Return the last stage of one character's Table 1: its rows. Sizes follow from what the untrained stages find."""
    found = untrained_stages(config)
    shapes = (Shape(part.map_size, part.channels, part.hidden) for part in (config.coarse, config.refinement))
    settings = Sized(recipe_file(config.character).stem, config.profile, *shapes)
    return [_stage(config, "table1", settings, *(found[name] for name in ("rig", "influence", "rigid", "selection")))]


def figure_graph(config: Config, name: str) -> list[Stage]:
    """Return the stage that draws one character's figure; name: one of `FIGURES`.

    "lbs" also needs skins: those of Table 2, and others.
    """
    found = untrained_stages(config)
    inputs = [found[needed] for needed in FIGURES[name]]
    if name == "lbs":
        inputs.append(_stage(config, "wrinkled", None, found["rig"], found["samples"]))
        inputs += skins(config, found["rig"], found["samples"], SKINS)
    settings = Drawn(recipe_file(config.character).stem, config.seed)
    return [_stage(config, name, settings, *inputs)]


def all_graphs(config: Config) -> list[Stage]:
    """Return the last stages of everything that `make` makes of one character."""
    graphs = [table2_graph(config), table1_graph(config), *(figure_graph(config, name) for name in FIGURES)]
    return [stage for graph in graphs for stage in graph]


def skins(config: Config, rig: Stage, samples: Stage, bones: Iterable[int]) -> list[Stage]:
    """Return the stages that fit LBS with several numbers of bones."""
    settings = ((count, Section(config.lbs, config.seed, bones=count)) for count in bones)
    return [_stage(config, f"lbs{count}", own, rig, samples, body="skin") for count, own in settings]


def table2_graph(config: Config) -> list[Stage]:
    """Return the stages of one character's Table 2; its table is the last, the slow ones come first."""
    stage = partial(_stage, config)
    rig, samples, influence, rigid, selection = untrained_stages(config).values()
    nets = (rig, samples, influence, rigid)
    coarse = stage("coarse", Section(config.coarse, config.seed, config.device), *nets)
    refined = stage("refined", Section(config.refinement, config.seed, config.device), rig, samples, coarse, selection)
    dense = stage("dense", Section(config.dense, config.seed, config.device), *nets)
    fitted = skins(config, rig, samples, config.lbs.bones)
    largest = max(fitted, key=lambda skin: skin.config.bones)
    driving = Section(config.driven, config.seed, config.device, largest.config.bones)
    driven = stage("driven", driving, rig, samples, largest)
    wrinkled = stage("wrinkled", None, rig, samples)
    measured = {
        "coarse": (coarse, rigid),
        "refined": (coarse, refined, rigid),
        "dense": (dense, rigid),
        "neutral": (rigid,),
        "attachment": (rigid,),
        "floor": (influence, rigid),
        "floor_refined": (influence, rigid, selection),
        **{skin.name: (skin, rigid) for skin in fitted},
        "driven": (driven, rigid),
    }
    numbers = config.evaluation
    refit = {"refit_sweeps": config.lbs.refit_sweeps, "refit_settled": config.lbs.refit_settled}
    maps = {"map_size": config.coarse.map_size, "refined_map_size": config.refinement.map_size}
    errors = []
    for method, inputs in measured.items():
        poses = numbers.floor_poses if method.startswith("floor") and numbers.floor_poses else numbers.test_poses
        own = refit if method.startswith("lbs") else maps if method.startswith("floor") else {}
        settings = Measured(method, poses, numbers.batch, config.seed, **own)
        errors.append(stage(f"errors_{method}", settings, rig, samples, wrinkled, *inputs, body="errors"))
    reported = Reported(recipe_file(config.character).stem, config.profile, config.seed)
    table = stage("table2", reported, rig, samples, wrinkled, rigid, coarse, selection, refined, dense, driven, *errors)
    return [coarse, refined, dense, *reversed(fitted), driven, *errors, table]
