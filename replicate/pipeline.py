"""The graph of stages behind Table 2; what each stage does is in `stage_bodies`.

rig ─┬─ samples ──┬─ rigid ─┬─ coarse ───┬─ refined
     └─ influence ┘         ├─ selection ┘
                            └─ dense
     samples ── lbs16, lbs24, lbs32         each method ── its errors ── table2
"""

from data_recipes.rig import recipe_files
from replicate.config import Config
from replicate.paths import recipe_file
from replicate.stage_bodies import Character, Measured, Reported, Section, Selection
from replicate.stages import Stage

BODIES = "replicate.stage_bodies"


def table2_graph(config: Config) -> list[Stage]:
    """Return the stages of one character's Table 2; its table is the last, the slow ones come first."""
    character = recipe_file(config.character).stem
    label = f"{character}-seed{config.seed}" if config.seed else character

    def stage(name: str, settings: object, *inputs: Stage, body: str = "") -> Stage:
        return Stage(name, f"{BODIES}:make_{body or name}", settings, inputs, label)

    files = recipe_files(config.character)
    rig = Stage("rig", f"{BODIES}:make_rig", Character(config.character), label=character, files=files)
    samples = stage("samples", Section(config.samples, config.seed), rig)
    influence = stage("influence", Section(config.samples, config.seed), rig)
    rigid = stage("rigid", Section(config.rigid, config.seed), rig, samples)
    nets = (rig, samples, influence, rigid)
    coarse = stage("coarse", Section(config.coarse, config.seed, config.device), *nets)
    where = config.refinement
    deciding = Selection(where.poses, where.square, where.clusters_max, config.coarse.map_size)
    selection = stage("selection", Section(deciding, config.seed), *nets)
    refined = stage("refined", Section(config.refinement, config.seed, config.device), rig, samples, coarse, selection)
    dense = stage("dense", Section(config.dense, config.seed, config.device), *nets)
    skins = [
        stage(f"lbs{bones}", Section(config.lbs, config.seed, bones=bones), rig, samples, body="lbs")
        for bones in config.lbs.bones
    ]
    wrinkled = stage("wrinkled", None, rig, samples)
    measured = {
        "coarse": (coarse, rigid),
        "refined": (coarse, refined, rigid),
        "dense": (dense, rigid),
        "neutral": (rigid,),
        "attachment": (rigid,),
        "floor": (influence, rigid),
        "floor_refined": (influence, rigid, selection),
        **{skin.name: (skin, rigid) for skin in skins},
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
    reported = Reported(character, config.profile, config.seed)
    table = stage("table2", reported, rig, samples, wrinkled, rigid, coarse, selection, refined, dense, *errors)
    return [coarse, refined, dense, *reversed(skins), *errors, table]
