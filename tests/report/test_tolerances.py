"""The bands of tolerances.toml: the committed tables and every seed of them lie inside, and faults drive them out."""

import re
import tomllib
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from math import isclose, isnan, pi
from pathlib import Path

import pytest

from replicate.base import paths
from replicate.report.results import Row, read_results, read_seeds
from replicate.timing.single_poses import EXACT, parted

TOLERANCES = tomllib.loads((Path(__file__).parent / "tolerances.toml").read_text(encoding="utf-8"))
TABLES = TOLERANCES["tables"]
PARTS = [(table, character) for table, facts in TABLES.items() for character in facts["characters"]]
PLACES = ("one_core", "all_cores", "gpu")
FAULTS = sorted({entry["fault"] for entry in TOLERANCES["ratio"] if "fault" in entry})
REPLACED = {"refinement_left_out": ("refined", "coarse"), "half_of_the_bones": ("lbs32", "lbs16")}
STANDARD = (
    *("neutral", "coarse", "refined", "dense", "lbs16", "lbs24", "lbs32", "regional", "linear"),
    *("floor", "floor_refined", "attachment"),
)
TIMED = ("coarse", "refined", "dense", "regional", "linear")
MEANS = ("vertex_error_mean", "normal_error_mean")


def like(table: str) -> str:
    """Return the table that one in a folder of its own is like: its file and ratios are that table's."""
    return TABLES[table].get("like", table)


def parts_like(table: str) -> list[tuple[str, str]]:
    return [part for part in PARTS if like(part[0]) == table]


StageSettings = dict[tuple[str, str], float]  # of one table and character, by method and metric


@dataclass(frozen=True)
class Band:
    """The ends between which a number, or its ratio to another one, has to lie."""

    key: tuple[str, str]
    over: tuple[str, str] | None
    low: float
    high: float
    about: str
    fault: str | None = None


def reference_file(name: str, target: str) -> Path:
    """Return a file of the reference results; where it is missing the target that makes it is named."""
    file = paths.REFERENCE / name
    assert file.is_file(), f"{file} is missing: `{target}` makes it in results/runs, and `make reference` puts it there"
    return file


@cache
def committed_rows(table: str) -> list[Row]:
    return read_results(reference_file(f"{place_of(table)}.csv", TABLES[table]["target"]))


def place_of(table: str) -> str:
    """Return the path of a table's file within the reference results, without its ending."""
    return str(Path(TABLES[table].get("folder", ""), like(table)))


@cache
def committed(table: str, character: str) -> StageSettings:
    """Return the committed numbers of a table; of its segments those of the attachment alone, which has a band."""
    rows = (row for row in committed_rows(table) if row.character == character)
    return {row.key[2:]: row.value for row in rows if row.table == like(table) or row.method == "attachment"}


@cache
def committed_seeds(table: str) -> dict[int, list[Row]]:
    return read_seeds(reference_file(f"{place_of(table)}_seeds.csv", TABLES[table]["target"]))


@cache
def seeds_of(table: str, character: str) -> dict[int, StageSettings]:
    """Return the committed numbers of every seed of a Table 2 by itself."""
    seeds = committed_seeds(table)
    numbers = {
        seed: {row.key[2:]: row.value for row in rows if row.character == character} for seed, rows in seeds.items()
    }
    return {seed: found for seed, found in numbers.items() if found}


def target_of(table: str, character: str) -> str:
    facts = TABLES[table]
    return facts.get("targets", {}).get(character, f"{facts['target']} CHARACTERS={character}")


def with_ratios(numbers: StageSettings) -> StageSettings:
    """Return Table 3's numbers with what is judged of its times: speed-ups, and each evaluation over the best.

    Of a GPU's also the least time over that of one core.
    """
    found, bests = dict(numbers), {}
    for place in PLACES:
        times = {name: ms for (name, metric), ms in numbers.items() if metric == f"time_{place}"}
        best = bests.setdefault(place, {})
        for name, ms in times.items():
            method, ending = parted(name)
            if ending in EXACT:
                best[method] = min(ms, best.get(method, ms))
        for slow in {"rig", "rig_nodes", "refined"} & best.keys():
            found |= {(method, f"speed_up_{place}[{slow}]"): best[slow] / ms for method, ms in best.items()}
        found |= {(name, f"slower_than_best_{place}"): ms / best[parted(name)[0]] for name, ms in times.items()}
    on_one, on_gpu = bests["one_core"], bests["gpu"]
    return found | {(method, "gpu_over_one_core"): ms / on_one[method] for method, ms in on_gpu.items()}


def judged(table: str, numbers: StageSettings) -> StageSettings:
    return with_ratios(numbers) if like(table) == "table3" else numbers


def _levels(table: str, character: str) -> Iterator[Band]:
    for entry in TOLERANCES["level"]:
        columns = entry.get("characters", TABLES[table]["characters"]) if entry["table"] == table else []
        if character not in columns:
            continue
        widest, rounding = 1 + entry.get("factor", 0) * entry.get("spread", 0), entry.get("rounding", 0)
        for method, lines in entry["expected"].items():
            for metric, values in lines.items():
                assert len(values) == len(columns), f"tolerances.toml: {method}.{metric} has {len(values)} columns"
                value = values[columns.index(character)]
                if not isnan(value):
                    ends = value / widest - rounding, value * widest + rounding
                    yield Band((method, metric), None, *ends, f"{value:g}: {entry['reason']}")


def _ratios(table: str, character: str) -> Iterator[Band]:
    keys = judged(table, committed(table, character))
    for entry in TOLERANCES["ratio"]:
        if like(table) != entry["table"] != table or table in entry.get("absent", ()):
            continue
        other = entry.get("other", {})
        low, high = other.get(table) or other.get(character) or (entry["low"], entry["high"])
        method, metric = entry["value"]["method"], entry["value"]["metric"]
        found = [key for key in keys if re.fullmatch(method, key[0]) and re.fullmatch(metric, key[1])]
        for key in found or [(method, metric)]:  # a number that is missing is asked for by name
            over = (
                (entry["over"].get("method", key[0]), entry["over"].get("metric", key[1])) if "over" in entry else None
            )
            yield Band(key, over, low, high, f"{entry['name']}: {entry['reason']}", entry.get("fault"))


@cache
def bands_of(table: str, character: str) -> list[Band]:
    return [*_levels(table, character), *_ratios(table, character)]


def red(table: str, character: str, numbers: StageSettings, partly: bool = False) -> dict[Band, str]:
    """Return the bands that some numbers leave, with a sentence on each. partly: some may be absent."""
    present, found = judged(table, numbers), {}
    for band in bands_of(table, character):
        keys = [key for key in (band.key, band.over) if key]
        if absent := [key for key in keys if key not in present]:
            method, metric = absent[0]
            target = f"`{target_of(table, character)}` makes it in results/runs, and `make reference` puts it there"
            assert partly, f"{table}.csv has no {metric} of {method} for {character}: {target}"
            continue
        value = present[band.key] / (present[band.over] if band.over else 1)
        if not band.low <= value <= band.high:
            what = " of ".join(reversed(band.key)) + (f" over {' of '.join(reversed(band.over))}" if band.over else "")
            found[band] = (
                f"{character}, {what}: expected {band.low:.6g} to {band.high:.6g}, got {value:.6g} ({band.about})"
            )
    return found


def methods_in(bands: Collection[Band]) -> set[str]:
    return {key[0] for band in bands for key in (band.key, band.over) if key}


def segments_that_disagree(numbers: StageSettings) -> list[tuple[str, str]]:
    """Return Table 2's numbers whose segments contradict them: the worst is one's, the mean lies between theirs."""
    parts: dict[tuple[str, str], list[float]] = {}
    for (method, metric), value in numbers.items():
        if "[" in metric:
            parts.setdefault((method, metric.partition("[")[0]), []).append(value)

    def agree(key: tuple[str, str]) -> bool:
        whole, each = numbers[key], parts[key]
        return isclose(whole, max(each), rel_tol=1e-9) if "_max" in key[1] else min(each) <= whole <= max(each)

    assert parts
    return [key for key in parts if not agree(key)]


def spreads(entry: dict) -> Iterator[float]:
    """Return what the committed numbers of some levels differ by over seeds, or between two runs, as shares."""
    table = entry["table"]
    keys = {(method, metric) for method, lines in entry["expected"].items() for metric in lines}
    for row in committed_rows(table):
        if row.character in entry.get("characters", TABLES[table]["characters"]):
            if row.sd and (row.method, row.metric) in keys:
                yield row.sd / abs(row.value)
    for method, metric in keys if table == "table3" else ():
        if parts := re.fullmatch(r"speed_up_(\w+)\[(\w+)\]", metric):
            for character in entry.get("characters", TABLES[table]["characters"]):
                numbers = committed(table, character)

                def change(name: str, rig: str, numbers=numbers, place=parts[1]) -> float:
                    return numbers[name, f"change_time_{place}[{rig}]"]

                if method == "rig":  # timed beside the same method
                    later = change("coarse", "rig_nodes") / change("coarse", "rig")
                elif parts[2] == "refined":
                    later = change(method, "rig") / change("refined", "rig")
                else:
                    later = change(method, parts[2])
                yield max(later, 1 / later) - 1


def entry_name(entry: dict) -> str:
    method, lines = next(iter(entry["expected"].items()))
    return f"{entry['table']}, {method}, {next(iter(lines))}"


@cache
def benchmark_rows() -> list[Row]:
    return read_results(reference_file("bench_faults.csv", "make bench-faults"))


@cache
def faulty_rows(fault: str) -> StageSettings:
    """Return the teen's numbers under a fault of `make bench-faults`, "sound" for none."""
    found = {row.key[2:]: row.value for row in benchmark_rows() if row.table.endswith(f"@{fault}")}
    assert found, f"bench_faults.csv has no fault {fault!r}"
    return found


def changed(
    numbers: StageSettings, change: Callable[[float], float], method: str = ".*", metric: str = ".*"
) -> StageSettings:
    """Return a copy of some numbers with a change to those of some methods and metrics."""
    return {
        key: change(value) if re.fullmatch(method, key[0]) and re.fullmatch(metric, key[1]) else value
        for key, value in numbers.items()
    }


def swapped(numbers: StageSettings, one: str, other: str, metric: str = ".*") -> StageSettings:
    """Return a copy of some numbers with those of two methods, and of all their evaluations, exchanged."""
    names, found = {one: other, other: one}, dict(numbers)
    for name, what in numbers:
        method, ending = parted(name)
        if method in names and (names[method] + ending, what) in numbers and re.fullmatch(metric, what):
            found[name, what] = numbers[names[method] + ending, what]
    return found


# What is committed


@pytest.mark.parametrize(("table", "character"), PARTS)
def test_committed_results_lie_in_their_bands(table, character):
    complaints = [*red(table, character, committed(table, character)).values()]
    assert not complaints


@pytest.mark.parametrize(("table", "character"), parts_like("table2"))
def test_every_seed_by_itself_lies_in_the_bands(table, character):
    several = any((row.seeds or 0) > 1 for row in committed_rows(table) if row.character == character)
    assert len(seeds_of(table, character)) == (3 if several else 1)
    for numbers in seeds_of(table, character).values():
        complaints = [*red(table, character, numbers, partly=True).values()]
        assert not complaints


@pytest.mark.parametrize(("table", "character"), parts_like("table2"))
def test_numbers_of_segments_agree_with_those_of_the_whole(table, character):
    for numbers in seeds_of(table, character).values():
        assert not segments_that_disagree(numbers)


@pytest.mark.parametrize("table", TABLES)
def test_every_character_of_a_table_has_bands_of_its_profile(table):
    facts = TABLES[table]
    assert {row.character for row in committed_rows(table)} == set(facts["characters"])
    for row in committed_rows(table):
        assert row.profile == facts.get("profiles", {}).get(row.character, facts.get("profile", "laptop")), row.key


def test_every_table_in_a_folder_of_its_own_has_bands():
    found = {file.relative_to(paths.REFERENCE) for file in paths.REFERENCE.glob("*/table[1-4].csv")}
    assert found == {Path(f"{place_of(table)}.csv") for table, facts in TABLES.items() if "folder" in facts}


@pytest.mark.parametrize(("table", "character"), PARTS)
def test_every_number_has_a_band_or_a_reason_why_it_has_none(table, character):
    banded = {band.key for band in bands_of(table, character)}
    banded |= {band.over for band in bands_of(table, character) if like(table) == "table3"}
    without = [entry["metric"] for entry in TOLERANCES["unjudged"] if entry["table"] == like(table)]
    bare = {
        (method, metric)
        for method, metric in committed(table, character).keys() - banded
        if not any(re.fullmatch(pattern, metric) for pattern in without)
    }
    assert not bare


@pytest.mark.parametrize("entry", [entry for entry in TOLERANCES["level"] if "spread" in entry], ids=entry_name)
def test_a_band_is_as_wide_as_what_seeds_or_runs_differ_by(entry):
    widest = max(spreads(entry), default=0)
    assert widest <= entry["spread"], f"{entry['reason']}: expected a spread of {widest:.4f} or more"
    assert entry["factor"] >= 2


def test_a_missing_number_and_a_missing_file_name_the_target_that_makes_them(tmp_path, monkeypatch):
    for key in (("refined", "vertex_error_mean"), ("attachment", "vertex_error_mean[rigid]")):
        numbers = {name: value for name, value in committed("table2", "rigify").items() if name != key}
        with pytest.raises(AssertionError, match=r"has no .* of .* for rigify: `make rigify PROFILE=quick` makes it"):
            red("table2", "rigify", numbers)
    with pytest.raises(AssertionError, match="`make table4 CHARACTERS=toon` makes it"):
        red("table4", "toon", {})
    monkeypatch.setattr(paths, "REFERENCE", tmp_path)
    with pytest.raises(
        AssertionError, match=r"table3.csv is missing: `make table3 CONFIG=results/shapes_alone.toml` makes"
    ):
        committed_rows.__wrapped__("table3")


# What faults do


@pytest.mark.parametrize("character", TABLES["table1"]["characters"])
def test_bands_of_table_1_go_red_under_faults(character):
    def lost(value: float) -> float:  # a vertex, a control or a segment
        return value - 1

    sound = committed("table1", character)
    for key in (key for key in sound if "model_size" not in key[1]):
        assert methods_in(red("table1", character, sound | {key: lost(sound[key])})) == {key[0]}
    for factor in (2, 0.5, 1 / 1.048576, 1000):  # weights of 8 or 2 bytes; MiB for MB; kB
        for method in {key[0] for key in sound if "model_size" in key[1]}:
            faulty = changed(sound, lambda size, factor=factor: size * factor, method, "model_size.*")
            assert methods_in(red("table1", character, faulty)) == {method}
    for one, other in combinations(("coarse", "refined", "dense", "dense_released"), 2):
        assert {one, other} <= methods_in(red("table1", character, swapped(sound, one, other, "model_size.*")))


@pytest.mark.parametrize(("table", "character"), parts_like("table2"))
@pytest.mark.parametrize("fault", FAULTS)
def test_bands_of_table_2_go_red_under_what_a_fault_did_to_the_teen(table, character, fault):
    sound, faulty = committed(table, character), {}
    before, after = (faulty_rows(name) for name in ("sound", fault))
    for (method, metric), value in after.items():
        if metric.startswith(MEANS) and (method, metric) in sound:
            quantity = ("neutral", metric.partition("[")[0])
            share = (value - before[method, metric]) / before[quantity]  # of the mean motion
            faulty[method, metric] = sound[method, metric] + share * sound[quantity]
    if fault in REPLACED:  # this fault puts one method's numbers in the place of another's
        method, by = REPLACED[fault]
        faulty = {(method, metric): value for (name, metric), value in sound.items() if name == by}
    concerned = {method for method, metric in after if after[method, metric] != before[method, metric]}
    left = red(table, character, sound | faulty)
    assert concerned <= methods_in(left)
    assert {band for band in bands_of(table, character) if band.fault == fault} <= left.keys()


@pytest.mark.parametrize(("table", "character"), parts_like("table2"))
def test_bands_of_table_2_go_red_where_methods_or_units_are_mixed_up_or_an_error_is_off_by_a_quarter(table, character):
    sound = committed(table, character)
    for one, other in combinations(STANDARD, 2):
        assert red(table, character, swapped(sound, one, other, "(vertex|normal)_error_mean"))
    for method in {method for method, _ in sound if character != "rigify" or method != "attachment"}:
        units = ((".*vertex_error.*", 1e-3), (".*vertex_error.*", 10), (".*normal_error.*", pi / 180))
        for metric, factor in (*units, *((metric, factor) for metric in MEANS for factor in (1.25, 0.8))):
            faulty = changed(sound, lambda value, factor=factor: value * factor, method, metric)
            assert method in methods_in(red(table, character, faulty))


def test_bands_hold_the_sound_run_of_bench_faults_and_each_fault_leaves_those_that_name_it():
    assert not red("table2", "teen", faulty_rows("sound"), partly=True).values()
    for fault in FAULTS:
        left = red("table2", "teen", faulty_rows(fault), partly=True)
        naming = [band for band in bands_of("table2", "teen") if band.fault == fault]
        assert naming and set(naming) <= left.keys()


@pytest.mark.parametrize(("table", "character"), parts_like("table2"))
def test_a_fault_in_segments_alone_disagrees_with_the_whole(table, character):
    sound = seeds_of(table, character)[0]
    for factor in (1e-3, 1e3, pi / 180):
        for metric in (r"vertex_error_mean\[.*", r"normal_error_max\[.*"):
            assert segments_that_disagree(changed(sound, lambda value, factor=factor: value * factor, "coarse", metric))


@pytest.mark.parametrize(("table", "character"), parts_like("table3"))
def test_bands_of_table_3_go_red_under_faults(table, character):
    sound, timed = committed(table, character), "(time|median|p05|p95)_.*"
    speeds = with_ratios(sound)
    for factor in (1e3, 1e-3, 2):  # microseconds or seconds for milliseconds; each pose evaluated twice
        for rig in ("rig", "rig_nodes"):
            faulty = changed(sound, lambda ms, factor=factor: ms * factor, rig, timed)
            assert {*TIMED, "rig"} <= methods_in(red(table, character, faulty))
        for method in TIMED:
            faulty = changed(sound, lambda ms, factor=factor: ms * factor, f"{method}(_.*)?", timed)
            assert method in methods_in(red(table, character, faulty))
    for one, other in [("rig", "rig_nodes"), *combinations(TIMED, 2)]:
        pair = [speeds[name, "speed_up_one_core[rig]"] for name in (one, other)]
        if max(pair) > 1.2 * min(pair):  # two runs can be further apart than some dense networks and CNNs are
            assert {one, other} & methods_in(red(table, character, swapped(sound, one, other, timed)))
    for method in TIMED:  # what falls back to torch's operations, or computes something else
        slow = {(f"{method}_fast", metric): ms for (name, metric), ms in sound.items() if name == method}
        wrong = {(f"{method}_fast", "largest_difference"): 0.01}
        for faulty in (slow, wrong):
            assert f"{method}_fast" in methods_in(red(table, character, sound | faulty))


@pytest.mark.parametrize("character", TABLES["table3_gpu"]["characters"])
def test_bands_of_the_gpus_machine_go_red_under_faults_of_its_gpu_alone(character):
    sound, timed = committed("table3_gpu", character), "(time|median|p05|p95)_gpu"
    for method in TIMED:
        for factor in (1e3, 1e-3, 2, 0.5):  # another unit; each pose evaluated twice; half of the work left out
            faulty = changed(sound, lambda ms, factor=factor: ms * factor, f"{method}_gpu(_graph)?", timed)
            assert method in methods_in(red("table3_gpu", character, faulty))
        calls = {(f"{method}_gpu_graph", key[1]): ms for key, ms in sound.items() if key[0] == f"{method}_gpu"}
        assert f"{method}_gpu" in methods_in(red("table3_gpu", character, sound | calls)), "nothing is recorded"
        wrong = {(f"{method}_gpu_graph", "largest_difference"): 0.01}
        assert f"{method}_gpu_graph" in methods_in(red("table3_gpu", character, sound | wrong))


@pytest.mark.parametrize("character", TABLES["table4"]["characters"])
def test_bands_of_table_4_go_red_under_faults(character):
    sound = committed("table4", character)
    quantity = ("neutral", "vertex_error_mean")
    shares = [faulty_rows(name)["refined", quantity[1]] for name in ("sound", "segment_zeroed")]
    motion = (shares[1] - shares[0]) / faulty_rows("sound")[quantity] * sound[quantity]
    for method in TIMED:
        faults = [
            changed(sound, lambda mm: mm * 1e-3, method, "(vertex|point)_error_mean.*"),  # metres
            changed(sound, lambda deg: deg * pi / 180, method, "normal_error_mean.*"),
            changed(sound, lambda mm: mm + motion, method, "vertex_error_mean.*"),  # a face that stands still
            changed(sound, lambda cosine: -cosine, method, "derivative_cosine.*"),
            *(changed(sound, lambda error: error * 1.5, method, metric) for metric in MEANS),
            # parameters that were never brought within their limits:
            sound | {(method, f"{metric}_limited"): sound[method, metric] for metric in MEANS},
        ]
        for faulty in faults:
            assert method in methods_in(red("table4", character, faulty))
    for one, other in combinations(("neutral", *TIMED), 2):
        if (one, other) != ("coarse", "refined"):  # equal, but for a few poses: drags move little that is refined
            assert {one, other} & methods_in(red("table4", character, swapped(sound, one, other)))
