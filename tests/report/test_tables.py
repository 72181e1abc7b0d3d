"""Printed tables: the numbers shown are the numbers held, columns line up, and every oracle says that it is one."""

import re
from dataclasses import replace

import pytest
from sample_rows import METHODS, PAPER_ROWS, cells_after, table2_rows

from replicate.base.exceptions import InputError
from replicate.base.paths import PAPER
from replicate.methods.method_registry import in_order, method_named, methods
from replicate.report.notebooks import show_tables
from replicate.report.results import Row, order_of, read_results, write_results
from replicate.report.tables import Table, as_html, as_latex, as_markdown, as_text, paper_value, round_off, unbroken
from replicate.targets.compare import compare, compare_folders
from replicate.targets.reference import beside_today
from replicate.targets.table2.rows import (
    method_notes,
    other_rigs,
    table2,
    table2_overview,
    table2_questions,
    table2_ratios,
    table2_segments,
)

RELEASED = ("dense_released",)
MEANS = ("vertex_error_mean [mm]", "normal_error_mean [deg]")


def test_a_line_shows_ours_and_then_the_papers():
    text = as_text(table2(table2_rows(), PAPER_ROWS, "teen"))
    assert cells_after(text, "Refined") == ["0.22", "0.88", "4.40", "0.27", "2.40", "9.60", "48.00", "0.9"]
    assert cells_after(text, "LBS: 16 bones †")[3] == "0.49" and cells_after(text, "LBS: 16 bones †")[7] == "2.0"


def test_rows_that_the_paper_lacks_have_no_number_of_the_papers():
    text = as_text(table2(table2_rows(), PAPER_ROWS, "teen"))
    assert cells_after(text, "Neutral pose §")[3] == "–"


def test_every_oracle_is_marked_and_explained_wherever_it_is_printed():
    for table in (table2(table2_rows(), PAPER_ROWS, "teen"), table2_overview(table2_rows(), PAPER_ROWS)):
        for text in (as_text(table), as_markdown(table)):
            assert "LBS: 32 bones †" in text and "† An oracle" in text
            assert "Floor, refined maps ‡" in text and "‡ An oracle" in text
        assert r"LBS: 32 bones $\dagger$" in as_latex(table) and r"$\dagger$ An oracle" in as_latex(table)


def test_columns_line_up():
    lines = as_text(table2(table2_rows(), PAPER_ROWS, "teen")).splitlines()
    rules = [k for k, text in enumerate(lines) if text.startswith("─")]
    assert len({len(text) for text in lines[rules[0] + 1 : rules[1]]}) <= 2  # the texel column is empty at the end
    for column in ("mean", "max"):  # narrower and wider than its numbers
        end = lines[rules[0] - 1].index(column) + len(column)
        assert all(text[end - 1].isdigit() and text[end] == " " for text in lines[rules[0] + 1 : rules[1]])


def test_a_method_measured_on_fewer_poses_says_so():
    assert "Floor, coarse maps ‡: on 100 of teen's poses only." in as_text(table2(table2_rows(), PAPER_ROWS, "teen"))


def test_faces_left_out_of_eq_11_are_mentioned_only_if_there_are_any():
    none = [Row("table2", "teen", "dense", "normal_faces_left_out", "count", 0.0, None, 1, 1234, "quick", "r")]
    some = [Row("table2", "teen", "dense", "normal_faces_left_out", "count", 7.0, None, 1, 1234, "quick", "r")]
    assert "Eq. 11 leaves out" not in as_text(table2(table2_rows() + none, PAPER_ROWS, "teen"))
    assert "Eq. 11 leaves out faces" in as_text(table2(table2_rows() + some, PAPER_ROWS, "teen"))


def test_a_character_that_stands_for_nobody_still_gets_its_table():
    text = as_text(table2(table2_rows(("mine",)), PAPER_ROWS, "mine"))
    assert cells_after(text, "Coarse")[:3] == ["0.11", "0.44", "2.20"]


def test_missing_methods_leave_no_row():
    text = as_text(table2(table2_rows(methods=("coarse", "dense")), PAPER_ROWS, "teen"))
    assert "Refined" not in text and "oracle" not in text


def test_markdown_rows_have_as_many_cells_as_the_header():
    rows = [
        text for text in as_markdown(table2(table2_rows(), PAPER_ROWS, "teen")).splitlines() if text.startswith("|")
    ]
    assert len({text.count("|") for text in rows}) == 1 and len(rows) == 2 + len(METHODS)


def test_latex_rows_have_as_many_columns_as_the_tabular():
    text = as_latex(table2_overview(table2_rows(("teen", "toon")), PAPER_ROWS))
    assert r"\begin{tabular}{lrrrr}" in text
    assert r"Coarse & 0.11 & 0.36 & 0.11 & 1.00 \\" in text


def test_columns_of_text_are_flush_left_in_every_kind_of_table():
    headers = (("", "", "times", ""), ("rig", "way", "s", "MB"))
    table = Table("t", headers, (("teen", "fast", "1", "2"), ("a", "b", "30", "40")), text_columns=2)
    _, _, spans, *lines = as_text(table).splitlines()
    assert lines == ["rig   way    s  MB", "──────────────────", "teen  fast   1   2", "a     b     30  40"]
    assert spans.strip() == "times" and r"\begin{tabular}{llrr}" in as_latex(table)
    (line,) = as_text(replace(table, headers=(("", "by", "MB", "s"), headers[1]))).splitlines()[2:3]
    assert line.split("by")[0] == " " * len("teen  ")
    assert as_markdown(table).count(":--") == as_html(table).count("<td style=") / 2 == 2


def test_a_methods_mark_is_one_of_its_own_in_latex():
    marks = tuple(sorted({method.mark for method in methods().values() if method.mark}))
    assert {"★", "☆", "‖"} < set(marks)
    (line,) = [row for row in as_latex(Table("t", (marks,), ())).splitlines() if row.endswith(r"\\")]
    shown = line.removesuffix(r" \\").split(" & ")
    assert len(set(shown)) == len(marks) and line.isascii()


@pytest.mark.parametrize(
    "value, unit, text", [(0.0234, "mm", "0.023"), (0.2349, "mm", "0.23"), (0.0999, "mm", "0.10"), (None, "mm", "–"),
                           (12510.0, "count", "12,510"), (1.25, "deg", "1.25"), (1170.4, "s", "1,170")]
)  # fmt: skip
def test_values_are_rounded_where_they_are_shown(value, unit, text):
    assert round_off(value, unit) == text


def test_a_doubtful_number_of_the_papers_carries_its_question_mark():
    rows = read_results(PAPER / "table3.csv")
    values = {paper_value(row) for row in rows if row.character == "Hiccup" and row.method == "coarse"}
    assert values == {"2.9", "6.4", "5.8?", "6.9?"}


def test_compare_puts_paper_reference_and_yours_side_by_side():
    reference = table2_rows(methods=("coarse",))
    yours = [
        Row(*r.key, r.unit, r.value * 2, None, 1, 10, "laptop", "s") for r in table2_rows(methods=("coarse", "neutral"))
    ]
    text = as_text(compare(PAPER_ROWS, reference, yours, "table2"))
    distances, normals = text.split("\nteen, ")[1:]
    assert distances.startswith("vertex_error_mean [mm]\n") and normals.startswith("normal_error_mean [deg]\n")
    assert cells_after(distances, "  Coarse") == ["0.36", "0.11", "0.22", "2.000"]
    assert cells_after(normals, "  Neutral pose §") == ["–", "–", "4.80", "–"]
    assert cells_after(text, "      ") == ["paper", "reference", "yours", "yours", "/"] and "p95" not in text
    assert re.search("^ +quick +laptop +reference$", text, re.MULTILINE), "the profiles of what is shown"


def test_compare_shows_what_a_run_has_and_counts_the_rest():
    reference = table2_rows(("teen", "woman"), ("coarse", "dense"))
    yours = table2_rows(("mine", "teen"), ("coarse", "neutral"))
    fine = replace(yours[0], metric="vertex_error_mean[brows]")
    table = compare(PAPER_ROWS, reference, [*yours, fine], "table2")
    labels = [line[0] for line in table.body if line]
    assert labels[::3] == [f"{who}, {metric}" for who in ("mine", "teen") for metric in MEANS]
    assert labels[1:3] == ["  Coarse", "  Neutral pose §"] and "  Dense" not in labels
    assert table.notes == (
        "Left out: 6 rows of the reference that yours lacks and 1 of yours by region or source; ALL=1 shows them.",
    )
    whole = compare(PAPER_ROWS, reference, [*yours, fine], "table2", everything=True)
    labels = [line[0] for line in whole.body if line]
    assert len(labels) == 12 + 2 + 10 and not whole.notes, "each line and its heading"
    assert labels.index("woman, vertex_error_mean [mm]") > labels.index("mine, vertex_error_mean[brows] [mm]")


def test_a_column_names_all_profiles_that_its_numbers_are_of():
    reference = [replace(row, profile="laptop") for row in table2_rows(("teen",))] + table2_rows(("toon",))
    tables = [compare(PAPER_ROWS, reference, table2_rows(names), "table2") for names in (("teen",), ("teen", "toon"))]
    assert [table.headers[-1][2:4] for table in tables] == [("laptop", "quick"), ("laptop, quick", "quick")]


def test_compare_has_the_characters_in_the_order_of_all_tables():
    rows = table2_rows(("dragon", "ict", "teen@3", "toon", "teen", "woman"), ("coarse",))
    labels = [line[0] for line in compare(PAPER_ROWS, rows, rows, "table2").body if line]
    characters = list(dict.fromkeys(label.partition(",")[0] for label in labels if label[0] != " "))
    assert characters == ["teen", "woman", "dragon", "toon", "ict", "teen@3"]


def test_compare_calls_a_dense_network_by_its_widths_in_table_1_alone():
    sizes = [Row("table1", "teen", name, "model_size", "MB", 9.0, None, 1, None, "quick", "r") for name in RELEASED]
    errors = table2_rows(methods=RELEASED)
    character, size = (line[0] for line in compare([], sizes, sizes, "table1").body)
    assert (character, size) == ("teen", "  Dense, 256 and 512, model_size [MB]")
    labels = {line[0] for line in compare([], errors, errors, "table2").body if line}
    assert f"  {method_named(RELEASED[0]).title}" in labels


def test_compare_leaves_out_what_compares_a_run_with_the_one_before_it():
    metrics = ("time_one_core", "change_time_one_core[rig]")
    rows = [Row("table3", "teen", "dense", metric, "ms", 2.0, None, 1, None, "laptop", "r") for metric in metrics]
    assert [line[0] for line in compare([], rows, rows, "table3").body] == ["teen, time_one_core [ms]", "  Dense"]


def test_compare_without_results_of_yours_names_the_target_that_makes_them(tmp_path):
    with pytest.raises(InputError, match="make table2"):
        compare_folders(PAPER, tmp_path, tmp_path / "none", ("table1", "table2"))


def test_compare_shows_yours_where_there_is_no_reference_yet(tmp_path):
    write_results(tmp_path / "table2.csv", table2_rows())
    (table,) = compare_folders(PAPER, tmp_path / "none", tmp_path, ("table1", "table2"))
    assert cells_after(as_text(table), "  Coarse") == ["0.36", "–", "0.11", "–"]


def test_compare_leaves_out_the_tables_that_yours_lacks_until_all_are_asked_for(tmp_path):
    for folder, names in (("reference", ("table1", "table2")), ("yours", ("table2",))):
        (tmp_path / folder).mkdir()
        for name in names:
            write_results(tmp_path / folder / f"{name}.csv", [replace(row, table=name) for row in table2_rows()])
    folders = PAPER, tmp_path / "reference", tmp_path / "yours", ("table1", "table2")
    assert [table.title[:6] for table in compare_folders(*folders)] == ["table2"]
    assert [table.title[:6] for table in compare_folders(*folders, everything=True)] == ["table1", "table2"]


def test_ratios_are_those_of_the_means_beside_the_papers_own():
    text = as_text(table2_ratios(table2_rows(), PAPER_ROWS, "teen"))
    assert cells_after(text, "Refined / Coarse, normal angle") == ["2.00", "0.56"]  # 0.9° / 1.6° in the paper
    assert cells_after(text, "Coarse / Floor, coarse maps ‡, normal angle") == ["0.12", "–"]


def test_questions_are_answered_by_ratios_of_all_characters_beside_the_papers():
    table = table2_questions(table2_rows(("toon", "teen", "mine")), PAPER_ROWS)
    assert table.headers[0][2:] == ("teen", "Hiccup", "toon", "Ray")
    assert table.body[0][1:] == ("Refined / Coarse, normal angle", "2.00", "0.56", "2.00", "0.39")
    assert not any("Linear" in line[1] for line in table.body), "there are no rows of it"


def test_poses_are_counted_character_by_character_where_they_differ():
    rows = [replace(row, poses=7) if row.character == "toon" else row for row in table2_rows(("teen", "toon"))]
    assert "\n1,234 (teen) and 7 (toon) unique test poses;" in as_text(table2_overview(rows, PAPER_ROWS))
    assert "\n1,234 unique test poses;" in as_text(table2_overview(table2_rows(), PAPER_ROWS))


def test_rows_of_fewer_seeds_are_named_and_set_no_count_of_poses():
    rows = [replace(row, seeds=3, poses=640, sd=0.1) for row in table2_rows() if row.method != "driven"]
    rows += [replace(row, poses=664) for row in table2_rows() if row.method == "driven"]
    some = [replace(row, seeds=2) if row.method == "driven" else row for row in rows]
    fewer = "Of fewer seeds than the others of teen: LBS moved by a network ◊."
    for seen, note in ((rows, "Means without ± are of one seed."), (some, fewer)):
        for table in (table2(seen, PAPER_ROWS, "teen"), table2_overview(seen, PAPER_ROWS)):
            text = as_text(table)
            assert "\n640 unique test poses or more a seed" in text and "poses only" not in text
            assert note in text and ("fewer seeds" in text) + ("without ±" in text) == 1
    text = as_text(table2(table2_rows(), PAPER_ROWS, "teen"))
    assert "fewer seeds" not in text and "without ±" not in text


def test_what_is_used_today_stands_beside_the_papers_networks_on_characters_that_have_it():
    rows = table2_rows(("teen", "toon"))
    assert "There are no results of such methods." in as_markdown(beside_today(rows))
    row = next(row for row in rows if row.character == "toon" and row.method == "coarse")
    work = replace(row, method="morph", metric="multiplications", value=2.5e6, sd=None)
    others = [replace(row, method=method, metric="vertex_error_mean") for method in ("morph", "linear")]
    table = beside_today([*rows, *others, work])
    assert table.headers[0][2:] == ("mm", "degrees", "MB", "million products a pose", "ms a pose")
    assert {line[0] for line in table.body} == {"toon"}
    lines = {line[1]: line[2:] for line in table.body}
    assert lines["Neural morphs"] == ("0.11", "–", "–", "2.50", "–") and "Coarse" in lines and "Linear" not in lines


def test_what_is_used_today_has_the_time_of_its_best_evaluation():
    rows = [replace(row, method="morph") for row in table2_rows() if row.method == "coarse"]
    times = [
        replace(rows[0], table="table3", method=f"morph{way}", metric="time_all_cores", unit="ms", value=ms, sd=None)
        for way, ms in (("", 3.0), ("_jax", 2.0))
    ]
    assert [line[-1] for line in beside_today(rows, times).body] == ["2.00"]


def test_methods_with_the_same_note_share_a_line():
    lines = method_notes(["coarse_half", "dense_half", "floor", "morph"])
    assert lines[0].startswith("‡ ") and lines[1].startswith("Coarse, 16 bits; Dense, 16 bits: Trained as")
    assert lines[2].startswith("Neural morphs: ") and len(lines) == 3


def test_rigs_of_others_have_a_table_of_their_own():
    rows = table2_rows(("teen", "teen@3", "ict", "rigify"))
    table = other_rigs(rows)
    assert table.headers[0] == ("", "ict, mm", "ict, degrees", "rigify, mm", "rigify, degrees")
    assert table.body[0] == ("Coarse", "0.11", "1.20", "0.11", "1.20")
    assert "There are no results of such a rig." in as_markdown(other_rigs(table2_rows()))
    counted = [replace(row, poses=7, profile="laptop") if row.character == "ict" else row for row in rows]
    text = as_text(table2_overview(counted, PAPER_ROWS))
    assert "rigify" not in text and "laptop" not in text, "they are no part of the table of the paper's characters"


def test_variants_stand_behind_the_characters_in_their_order():
    names = ["ict", "toon@3", "woman", "teen@one_face", "teen@3", "teen"]
    assert sorted(names, key=order_of) == ["teen", "woman", "ict", "teen@3", "teen@one_face", "toon@3"]


def test_a_ratio_to_a_method_that_was_not_run_is_not_shown():
    assert "Dense" not in as_text(table2_ratios(table2_rows(methods=("coarse", "refined")), PAPER_ROWS, "teen"))


def test_segments_have_a_line_each_and_a_column_for_each_method():
    rows = [
        Row("table2_segments", "teen", m, f"{k}_error_mean[{s}]", u, v, None, 1, 9, "quick", "r")
        for m, v in (("coarse", 0.5), ("dense", 0.25))
        for k, u in (("vertex", "mm"), ("normal", "deg"))
        for s in ("face", "rigid")
    ]
    text = as_text(table2_segments(rows, "teen"))
    assert cells_after(text, "face, mm") == ["0.50", "0.25"] and cells_after(text, "rigid, deg") == ["0.50", "0.25"]
    assert "seeds" not in text
    text = as_text(table2_segments([replace(row, seeds=2, sd=0.01) for row in rows], "teen"))
    assert cells_after(text, "face, mm") == ["0.50", "0.25"] and "Means over 2 seeds" in text and "table2.csv" in text


def test_other_numbers_of_bones_stand_among_those_of_lbs():
    names = ["neutral", "lbs32", "lbs4", "dense", "lbs16", "coarse"]
    assert in_order(names) == ["coarse", "dense", "lbs4", "lbs16", "lbs32", "neutral"]
    assert [method_named(name).title for name in ("lbs4", "lbs16", "odd")] == [
        "LBS: 4 bones †",
        "LBS: 16 bones †",
        "odd",
    ]


@pytest.mark.parametrize(
    ("value", "unit", "sd", "text"),
    [(2.04, "deg", 0.031, "2.04 ± 0.03"), (0.344, "mm", 0.0031, "0.34 ± 0.003"), (3.0, "count", 0.0, "3 ± 0"),
     (0.000004, "mm", 0.000001, "0.000 ± 0.000"), (0.14, "deg", 0.00002, "0.14 ± 0.00")],
)  # fmt: skip
def test_a_spread_is_shown_to_its_first_digit(value, unit, sd, text):
    assert round_off(value, unit, sd) == text


def test_no_line_of_an_unbroken_text_ends_within_a_number_or_before_a_mark():
    table = Table("t", (("", "Floor ‡"),), (("LBS: 16 bones †", "0.37 ± 0.01"), None), ("‡ An oracle",))
    text = unbroken(as_markdown(table))
    assert "|  | Floor\u00a0‡ |" in text and "| LBS: 16 bones\u00a0† | 0.37\u00a0±\u00a00.01 |" in text
    assert "\n‡ An oracle" in text and text.replace("\u00a0", " ") == as_markdown(table)


@pytest.mark.parametrize("mark", sorted({method.mark for method in methods().values() if method.mark}))
def test_no_line_of_an_unbroken_text_ends_before_the_mark_of_any_method(mark):
    assert unbroken(f"The method {mark}") == f"The method\u00a0{mark}"


def test_a_page_has_every_cell_once_under_headers_that_span_columns():
    headers = (("", "distance, mm", "", "texels"), ("", "mean", "max", "per vertex"))
    body = (
        ("Mean errors", "", "", ""),
        ("LBS: 16 bones †", "0.37 ± 0.01", "9", ""),
        None,
        ("a < b & c", "1", "2", "3"),
    )
    text = as_html(Table("Sizes", headers, body, ("`make table2` writes it", "x < y")))
    assert text.count("<tr") == text.count("</tr>") == 5 and text.count("<td") == 8
    assert '<th colspan="2" style="text-align: center">distance, mm</th><th>texels</th>' in text
    assert '<th colspan="4" style="text-align: left">Mean errors</th>' in text
    assert "LBS:\u00a016\u00a0bones\u00a0†</td><td>0.37\u00a0±\u00a00.01</td>" in text
    ruled = [row for row in text.splitlines() if "border-top" in row]
    assert len(ruled) == 1 and "a\u00a0&lt;\u00a0b\u00a0&amp;\u00a0c" in ruled[0]
    assert "<code>make table2</code> writes it<br>\nx &lt; y</p>" in text


def test_a_long_cell_may_take_several_lines():
    why = "Distance: refined 0.210 ± 0.0042 mm, in each seed by about as much"
    row = next(line for line in as_html(Table("t", (("", "why"),), (("teen", why),))).splitlines() if "refined" in line)
    assert "Distance: refined 0.210\u00a0±\u00a00.0042 mm, in" in row


def test_a_folded_table_shows_its_title_and_keeps_the_rest():
    table = Table("Sizes", (("", "MB"),), (("Dense", "38.3"),), ("A note",))
    open_one, folded = as_html(table), as_html(table, folded=True)
    assert folded.startswith("<details><summary><b>Sizes</b></summary>") and folded.endswith("</details>")
    assert "details" not in open_one and open_one.partition("<table")[2] in folded


def test_of_several_tables_the_first_is_open_and_notes_stand_once(monkeypatch):
    shown = []
    monkeypatch.setattr("IPython.display.display", lambda bundle, raw: shown.append(bundle))
    tables = [Table(name, (("", "x"),), ((name, "1"),), ("for all", f"of {name}")) for name in ("teen", "woman")]
    show_tables(iter([None, *tables]))
    teen, woman = (bundle["text/html"] for bundle in shown)
    assert "details" not in teen and "for all" in teen and "of teen" in teen
    assert woman.startswith("<details>") and "for all" not in woman and "of woman" in woman
    assert [bundle["text/markdown"].count("for all") for bundle in shown] == [1, 0]
    show_tables([None])
    assert len(shown) == 2
