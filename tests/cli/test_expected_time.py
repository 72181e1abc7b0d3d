"""The time that is said before a run: that of the reference's stages, in proportion to steps, over the workers."""

import json
from dataclasses import replace

import numpy as np
import pytest
import sample_folders

from data_recipes.early_checks import recipe_controls
from data_recipes.recipe.reading import load_recipe
from replicate.base.paths import REFERENCE
from replicate.cli.running import Known, foresee, known_times, stage_s, work
from replicate.config import resolve
from replicate.engine.scheduler import wall_s
from replicate.engine.stage import in_order
from replicate.methods.method_registry import choose, method_named, sections
from replicate.methods.plan import Plan
from replicate.targets.reference.times import times_card
from replicate.targets.table2 import stages

TIMES = {"coarse-teen": 600.0, "rig-teen": 10.0, "coarse-tiny": 66.0, "samples-teen": 100.0, "linear-teen": 30.0}


@pytest.fixture
def folder(tmp_path):
    """A folder of results whose manifest has the times of some stages, run with `laptop`."""
    facts = {"profile": "laptop", "stages": {title: {"wall_s": seconds} for title, seconds in TIMES.items()}}
    (tmp_path / "manifest.json").write_text(json.dumps({"profile": "laptop", "characters": {"teen": facts}}))
    return tmp_path


def stage_of(name: str, character: str, profile: str = "laptop", overrides: dict | None = None):
    config = resolve(character, profile, overrides, sections=sections(profile))
    return {stage.name: stage for stage in in_order(list(method_named(name).stages(Plan(config))))}[name]


def test_a_stage_takes_as_long_as_the_reference_in_proportion_to_its_steps(folder):
    known = known_times(folder)
    assert stage_s(stage_of("coarse", "teen"), known) == 600
    assert stage_s(stage_of("coarse", "teen", "quick"), known) == pytest.approx(600 * 800 / 22_000)
    half = {"coarse": {"training": {"batch": 4}}}
    assert stage_s(stage_of("coarse", "teen", overrides=half), known) == pytest.approx(300)
    assert stage_s(stage_of("coarse", "toon"), known) == 600, "of the teen, where the character's is unknown"
    assert stage_s(stage_of("coarse", "tiny"), known) == 66


def test_what_is_fitted_to_each_control_takes_longer_where_there_are_more_than_the_teen_has(folder, tmp_path):
    wide = sample_folders.write(tmp_path / "box")
    more = 2 * len(recipe_controls(load_recipe("teen"))) - len(sample_folders.NAMES)
    with (wide / "controls.csv").open("a") as file:
        file.writelines(f"more_{k},0,0,1,mouth\n" for k in range(more))
    for shard in (wide / "poses").iterdir():
        with np.load(shard) as stored:
            arrays = dict(stored)
        np.savez(shard, **arrays | {"params": np.pad(arrays["params"], ((0, 0), (0, more)))})
    known = known_times(folder) | {"regional-teen": Known(50.0, "laptop")}
    assert stage_s(stage_of("linear", str(wide)), known) == 4 * 30
    assert stage_s(stage_of("regional", str(wide)), known) == 2 * 50
    assert stage_s(stage_of("squares", str(wide)), known) == 4 * 4 * 30
    assert stage_s(stage_of("coarse", str(wide)), known) == 600
    assert stage_s(stage_of("linear", str(wide)), known | {"linear-box": Known(7.0, "laptop")}) == 7
    assert stage_s(stage_of("linear", "tiny"), known) == 30, "fewer controls than the teen's save little"


def test_kin_tell_the_times_that_the_reference_lacks_and_strangers_have_none(folder):
    known = known_times(folder)
    assert stage_s(stage_of("coarse_line", "teen"), known) == 600
    assert stage_s(stage_of("squares", "teen"), known) == 120
    assert stage_s(stage_of("regional", "teen"), known) is None
    assert stage_s(stage_of("pca", "teen"), known | {"dense-teen": Known(50.0, "laptop")}) == 50


def test_work_is_shared_by_workers_but_a_chain_is_not():
    plan = Plan(resolve("tiny", "quick"))
    coarse = method_named("coarse").stages(plan)[0]
    chain = in_order([coarse])
    times = {stage.identifier: 10.0 for stage in chain}
    assert wall_s(chain, times, 1) == 10 * len(chain)
    depth = wall_s(chain, times, 100)
    assert 10 * 3 <= depth < 10 * len(chain), "rig, samples and what follows wait for each other"
    assert wall_s([coarse], {coarse.identifier: 10.0}, 2) == 10, "what is in the cache takes no time"


def test_the_sentence_names_time_workers_and_what_is_unknown(folder):
    coarse, regional = stage_of("coarse", "teen"), stage_of("regional", "teen")
    line = "1 artefact to make: about 10 min on 2 cores, if they are as fast as those of the reference results and idle"
    assert foresee([coarse], 2, folder)[0] == line
    assert foresee([coarse, regional], 1, folder)[0].endswith("; without regional, whose times are unknown")
    assert foresee([regional], 2, folder)[0] == "" == foresee([coarse], 2, folder / "nowhere")[0]
    assert "about a minute on 1 core," in foresee([stage_of("linear", "teen")], 1, folder)[0]


def test_the_committed_results_know_the_times_of_all_rows():
    config = resolve("teen", "laptop", sections=sections("laptop"))
    graph = in_order(stages(Plan(config), choose(["all"], config)))
    line = foresee(graph, 2, REFERENCE)[0]
    assert "about" in line and "unknown" not in line.removesuffix("; without lines, whose times are unknown"), (
        "the lines beside networks are a stage that the reference results don't have yet"
    )
    assert work(stage_of("lbs16", "teen")) > work(replace(stage_of("lbs16", "teen", "quick")))


def test_of_several_seeds_the_shortest_whole_run_counts(tmp_path):
    seconds = {"coarse-teen": (900.0, False), "coarse-teen-seed1": (700.0, False), "coarse-teen-seed2": (9.0, True)}
    times = {title: {"wall_s": time, "resumed": resumed} for title, (time, resumed) in seconds.items()}
    facts = {"profile": "laptop", "stages": times | {"dense-teen": {"wall_s": 5.0, "resumed": True}}}
    (tmp_path / "manifest.json").write_text(json.dumps({"profile": "laptop", "characters": {"teen": facts}}))
    assert known_times(tmp_path) == {"coarse-teen": Known(700.0, "laptop"), "dense-teen": Known(5.0, "laptop")}


def test_a_table_shows_what_is_said_before_runs(folder):
    table = times_card(folder)
    assert table.headers == (("", "teen", "woman", "dragon", "toon"),)
    hour, *_ = (row[1:] for row in table.body if row[0] == "`make table2`")
    assert len(set(hour)) == 1 and hour[0].endswith("min"), "all by the teen's times, the only ones that are known"
    config = resolve("teen", "laptop", sections=sections("laptop"))
    assert f"about {hour[0]} on 2 cores" in foresee(in_order(stages(Plan(config), choose([], config))), 2, folder)[0]
