"""The claims: each rule gives the paper's own verdict on the paper's own numbers, and turns where it says it does."""

from dataclasses import replace

import pytest
from sample_rows import table1_rows, table2_rows

from replicate import __main__ as cli
from replicate.benchmarks.training_table import BALANCED, RAW_ANIMATION
from replicate.engine import paths
from replicate.engine.exceptions import InputError
from replicate.report import notebooks
from replicate.report.results import Row, write_results
from replicate.report.tables import as_latex, as_markdown, as_text
from replicate.targets.claims.claim_verdicts import (
    judge,
    judge_all,
    published_verdict,
    read_verdicts,
    verdict_frame,
    write_verdicts,
)
from replicate.targets.claims.claims_chart import claim_chart
from replicate.targets.claims.claims_table import claims_table, reasons_table, verdicts_of_table2
from replicate.targets.claims.evidence import Evidence, gather, published
from replicate.targets.claims.paper_claims import CLAIMS, claim_named
from replicate.targets.claims.verdict_rules import Comparison, Number, decide, significant

PAPER = published()
THEIRS = ("Hiccup", "Valka", "Toothless", "Ray")
ALL_HOLD = dict.fromkeys(THEIRS, "holds")
UNPRINTED = dict.fromkeys(THEIRS, "not tested")
# What the paper says, character by character, of its own tables.
PAPERS_OWN = {
    "C1": ALL_HOLD,
    "C2": ALL_HOLD,
    "C3": ALL_HOLD,
    "C4": ALL_HOLD | {"Toothless": "fails", "Ray": "fails"},  # "can": no LBS of these two is as close as refined
    "C5": ALL_HOLD | {"Toothless": "fails"},  # its dense model is the best in normals
    "C6": ALL_HOLD,
    "C11": UNPRINTED,
    "C12": UNPRINTED,
}


@pytest.mark.parametrize("name", PAPERS_OWN)
def test_a_rule_gives_the_papers_own_verdict_on_the_papers_own_numbers(name):
    assert {who: published_verdict(claim_named(name), who, PAPER) for who in THEIRS} == PAPERS_OWN[name]
    assert [claim.name for claim in CLAIMS] == list(PAPERS_OWN)


def test_degrees_per_millimetre_would_contradict_the_paper_on_ray():
    """Why C5 isn't judged by what means hint of frequency: for Ray it is the opposite of what Fig. 10 shows."""
    noisier = {}
    for who in THEIRS:
        dense, refined = (
            PAPER.error(who, method, "normal").value / PAPER.error(who, method, "vertex").value
            for method in ("dense", "refined")
        )
        noisier[who] = dense > refined
    assert noisier == {"Hiccup": True, "Valka": True, "Toothless": False, "Ray": False}


def rows(distance=(), normal=(), character="teen", sd=None) -> list[Row]:
    """Return errors of methods, by name; those that are not given have 1 mm and 1 degree."""
    methods = ("coarse", "refined", "dense", "lbs16", "lbs24", "lbs32")
    seeds = 1 if sd is None else 3
    return [
        Row(
            "table2",
            character,
            method,
            f"{kind}_error_mean",
            unit,
            dict(given).get(method, 1.0),
            sd,
            seeds,
            9,
            "quick",
            "r",
        )
        for kind, unit, given in (("vertex", "mm", distance), ("normal", "deg", normal))
        for method in (*methods, *(["linear"] if "linear" in dict(given) else []))
    ]


def verdict(name: str, given: list[Row], character="teen") -> str:
    return judge(claim_named(name), character, Evidence(given), PAPER).verdict


def below(**values: float) -> dict:
    """Return the same values as both errors."""
    return {"distance": values, "normal": values}


@pytest.mark.parametrize(
    ("name", "given", "character", "expected"),
    [
        ("C1", below(refined=0.99), "teen", "holds"),
        ("C1", below(refined=1.0), "teen", "fails"),
        ("C1", {"distance": {"refined": 0.9}, "normal": {"refined": 1.1}}, "teen", "fails"),
        ("C1", {"distance": {"refined": 1.1}, "normal": {"refined": 0.9}}, "teen", "fails"),
        ("C2", {"normal": {"refined": 0.99}}, "teen", "holds"),
        ("C2", {"normal": {"refined": 0.99}}, "ict", "holds"),
        ("C2", {"normal": {"refined": 0.99}}, "dragon", "fails"),
        ("C2", {"normal": {"dense": 0.99}}, "dragon", "holds"),
        ("C2", {"normal": {"dense": 0.99}}, "dragon@one_face", "holds"),
        ("C2", {"normal": {"dense": 0.99}}, "toon", "fails"),
        ("C2", {"normal": {"refined": 0.99, "lbs24": 0.99}}, "teen", "fails"),
        ("C3", {"normal": {"refined": 0.99}}, "dragon", "holds"),
        ("C3", {"normal": {"refined": 0.99, "lbs16": 0.9}}, "teen", "fails"),
        ("C3", {"normal": {"refined": 1.0}}, "teen", "fails"),
        ("C3", {"normal": {"refined": 0.99, "coarse": 0.1, "dense": 0.1}}, "teen", "holds"),
        ("C4", {"normal": {"refined": 0.99}}, "teen", "holds"),  # the same distance is a match
        ("C4", {"distance": {"refined": 0.99}, "normal": {"refined": 0.99}}, "teen", "fails"),
        ("C4", {"distance": {"refined": 0.9, "lbs32": 0.9}, "normal": {"refined": 0.99}}, "teen", "holds"),
        ("C4", {"distance": {"refined": 0.9, "lbs32": 0.8}, "normal": {"lbs32": 0.9}}, "teen", "fails"),
        ("C4", {"normal": {"refined": 1.0}}, "teen", "fails"),
        ("C5", {"normal": {"dense": 1.01}}, "teen", "holds"),
        ("C5", {"normal": {"dense": 1.0}}, "teen", "fails"),
        ("C5", {"normal": {"dense": 1.01, "coarse": 1.02}}, "teen", "fails"),
        ("C5", {"normal": {"dense": 1.01, "lbs16": 2.0}}, "teen", "holds"),
    ],
)
def test_a_verdict_turns_where_its_rule_says(name, given, character, expected):
    assert verdict(name, rows(**given, character=character), character) == expected


@pytest.mark.parametrize(
    ("large", "expected", "words"),
    [
        (15.9, "fails", "1.99 times"),
        (16.0, "holds", "2.00 times"),
        (40.1, "holds", "even smaller, which is no failure"),
    ],
)
def test_c6_needs_twice_the_size_and_does_not_mind_more_than_five_times(large, expected, words):
    one = judge(claim_named("C6"), "teen", Evidence(table1_rows(large=large)), PAPER)
    assert one.verdict == expected and words in one.reason
    assert ("no failure" in one.reason) == (large > 40)


@pytest.mark.parametrize(("mean", "expected"), [(0.299, "holds"), (0.3, "holds"), (0.301, "fails")])
def test_c11_takes_the_rigid_segments_of_the_attachment_rows(mean, expected):
    facts = ("mm", mean, None, 1, 9, "quick", "r")
    given = [
        Row("table2_segments", "teen", "attachment", f"vertex_error_{s}[rigid]", *facts) for s in ("mean", "p95", "max")
    ]
    assert verdict("C11", given) == expected
    assert verdict("C11", [replace(row, table="table2") for row in given]) == "not tested"


@pytest.mark.parametrize(("mm", "degrees", "expected"), [(0.5, 2.0, "fails"), (0.4, 1.9, "holds"), (0.4, 2.1, "fails")])
def test_c12_compares_balanced_draws_with_the_raw_animation(mm, degrees, expected):
    def row(change, kind, unit, value, character="teen"):
        metric = f"validation_{kind}_error[{change}]"
        return Row("bench_training", character, "coarse", metric, unit, value, None, 1, 64, "laptop", "b")

    profile = [row(BALANCED, "vertex", "mm", mm), row(BALANCED, "normal", "deg", degrees)]
    raw = [row(RAW_ANIMATION, "vertex", "mm", 0.5), row(RAW_ANIMATION, "normal", "deg", 2.0)]
    assert verdict("C12", profile + raw) == expected
    assert verdict("C12", profile) == "not tested"
    toon = [replace(row, character="toon") for row in profile + raw]
    assert verdict("C12", toon, "toon") == "not tested", "Ray has no animation"


@pytest.mark.parametrize(
    ("difference", "relation", "expected"),
    [
        (0.41, "smaller", True),
        (0.39, "smaller", False),
        (0.41, "at most", True),
        (0.39, "at most", False),
        (-0.39, "matches", True),
        (-0.41, "matches", False),
    ],
)
def test_with_several_seeds_a_difference_counts_beyond_twice_the_summed_spread(difference, relation, expected):
    left, right = Number("a", 1.0, 0.05), Number("b", 1.0 + difference, 0.15)
    comparison = Comparison("distance", "mm", left, right, relation)
    assert comparison.spread == pytest.approx(0.4) and comparison.satisfied is expected
    assert ("within the spread" in str(comparison)) == (abs(difference) < 0.4)


@pytest.mark.parametrize(("relation", "expected"), [("smaller", False), ("at most", True), ("matches", True)])
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_tie_of_one_seed_is_not_smaller(relation, expected, value):
    assert Comparison("size", "MB", Number("a", value), Number("b", value), relation).satisfied is expected


def test_a_spread_turns_a_verdict_that_a_single_seed_would_give():
    given = {"normal": {"refined": 0.9}}
    assert verdict("C3", rows(**given)) == "holds"
    assert verdict("C3", rows(**given, sd=0.02)) == "holds" and verdict("C3", rows(**given, sd=0.03)) == "fails"
    one = judge(claim_named("C3"), "teen", Evidence(rows(**given, sd=0.03)), PAPER)
    assert one.seeds == 3 and one.sd == one.limit_sd == 0.03 and "within the spread" in one.reason


def test_the_best_way_decides_and_in_it_the_smallest_margin():
    def comparison(left):
        return Comparison("distance", "mm", Number(f"{left}", left), Number("limit", 1.0))

    holds, way, deciding = decide([[comparison(0.1), comparison(1.1)], [comparison(0.8), comparison(0.9)]])
    assert holds and len(way) == 2 and deciding.left.value == 0.9
    holds, _, deciding = decide([[comparison(0.1), comparison(1.5)], [comparison(1.2)]])
    assert not holds and deciding.left.value == 1.2


def test_a_straight_line_that_beats_the_papers_networks_is_mentioned():
    one = judge(claim_named("C3"), "teen", Evidence(rows(normal={"refined": 0.9, "linear": 0.8, "dense": 0.7})), PAPER)
    assert (
        one.verdict == "holds"
        and "A straight line has a smaller normal error than coarse and refined: 0.800°" in one.reason
    )
    for given in (rows(normal={"refined": 0.9, "linear": 2.0}), rows(normal={"refined": 0.9})):
        assert "straight line" not in judge(claim_named("C3"), "teen", Evidence(given), PAPER).reason


def test_numbers_in_sentences_have_the_digits_that_tell_them_apart():
    assert str(Comparison("distance", "mm", Number("a", 0.33351), Number("b", 0.33352))).startswith(
        "distance: a 0.33351 mm < b 0.33352 mm"
    )
    assert [significant(value) for value in (0.0, 0.0760084, 0.9996, 12.345, 1234.5)] == [
        "0.00",
        "0.0760",
        "1.00",
        "12.3",
        "1,230",
    ]


def test_what_is_missing_is_named_with_the_target_that_makes_it():
    one = judge(claim_named("C1"), "woman", Evidence([]), PAPER)
    assert (one.verdict, one.published, one.value) == ("not tested", "holds", None)
    assert "table2.csv has no vertex_error_mean of refined for woman; `make table2 CHARACTERS=woman`" in one.reason


def test_verdicts_are_read_back_as_they_are_and_pivot(tmp_path):
    evidence = Evidence([*rows(normal={"refined": 0.5}), *rows(character="ict"), *table1_rows()])
    verdicts = judge_all(evidence, PAPER)
    write_verdicts(tmp_path / "claims.csv", verdicts)
    assert read_verdicts(tmp_path / "claims.csv") == verdicts
    pivot = verdict_frame(tmp_path / "claims.csv").pivot(index="claim", columns="character", values="verdict")
    assert pivot.loc["C2", "teen"] == "holds" and pivot.loc["C2", "ict"] == "fails"
    assert pivot.shape == (len(CLAIMS), 5) and pivot.loc["C2", "woman"] == "not tested"
    text = (tmp_path / "claims.csv").read_text().replace("not tested", "undecided")
    (tmp_path / "claims.csv").write_text(text)
    with pytest.raises(InputError, match=r"claims.csv, line \d+: verdict is 'undecided'"):
        read_verdicts(tmp_path / "claims.csv")


def test_claims_about_table_2_are_judged_on_a_runs_own_rows_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    folder = paths.run_folder("quick")
    folder.mkdir()
    write_results(folder / "table2.csv", rows(normal={"refined": 0.5}))
    table = verdicts_of_table2("quick")
    assert table.headers[0] == ("", "teen (Hiccup)") and [line[0][:2] for line in table.body] == [*PAPERS_OWN][:5]
    assert table.body[1][1] == "holds" and not any("C7" in note for note in table.notes)


def test_the_table_marks_what_qualifies_a_verdict():
    given = rows(distance={"refined": 0.995}, normal={"refined": 0.5, "linear": 0.4}, character="dragon")
    evidence = Evidence([*given, *rows(character="dragon@3")])
    table = claims_table(judge_all(evidence, PAPER), evidence)
    line = {cells[0].partition(" ")[0]: dict(zip(table.headers[0], cells, strict=True)) for cells in table.body}
    assert table.headers[0][1:] == ("teen (Hiccup)", "woman (Valka)", "dragon (Toothless)", "toon (Ray)")
    assert line["C1"]["dragon (Toothless)"] == "holds ‡" and line["C1"]["teen (Hiccup)"] == "–"
    assert line["C4"]["dragon (Toothless)"] == "fails † ‡" and line["C2"]["dragon (Toothless)"] == "fails"
    text = as_text(table)
    assert "0.400° against 1.00° (coarse), 0.500° (refined), 1.00° (dense)" in text and "single seed" in text
    assert r"$\dagger$" in as_latex(table) and "| C12 " in as_markdown(table)
    several = Evidence(rows(distance={"refined": 0.99}, normal={"refined": 0.99}, sd=0.001))
    assert claims_table(judge_all(several, PAPER), several).body[0][1] == "holds", "its spread is known: no mark"
    assert "3 seeds" in as_text(claims_table(judge_all(several, PAPER), several))
    assert "Nothing is tested" in as_text(claims_table(judge_all(Evidence([]), PAPER), Evidence([])))


def test_reasons_stand_beside_the_papers_own_verdict():
    verdicts = judge_all(Evidence(rows()), PAPER)
    table = reasons_table(verdicts, "C4")
    assert [cells[2] for cells in table.body] == ["holds (Hiccup)", "holds (Valka)", "fails (Toothless)", "fails (Ray)"]
    assert {cells[2] for cells in reasons_table(verdicts, "C11").body} == {"–"}


def test_a_chart_has_a_panel_for_each_character_with_numbers_of_ours_or_the_papers():
    evidence = Evidence([*rows(normal={"refined": 0.5}, sd=0.01), *rows(character="ict")])
    figure, words = claim_chart(evidence, PAPER, "C2")
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == ["teen\nHiccup", "woman\nValka", "dragon\nToothless", "toon\nRay", "ict\n–"]
    assert "teen, normal error: refined < dense: 0.50" in words.alt and "C2" in words.caption
    assert claim_chart(evidence, PAPER, "C12") is None


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """A profile's folder of results and the committed one; the notebook's execution is noted, not done."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    monkeypatch.setattr(paths, "REFERENCE", tmp_path / "reference")
    executed = []
    monkeypatch.setattr(
        "replicate.targets.claims.claims_publication.run_notebook", lambda *names: executed.append(names)
    )
    for folder in (tmp_path / "runs" / "quick", tmp_path / "reference"):
        folder.mkdir(parents=True)
    return tmp_path / "runs" / "quick", tmp_path / "reference", executed


def test_make_claims_judges_a_run_and_the_committed_results_where_it_has_none(folders, capsys):
    run, reference, executed = folders
    write_results(run / "table2.csv", rows(normal={"refined": 0.5}))
    write_results(reference / "table2.csv", [*rows(), *rows(character="woman")])
    write_results(reference / "table1.csv", table1_rows())
    assert cli.main(["claims", "--profile", "quick"]) == 0
    text = capsys.readouterr().out
    by_key = {(one.claim, one.character): one for one in read_verdicts(run / "claims.csv")}
    assert by_key["C3", "teen"].results == "quick" and by_key["C3", "teen"].verdict == "holds"
    assert by_key["C3", "woman"].results == "reference" and by_key["C3", "woman"].verdict == "fails"
    assert by_key["C6", "teen"].results == "reference" and executed == [("claims", "quick")]
    assert "C3 teen: holds." in text and "numbers from quick: teen; reference: " in text
    assert cli.main(["claims", "--profile", "quick", "--latex"]) == 0
    assert r"\begin{tabular}" in capsys.readouterr().out


def test_benchmarks_of_ones_own_come_before_committed_ones(folders):
    run, reference, _ = folders
    row = Row("bench_training", "teen", "coarse", "m", "mm", 1.0, None, 1, 64, "laptop", "mine")
    (run.parent / "bench").mkdir()
    write_results(run.parent / "bench" / "bench_training.csv", [row])
    write_results(reference / "bench_training.csv", [replace(row, run="theirs"), replace(row, character="woman")])
    evidence = gather([run, run.parent / "bench", reference])
    assert evidence.rows[row.key].run == "mine" and len(evidence.rows) == 2
    assert evidence.places["bench_training", "woman"] == "reference"


def test_a_damaged_table_is_named(folders, capsys):
    run, *_ = folders
    (run / "table2.csv").write_text("nonsense\n")
    assert cli.main(["claims", "--profile", "quick"]) == 2
    assert "table2.csv, line 1" in capsys.readouterr().err and not (run / "claims.csv").exists()


def test_the_committed_verdicts_are_those_of_the_committed_rows():
    assert read_verdicts(notebooks.REFERENCE / "claims.csv") == judge_all(gather([notebooks.REFERENCE]), PAPER)


def test_every_character_that_is_judged_on_sample_rows_gets_every_claim():
    verdicts = judge_all(Evidence(table2_rows(("teen", "mine"))), PAPER)
    assert len({(one.claim, one.character) for one in verdicts}) == len(verdicts) == 5 * len(CLAIMS)
