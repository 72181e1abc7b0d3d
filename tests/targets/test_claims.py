"""Claims as they are shown: table, reasons and chart; and `make claims`, on results of one's own and committed ones."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import pytest
from sample_rows import mean_rows, table1_rows

from replicate import __main__ as cli
from replicate.base import paths
from replicate.report import notebooks
from replicate.report.results import Row, over_seeds, write_results, write_seeds
from replicate.report.tables import as_latex, as_markdown, as_text
from replicate.targets.claims import (
    claim_chart,
    claims_at_a_glance,
    claims_in_brief,
    claims_table,
    frequency_chart,
    of_recipe,
    outcome,
    overview,
    places_table,
    reasons_table,
    show_verdict,
    stand_ins,
    verdicts_of_table2,
    write_claims,
)
from replicate.targets.claims.rules import Evidence, gather, published
from replicate.targets.claims.verdicts import CLAIMS, FILE, claim_named, judge, judge_all, read_verdicts

PAPER = published()
SD = 1e-6  # over three seeds: the interval is as good as nothing


def test_the_papers_numbers_are_read_once_in_a_process():
    assert published() is PAPER


def test_claims_about_table_2_are_judged_on_a_runs_own_rows_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    folder = paths.run_folder("quick")
    folder.mkdir()
    write_results(folder / "table2.csv", mean_rows(normal={"refined": 0.4}, sd=SD))
    table = verdicts_of_table2("quick")
    assert (
        table.headers[0] == ("", "teen (Hiccup)")
        and [line[0][:2] for line in table.body] == [claim.name for claim in CLAIMS][:5]
    )
    assert table.body[1][1] == "holds"


def test_the_table_marks_what_qualifies_a_verdict():
    given = mean_rows(distance={"refined": 0.995}, normal={"refined": 0.5, "linear": 0.4}, character="dragon", sd=SD)
    evidence = Evidence([*given, *mean_rows(character="dragon@3"), *mean_rows(character="woman")])
    table = claims_table(judge_all(evidence, PAPER), evidence)
    line = {cells[0].partition(" ")[0]: dict(zip(table.headers[0], cells, strict=True)) for cells in table.body}
    assert table.headers[0][1:] == ("teen (Hiccup)", "woman (Valka)", "dragon (Toothless)", "toon (Ray)")
    assert line["C1"]["dragon (Toothless)"] == "direction only" and line["C1"]["teen (Hiccup)"] == "–"
    assert line["C4"]["dragon (Toothless)"] == "fails †" and line["C2"]["dragon (Toothless)"] == "fails"
    assert line["C3"]["woman (Valka)"] == "undecided ‡"
    text = as_text(table)
    assert "0.400° against 1.00° (coarse), 0.500° (refined), 1.00° (dense)" in text and "One run or two" in text
    assert r"$\dagger$" in as_latex(table) and "| C12 " in as_markdown(table) and "1 to 3 seeds" in text
    several = Evidence(mean_rows(distance={"refined": 0.99}, normal={"refined": 0.99}, sd=0.001))
    table = claims_table(judge_all(several, PAPER), several)
    assert table.body[0][1] == "direction only" and "3 seeds" in as_text(table), "its spread is known: no ‡"
    assert "Nothing is tested" in as_text(claims_table(judge_all(Evidence([]), PAPER), Evidence([])))


def test_what_is_measured_is_a_number_in_the_table():
    facts = ("mm", 0.15, None, 1, 9, "quick", "r")
    rows = Evidence([Row("table2_segments", "teen", "attachment", "vertex_error_mean[rigid]", *facts)])
    table = claims_table(judge_all(rows, PAPER), rows)
    assert next(line for line in table.body if line[0].startswith("C11 "))[1] == "0.50 ‡"
    assert any("without a verdict" in note for note in table.notes)


def test_a_claim_in_brief_has_symbols_and_the_size_of_the_effect_here_and_in_the_paper(tmp_path):
    rows = mean_rows(normal={"refined": 0.4}, sd=SD)
    rows += mean_rows(normal={"refined": 0.8}, character="toon", sd=SD) + mean_rows(character="woman")
    write_claims(tmp_path, Evidence(rows))
    table = claims_in_brief(tmp_path / "claims.csv")
    assert table.headers[0] == ("", "teen", "woman", "dragon", "toon", "effect here", "in the paper")
    lines = {line[0].partition(" ")[0]: line[1:] for line in table.body}
    assert len(lines) == len(CLAIMS) and lines["C2"] == ("✅", "?‡", "–", "◔", "0.40–1.00", "0.39–0.65")
    assert lines["C1"][:4] == ("?", "?‡", "–", "?") and lines["C1"][-1] == "0.40–0.86"
    alike = [
        verdict.paper for verdict in read_verdicts(tmp_path / "claims.csv") if verdict.claim == "C2" and verdict.paper
    ]
    assert f"{min(alike):.2f}–{max(alike):.2f}" == "0.39–0.65", "the same two numbers as here"


def test_networks_as_printed_have_columns_of_their_own_once_they_are_trained(tmp_path):
    rows = mean_rows(normal={"refined": 1.1}, sd=SD)
    printed = [
        replace(row, method=f"{row.method}_printed_ranges", value=0.3 if row.method == "refined" else 2.0)
        for row in rows
        if row.method in ("coarse", "refined", "dense")
    ]
    write_claims(tmp_path, Evidence(rows))
    assert "printed" not in as_text(claims_in_brief(tmp_path / "claims.csv")), "nothing is said of what is not there"
    verdicts = write_claims(tmp_path, Evidence([*rows, *printed]))
    for table in (claims_in_brief(tmp_path / "claims.csv"), claims_at_a_glance(verdicts)):
        assert [name for name in table.headers[0] if "printed" in name] == ["as printed ②"]
        assert any("② controls in degrees and lengths like Ray's" in note for note in table.notes)
    line = {each[0].partition(" ")[0]: each for each in claims_at_a_glance(verdicts).body}["C2"]
    assert line[1:3] == ("✘ fails on teen", "✔ holds")
    reasons = [cells[0] for cells in reasons_table(verdicts, "C2").body]
    assert reasons[:2] == ["teen", "teen, as printed, controls in degrees and lengths like Ray's"]


def test_a_glance_says_on_which_characters_in_the_fewest_words():
    whole = judge_all(Evidence(mean_rows()), PAPER)[0]

    def words(**verdicts):
        return outcome([replace(whole, character=who, verdict=verdict, seeds=3) for who, verdict in verdicts.items()])

    none = "not tested"
    assert words(teen=none) == "– not tested"
    assert words(teen="holds", toon="holds") == "✔ holds" and words(teen="direction only") == "◔ direction only"
    far = dict.fromkeys(("teen", "woman", "dragon", "toon"), "fails")
    assert words(**far) == "✘ fails" and words(**far, ict=none) == "✘ fails on teen, woman, dragon, toon"
    assert words(**far, ict="holds") == "◐ holds on ict; fails on teen, woman, dragon, toon"
    assert words(teen="undecided", toon="direction only") == "◐ direction only on toon; undecided on teen"
    assert outcome([replace(whole, verdict="undecided", seeds=1)]) == "? undecided ‡"
    assert outcome([replace(whole, verdict="one run", effect=2.02, seeds=1)]) == "1× one run: 2.02 ‡"
    assert words(teen="measured", toon="measured") == "measured"


def test_at_a_glance_the_papers_stand_ins_count_or_else_the_characters_that_there_are():
    rows = mean_rows(normal={"refined": 0.4}, sd=SD)
    others = mean_rows(normal={"refined": 1.1}, character="mine", sd=SD) + mean_rows(character="teen@3")
    for given, expected in ((rows + others, "✔ holds on teen"), (others, "✘ fails")):
        lines = {line[0][:3].strip(): line for line in claims_at_a_glance(judge_all(Evidence(given), PAPER)).body}
        assert lines["C2"][1] == expected and len(lines) == len(CLAIMS)
    assert lines["C2"][3] == "0.41–0.79", "the paper's effect is there whatever ours is"


def test_a_verdict_on_a_page_is_a_line_with_its_reasons_folded(monkeypatch):
    texts, folded = [], []
    monkeypatch.setattr(notebooks, "show_text", texts.append)
    monkeypatch.setattr(notebooks, "show_folded", lambda summary, lines: folded.extend([summary, *lines]))
    show_verdict(mean_rows(normal={"refined": 0.5}, sd=0.01), "C3")
    (line,) = texts
    assert line.startswith("**C3, Refined beats every LBS") and "**✔ holds**" in line
    assert "Normal error: refined beside LBS 16: teen 50 % ± 2 less (Hiccup: 55 % less)" in line
    assert "C3" in folded[0] and folded[1].startswith("The rule: The refined") and folded[2].startswith("teen: holds. ")
    assert folded[-1] == "the paper's numbers: holds (Hiccup)"


def test_verdicts_by_back_end_are_a_table_below_the_claim(monkeypatch):
    facts = None, 1, 1_000, "laptop", "b"
    times = {"dense_fast": 3.0, "coarse_fast": 2.0, "refined_fast": 2.0}
    times |= {"dense_jax": 1.0, "coarse_jax": 2.0, "refined_jax": 4.0}
    rows = [Row("table3", "teen", name, "time_all_cores", "ms", ms, *facts) for name, ms in times.items()]
    changes = {"dense": 1.001, "coarse": 1.0, "refined": 1.0}
    rows += [
        Row("table3", "teen", name, "change_time_all_cores[rig]", "ratio", value, *facts)
        for name, value in changes.items()
    ]
    verdicts = judge_all(Evidence(rows), PAPER)
    table = places_table(verdicts, "C8")
    assert table.headers[0] == ("", "teen") and [line[0] for line in table.body] == ["compiled code", "JAX"]
    assert table.body[0][1].startswith("fails ‡, 50 % ± ") and table.body[1][1].startswith("holds ‡, 50 % ± ")
    assert places_table(verdicts, "C1") is None
    brief = {line[0].partition(" ")[0]: line for line in claims_at_a_glance(verdicts).body}
    assert brief["C8"][1:3] == ("? undecided on teen ‡", "0.50–1.50"), "the effects of all back ends"


def test_a_column_says_its_profile_where_others_were_trained_otherwise():
    short = mean_rows(normal={"refined": 0.5}, character="mine")
    alone, beside = Evidence(short), Evidence([*short, *(replace(row, profile="laptop") for row in mean_rows())])
    headers = [claims_table(judge_all(evidence, PAPER), evidence).headers[0] for evidence in (alone, beside)]
    assert [header[-1] for header in headers] == ["mine", "mine (quick)"]
    assert headers[1][1] == "teen (Hiccup)"


def test_no_column_mixes_profiles_and_each_says_its_own():
    quick = mean_rows(normal={"refined": 0.4}, sd=SD)
    worse = mean_rows(normal={"refined": 1.1}, character="woman", sd=SD)
    usual = [replace(row, profile="laptop") for row in (*table1_rows(), *worse)]
    verdicts = judge_all(Evidence([*quick, *usual]), PAPER)
    table = claims_table(verdicts, Evidence([]))
    assert table.headers[0] == ("", "teen (quick)", "teen (laptop)", "woman (laptop)", "dragon", "toon")
    line = {cells[0].partition(" ")[0]: tuple(cell.split()[0] for cell in cells[1:4]) for cells in table.body}
    assert line["C3"] == ("holds", "–", "fails") and line["C6"] == ("–", "holds", "–")
    assert [cells[0] for cells in reasons_table(verdicts, "C3").body][:3] == [
        "teen (quick)",
        "woman (laptop)",
        "dragon",
    ]
    assert reasons_table(verdicts, "C6").body[0][0] == "teen", "one profile alone"


def test_a_verdict_on_numbers_of_two_profiles_has_a_column_that_says_so():
    rows = [replace(row, profile="laptop" if row.method == "dense" else "quick") for row in mean_rows()]
    header = claims_table(judge_all(Evidence(rows), PAPER), Evidence([])).headers[0]
    assert header[1:4] == ("teen (quick)", "teen (laptop, quick)", "woman")


def test_reasons_stand_beside_the_papers_own_verdict():
    verdicts = judge_all(Evidence(mean_rows()), PAPER)
    table = reasons_table(verdicts, "C4")
    assert [cells[2] for cells in table.body] == ["holds (Hiccup)", "holds (Valka)", "fails (Toothless)", "fails (Ray)"]
    assert {cells[2] for cells in reasons_table(verdicts, "C11").body} == {"–"}


def test_a_chart_has_a_panel_for_each_character_with_numbers_of_ours_or_the_papers():
    given = [*mean_rows(normal={"refined": 0.5}, sd=0.01), *mean_rows(character="ict")]
    evidence = Evidence([*given, *mean_rows(character="teen@3")])
    figure, words = claim_chart(evidence, PAPER, "C2")
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles == [
        "teen, ours\nHiccup, paper",
        "woman: not tested\nValka, paper",
        "toon: not tested\nRay, paper",
        "ict\npaper: no number",
        "dragon: not tested\nToothless, paper",
    ]
    assert "teen, normal error: refined < dense: 0.50" in words.alt and "C2" in words.caption
    assert claim_chart(evidence, PAPER, "C12") is None


def test_a_chart_has_no_line_without_a_mark_in_every_panel():
    for claim in ("C1", "C2", "C3", "C6"):
        figure, _ = claim_chart(Evidence(mean_rows()), PAPER, claim)
        for axes in figure.axes:
            low, high = sorted(axes.get_ylim())
            drawn = {line.get_ydata()[0] for line in axes.lines if line.get_marker() == "o"}
            assert drawn == set(range(round(high - low))), (claim, axes.get_title(loc="left"))


def test_ticks_have_room_however_far_apart_ratios_are():
    def ticks(distance):
        figure, _ = claim_chart(Evidence(mean_rows(distance={"refined": distance})), PAPER, "C1")
        return figure.axes[0].get_xticks().tolist()

    assert 0.5 in ticks(0.5) and 1.0 in ticks(0.5)
    far = ticks(1e5)
    assert 2 <= len(far) <= 4 and all(round(math.log10(tick)) % 2 == 0 for tick in far)


def test_a_ratio_that_is_next_to_nothing_is_an_arrow_and_leaves_the_others_their_room():
    figure, words = claim_chart(Evidence(mean_rows(distance={"refined": 1e-7})), PAPER, "C1")
    axes = figure.axes[0]
    (arrow,) = [line for line in axes.lines if line.get_marker() == "<"]
    low, high = axes.get_xlim()
    assert low < arrow.get_xdata()[0] < 0.3 and low > 0.05 and high < 5
    assert [text.get_text() for text in axes.texts] == ["< 0.02"] and "an arrow is one below 0.02" in words.caption
    assert "arrow" not in claim_chart(Evidence(mean_rows()), PAPER, "C1")[1].caption


def test_the_legend_of_a_chart_says_what_is_in_it_and_no_more():
    def legend(rows, claim):
        figure, _ = claim_chart(Evidence(rows), PAPER, claim)
        return [text.get_text() for text in figure.legends[0].get_texts()]

    assert legend(mean_rows(), "C9") == ["the paper’s characters"]
    assert legend(mean_rows(), "C1") == ["our characters", "the paper’s characters"]


def test_errors_by_frequency_are_lines_with_marks_of_their_own():
    facts = "mm", 0.1, None, 1, 9, "quick", "r"
    rows = [
        Row("table2", character, method, f"frequency_band_{k}", *facts)
        for character in ("teen", "toon")
        for method in ("coarse", "refined", "dense")
        for k in range(10)
    ]
    figure, words = frequency_chart(Evidence(rows))
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["teen", "toon"]
    assert {line.get_marker() for line in figure.axes[0].lines} == {"o", "s", "^"}
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == ["1", "256", "rest"]
    assert "toon, dense 0.10 mm in the rest" in words.alt and frequency_chart(Evidence(mean_rows())) is None


def test_counts_are_named_in_the_plural_once():
    facts = None, 1, None, "laptop", "b"
    numbers = {("table1", "coarse", "segments"): 10.0, ("table1", "refined", "segments"): 8.0}
    numbers |= {("table3", "coarse", "multiplications"): 50.0, ("table3", "refined", "multiplications"): 210.0}
    rows = [
        Row(table, "teen", name, metric, "count", value, *facts) for (table, name, metric), value in numbers.items()
    ]
    assert claim_chart(Evidence(rows), PAPER, "C15")[0].get_supxlabel().startswith("ratio of multiplications;")


def test_what_all_lines_of_a_chart_compare_is_said_once():
    evidence = Evidence(mean_rows(normal={"refined": 0.5}))
    one, two = (claim_chart(evidence, PAPER, claim)[0] for claim in ("C3", "C1"))
    assert one.get_supxlabel().startswith("ratio of normal errors;")
    assert one.axes[0].get_yticklabels()[0].get_text() == "refined < LBS 16"
    assert two.get_supxlabel().startswith("ratio of the two numbers;")
    assert two.axes[0].get_yticklabels()[0].get_text() == "distance: refined < coarse"


def test_titles_of_a_charts_panels_leave_each_other_their_room():
    """C13 compares what takes the most words, and the paper has no number for it."""
    rows = [
        Row("figure13", character, method, f"{kind}_error_mean[{mesh}]", unit, 1.0, None, 1, 10, "quick", "r")
        for character in ("teen", "woman", "dragon", "toon")
        for method in ("coarse", "coarse_carried", "deformation_transfer", "deformation_transfer_coarse")
        for kind, unit in (("vertex", "mm"), ("normal", "deg"))
        for mesh in ("half", "quarter")
    ]
    figure, _ = claim_chart(Evidence(rows), PAPER, "C13")
    figure.draw_without_rendering()
    assert [axes.get_title(loc="left") for axes in figure.axes][::3] == ["teen, ours", "toon, ours"]
    boxes = [axes._left_title.get_window_extent() for axes in figure.axes]
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes)) and boxes[-1].x1 <= figure.bbox.width


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """A profile's folder of results and the committed one; the notebook's execution is noted, not done."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    monkeypatch.setattr(paths, "REFERENCE", tmp_path / "reference")
    executed = []
    monkeypatch.setattr("replicate.targets.claims.run_notebook", lambda *names: executed.append(names))
    for folder in (tmp_path / "runs" / "quick", tmp_path / "reference"):
        folder.mkdir(parents=True)
    return tmp_path / "runs" / "quick", tmp_path / "reference", executed


def test_make_claims_judges_a_run_and_the_committed_results_where_it_has_none(folders, capsys):
    run, reference, executed = folders
    write_results(run / "table2.csv", mean_rows(normal={"refined": 0.4}, sd=SD))
    worse = mean_rows(normal={"refined": 1.1}, character="woman", sd=SD)
    write_results(reference / "table2.csv", [*mean_rows(), *worse])
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


def test_a_terminal_of_120_columns_shows_the_committed_verdicts_word_for_word(capsys, monkeypatch, folders):
    monkeypatch.setattr(paths, "REFERENCE", notebooks.REFERENCE)  # the real ones
    assert cli.main(["claims", "--profile", "laptop"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines[:-1])) <= 120, "the last line names a folder"
    assert not any(line.endswith("±") or line.lstrip().startswith("±") for line in lines)
    text, table = " ".join(" ".join(lines).split()), overview(notebooks.REFERENCE / "claims.csv")
    assert all(note in text for note in table.notes)
    assert all(
        verdict.reason in text for verdict in read_verdicts(notebooks.REFERENCE / "claims.csv") if verdict.results
    )
    first = next(k for k, line in enumerate(lines) if line.startswith("C10 "))
    last = next(k for k, line in enumerate(lines) if line.startswith("C11 "))
    claim = " ".join([lines[first].partition("  ")[0], *map(str.strip, lines[first + 1 : last])])
    assert claim == f"C10 {claim_named('C10').text}" and lines[first].split()[-5:] == ["one", "run", "‡", "–", "–"]
    heading = next(k for k, line in enumerate(lines) if line.split()[:2] == ["teen", "woman"])
    assert lines[heading + 1].split()[:2] == ["(Hiccup)", "(Valka)"]
    assert lines[heading].index("dragon") == lines[heading + 1].index("(Toothless)")


def test_benchmarks_of_ones_own_come_before_committed_ones(folders):
    run, reference, _ = folders
    row = Row("bench_training", "teen", "coarse", "m", "mm", 1.0, None, 1, 64, "laptop", "mine")
    (run.parent / "bench").mkdir()
    write_results(run.parent / "bench" / "bench_training.csv", [row])
    write_results(reference / "bench_training.csv", [replace(row, run="theirs"), replace(row, character="woman")])
    evidence = gather([run, run.parent / "bench", reference])
    assert evidence.rows[row.key].run == "mine" and len(evidence.rows) == 2
    assert evidence.places["bench_training", "woman"] == "reference"
    assert list(evidence.places) == [("bench_training", "teen"), ("bench_training", "woman")]


def test_methods_are_compared_seed_by_seed_where_the_folder_has_the_single_seeds(folders):
    run, *_ = folders
    single = {
        seed: mean_rows({"coarse": level, "refined": 0.99 * level}, {"coarse": level, "refined": 0.9 * level})
        for seed, level in enumerate((0.8, 1.0, 1.2))
    }
    write_results(run / "table2.csv", over_seeds(list(single.values())))
    assert judge(claim_named("C1"), "teen", gather([run]), PAPER).verdict == "undecided", "either's spread hides it"
    write_seeds(run / "table2_seeds.csv", single)
    one = judge(claim_named("C1"), "teen", gather([run]), PAPER)
    assert one.verdict == "direction only" and one.effect == pytest.approx(0.99)
    assert "Refinement takes 1.0 % off the distance error and takes 10 % off the normal error." in one.reason
    write_seeds(run / "table2_seeds.csv", {seed: single[seed] for seed in (0, 1)})
    assert judge(claim_named("C1"), "teen", gather([run]), PAPER).verdict == "undecided", "those are of another run"


def test_a_damaged_table_is_named(folders, capsys):
    run, *_ = folders
    (run / "table2.csv").write_text("nonsense\n")
    assert cli.main(["claims", "--profile", "quick"]) == 2
    assert "table2.csv, line 1" in capsys.readouterr().err and not (run / "claims.csv").exists()


def test_the_committed_verdicts_are_those_of_the_committed_rows():
    assert read_verdicts(notebooks.REFERENCE / "claims.csv") == judge_all(gather([notebooks.REFERENCE]), PAPER)


def test_readme_counts_the_verdicts_on_our_four_characters():
    verdicts = read_verdicts(paths.REFERENCE / FILE)
    found = {claim.name: [each.verdict for each in stand_ins(of_recipe(verdicts), claim.name)] for claim in CLAIMS}

    def named(is_so: Callable[[list[str]], bool]) -> list[str]:
        return [name for name, each in found.items() if is_so([one for one in each if one != "not tested"])]

    said = " ".join((paths.ROOT / "README.md").read_text("utf-8").split())
    holds, fails = named(lambda each: each.count("holds") == 3), named(lambda each: each.count("fails") == 3)
    alone = named(lambda each: each == ["direction only"] * 4)
    one = named(lambda each: 0 < len(each) < 3 and set(each) == {"fails"})
    single = named(lambda each: bool(each) and set(each) == {"one run"})
    undecided = named(lambda each: bool(each) and set(each) == {"undecided"})
    measured = named(lambda each: bool(each) and set(each) == {"measured"})
    assert len([*holds, *fails, *alone, *one, *single, *undecided, *measured]) == len(CLAIMS)
    numbers = ("no", "one", "two", "three", "four", "five", "six", "seven")
    count = {len(group): numbers[len(group)] for group in (holds, fails, single, undecided, measured)}
    for sentence in (
        f"Of fifteen claims {count[len(holds)]} hold on three of our four characters ({', '.join(holds)}), ",
        f"one has its direction alone ({', '.join(alone)}), ",
        f"{count[len(fails)]} fail on three ({', '.join(fails)}), one fails where it was tested ({', '.join(one)}), ",
        f"{count[len(undecided)]} is undecided ({', '.join(undecided)}), {count[len(single)]} rest on one run "
        f"({', '.join(single)}) and {count[len(measured)]} are measured, without a verdict.",
    ):
        assert sentence.strip() in said
