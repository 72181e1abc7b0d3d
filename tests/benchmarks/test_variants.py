"""Benchmarks of trainings: each character's rows are shown and kept before the next one's trainings begin."""

from argparse import Namespace

from replicate.benchmarks import bench_regional
from replicate.benchmarks import variants as trainings
from replicate.benchmarks.variants import Variant, compare_variants, variants_tables
from replicate.config import resolve
from replicate.report.results import Row, read_results

CHANGES = {"dense": ("as it is",)}


def variants(character, profile, steps):
    overrides = {"dense": {"training": {"steps": steps}}}
    return [Variant("dense", "as it is", resolve(character, profile, overrides))]


def test_each_characters_trainings_are_shown_and_kept_before_the_next_ones(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    file, kept = tmp_path / "bench" / "bench_toy.csv", []

    def train(name, chosen):
        kept.append([row.character for row in read_results(file)] if file.is_file() else [])
        (one,) = chosen
        facts = ("deg", float(one.config.dense.training.steps), None, 1, 64, "laptop", "r")
        return [Row(name, one.config.character, one.method, f"validation_normal_error[{one.change}]", *facts)]

    def tables(rows):
        return variants_tables(rows, "bench_toy", "Toys", CHANGES)

    monkeypatch.setattr(trainings, "train_variants", train)
    options = Namespace(characters="teen,toon", profile="quick", steps=7)
    compare_variants("bench_toy", variants, tables, options, ["--steps", "7"])
    rows = read_results(file)
    assert kept == [[], ["teen"]] and [(row.character, row.value) for row in rows] == [("teen", 7.0), ("toon", 7.0)]
    printed = capsys.readouterr().out
    places = [printed.index(words) for words in ("Toys: teen", "written to", "Toys: toon")]
    assert printed.count("7.00") == 2 and places == sorted(places)


def test_only_the_trainings_that_are_named_run_and_the_rows_of_the_others_stay(monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    config = resolve("teen", "quick", {})

    def two(character, profile, steps):
        return [Variant("dense", change, config) for change in ("as it is", "wider")]

    def train(name, chosen):
        facts = ("deg", float(len(kept)), None, 1, 64, "laptop", "r")
        return [Row(name, "teen", v.method, f"validation_normal_error[{v.change}]", *facts) for v in chosen]

    kept = []
    monkeypatch.setattr(trainings, "train_variants", train)
    for only in ("", "dense, wid"):
        options = Namespace(characters="teen", profile="quick", steps=7, only=only)
        compare_variants("bench_toy", two, lambda rows: [], options, [])
        kept.append(only)
    values = {row.metric: row.value for row in read_results(tmp_path / "bench" / "bench_toy.csv")}
    assert values == {"validation_normal_error[as it is]": 0.0, "validation_normal_error[wider]": 1.0}


def test_a_profile_that_there_is_not_ends_in_a_sentence(capsys):
    assert bench_regional.main(["--profile", "huge"]) == 2
    assert "there is no profile huge: there are quick, laptop, paper" in capsys.readouterr().err
