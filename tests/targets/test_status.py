"""`make status`: a line a target, from what stands in the cache; no file is hashed for it."""

import shutil

import pytest
from toy_stages import ToyConfig

from replicate import __main__ as cli
from replicate.cli.running import Known
from replicate.engine import store
from replicate.engine.cache_report import UP_TO_DATE, known_titles, states
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage
from replicate.targets.status import cache_line, inventory, target_line

KNOWN = {"first-teen": Known(600.0, "quick"), "last-teen": Known(1200.0, "quick")}


def graph(character: str, seed: int = 0) -> list[Stage]:
    first = Stage("first", "toy_stages:numbers", ToyConfig(seed), label=character)
    return [first, Stage("last", "toy_stages:total", ToyConfig(), (first,), label=character)]


def line(graphs: dict[str, list[Stage]]) -> str:
    every = [stage for each in graphs.values() for stage in each]
    there = {stage.identifier for stage, state in states(every) if state == UP_TO_DATE}
    return target_line(graphs, there, known_titles(), KNOWN, 1)


def test_a_target_is_up_to_date_or_has_artefacts_to_make_or_was_never_made(cache):
    assert line({"teen": graph("teen")}) == "teen: never made; 2 artefacts to make, about 30 min"
    run(graph("teen")[:1])
    assert line({"teen": graph("teen")}) == "teen: never made; 1 of 2 artefacts to make, about 20 min"
    run(graph("teen"))
    assert line({"teen": graph("teen")}) == "teen: up to date"
    assert line({"teen": graph("teen", seed=1)}) == "teen: 2 artefacts to make, about 30 min", "made from another seed"
    shutil.rmtree(store.artefact_folder(graph("teen")[0].identifier))
    assert line({"teen": graph("teen")}) == "teen: 1 of 2 artefacts to make, about 10 min"


def test_characters_in_the_same_state_share_their_place_in_the_line(cache):
    run(graph("teen"))
    both = line({"teen": graph("teen"), "toon": graph("toon"), "ict": graph("ict")})
    assert both == "teen: up to date; toon, ict: never made; 4 artefacts to make, about 60 min", "as the teen's"


def test_an_artefact_that_has_lost_a_file_is_to_be_made_and_no_file_is_read_to_know_it(cache, monkeypatch):
    run(graph("teen"))
    with monkeypatch.context() as patched:
        patched.setattr(store, "_digest", lambda file: pytest.fail(f"{file} was hashed"))
        assert line({"teen": graph("teen")}) == "teen: up to date"
        assert cache_line(inventory()).startswith("2 current (")
    (store.artefact_folder(graph("teen")[1].identifier) / "numbers.json").unlink()
    assert line({"teen": graph("teen")}) == "teen: 1 of 2 artefacts to make, about 20 min"


def test_the_cache_is_one_line_of_the_states_that_there_are(cache):
    assert cache_line(inventory()) == "nothing"
    run(graph("teen"))
    (cache / "scratch" / graph("toon")[0].identifier).mkdir()
    text = cache_line(inventory())
    assert text.startswith("2 current (0.0 MB), 3 unfinished or logs (0.0 MB)") and "stale" not in text


def test_status_fits_a_screen_and_has_the_hashes_where_they_are_asked_for(capfd, cache):
    assert cli.main(["status", "--profile", "quick", "--characters", "tiny"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert len(lines) <= 25 and max(map(len, lines[:-1])) <= 80
    assert any(text.startswith("table2 ") and "tiny: never made" in text for text in lines)
    assert lines[-1] == f"nothing in {cache}"
    assert cli.main(["status", "--profile", "quick", "--characters", "tiny", "--details"]) == 0
    assert len(capfd.readouterr().out.splitlines()) > 50
