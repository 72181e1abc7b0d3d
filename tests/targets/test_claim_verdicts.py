"""The claims' rules: each gives the paper's own verdict on the paper's own numbers, and turns where it says it does."""

from dataclasses import replace

import pytest
from sample_rows import mean_rows, table1_rows, table2_rows

from replicate.base.exceptions import InputError
from replicate.benchmarks.bench_training import BALANCED, RAW_ANIMATION, USUAL
from replicate.report.results import Row
from replicate.targets.claims.rules import Evidence, MissingNumber, published, significant
from replicate.targets.claims.verdicts import (
    CLAIMS,
    claim_named,
    judge,
    judge_all,
    published_verdict,
    read_verdicts,
    verdict_frame,
    write_verdicts,
)
from replicate.targets.table3 import beside

PAPER = published()
THEIRS = ("Hiccup", "Valka", "Toothless", "Ray")
ALL_HOLD = dict.fromkeys(THEIRS, "holds")
MEASURED = dict.fromkeys(THEIRS, "measured")
UNPRINTED = dict.fromkeys(THEIRS, "not tested")
# What the paper says, character by character, of its own tables.
PAPERS_OWN = {
    "C1": ALL_HOLD,
    "C2": ALL_HOLD,
    "C3": ALL_HOLD,
    "C4": ALL_HOLD | {"Toothless": "fails", "Ray": "fails"},  # "can": no LBS of these two is as close as refined
    "C5": UNPRINTED,
    "C6": ALL_HOLD,
    "C7": MEASURED | {"Ray": "not tested"},  # nobody's rig of Ray is in Table 3
    "C8": ALL_HOLD | {"Ray": "not tested"},
    "C9": MEASURED | {"Ray": "not tested"},
    "C10": ALL_HOLD,
    "C11": UNPRINTED,
    "C12": UNPRINTED,
    "C13": UNPRINTED,
    "C14": UNPRINTED | {"Ray": "measured"},
    "C15": UNPRINTED,
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


SD = 1e-6  # over three seeds: the interval is as good as nothing


def verdict(name: str, given: list[Row], character="teen") -> str:
    return judge(claim_named(name), character, Evidence(given), PAPER).verdict


def below(**values: float) -> dict:
    """Return the same values as both errors."""
    return {"distance": values, "normal": values}


@pytest.mark.parametrize(
    ("name", "given", "character", "expected"),
    [
        ("C1", below(refined=0.76), "teen", "direction only"),  # Hiccup: 0.75 in distance, 0.56 in normals
        ("C1", {"distance": {"refined": 0.85}, "normal": {"refined": 0.74}}, "teen", "holds"),
        ("C1", {"distance": {"refined": 0.88}, "normal": {"refined": 0.74}}, "teen", "direction only"),
        ("C1", below(refined=0.99), "teen", "direction only"),
        ("C1", below(refined=0.87), "ict", "holds"),  # the smallest of the paper's: 0.90 and 0.77, Toothless
        ("C1", below(refined=0.89), "ict", "direction only"),
        ("C1", below(refined=1.0), "teen", "undecided"),
        ("C1", {"distance": {"refined": 0.5}, "normal": {"refined": 1.1}}, "teen", "fails"),
        ("C1", {"distance": {"refined": 1.1}, "normal": {"refined": 0.5}}, "teen", "fails"),
        ("C2", {"normal": {"refined": 0.65}}, "teen", "holds"),  # dense: 0.47, the root 0.69
        ("C2", {"normal": {"refined": 0.7}}, "teen", "direction only"),
        ("C2", {"normal": {"refined": 0.99}}, "dragon", "fails"),
        ("C2", {"normal": {"dense": 0.6}}, "dragon", "holds"),
        ("C2", {"normal": {"dense": 0.6}}, "dragon@one_face", "holds"),
        ("C2", {"normal": {"dense": 0.99}}, "toon", "fails"),
        ("C2", {"normal": {"refined": 0.65, "lbs24": 0.64}}, "teen", "fails"),
        ("C3", {"normal": {"refined": 0.66}}, "dragon", "holds"),
        ("C3", {"normal": {"refined": 0.7, "lbs16": 0.6}}, "teen", "fails"),
        ("C3", {"normal": {"refined": 1.0}}, "teen", "undecided"),
        ("C3", {"normal": {"refined": 0.66, "coarse": 0.1, "dense": 0.1}}, "teen", "holds"),
        ("C4", {"distance": {"lbs16": 0.99}, "normal": {"refined": 0.99}}, "toon", "holds"),  # "can": the direction
        ("C4", {"normal": {"refined": 0.99}}, "teen", "undecided"),
        ("C4", {"distance": {"refined": 0.99}, "normal": {"refined": 0.99}}, "teen", "fails"),
        ("C4", {"distance": {"refined": 0.9, "lbs32": 0.8}, "normal": {"refined": 0.99}}, "teen", "holds"),
        ("C4", {"distance": {"refined": 0.9, "lbs32": 0.8}, "normal": {"lbs32": 0.9}}, "teen", "fails"),
    ],
)
def test_a_verdict_turns_where_its_rule_says(name, given, character, expected):
    assert verdict(name, mean_rows(**given, character=character, sd=SD), character) == expected


@pytest.mark.parametrize(
    ("error", "share", "expected"), [((0.2, 0.2), (0.5, 0.5), "holds"), ((0.2, 0.2), (0.7, 0.5), "fails"),
                                     ((0.2, 0.31), (0.5, 0.5), "fails"), ((0.2, 0.3), (0.5, 0.5), "undecided")]
)  # fmt: skip
def test_c5_wants_more_high_frequency_of_dense_networks_than_of_either_cnn_and_a_larger_share(error, share, expected):
    values = {"refined": (error[0], share[0]), "coarse": (error[1], share[1]), "dense": (0.3, 0.6)}
    metrics = (("high_frequency_error_mean", "mm"), ("high_frequency_share", "ratio"))
    given = [
        Row("table2", "teen", method, metric, unit, value, SD, 3, 9, "laptop", "r")
        for method, both in values.items()
        for (metric, unit), value in zip(metrics, both, strict=True)
    ]
    assert verdict("C5", given) == expected
    dragon = [replace(row, character="dragon") for row in given]
    assert verdict("C5", dragon, "dragon") == "not tested", "the paper doesn't say so of Toothless"


def test_networks_as_printed_are_judged_by_the_same_rules_beside_those_at_their_best():
    best = mean_rows(normal={"refined": 1.2}, sd=SD)
    printed = [
        replace(row, method=f"{row.method}_printed_code", value=0.3)
        for row in mean_rows(sd=SD)
        if row.method in ("refined", "coarse", "dense")
    ]
    printed = [replace(row, value=0.6) if row.method.startswith(("dense", "coarse")) else row for row in printed]
    verdicts = {(one.claim, one.recipe): one for one in judge_all(Evidence([*best, *printed]), PAPER) if one.seeds}
    assert verdicts["C2", "best"].verdict == "fails" and verdicts["C2", "printed_code"].verdict == "holds"
    assert {recipe for _, recipe in verdicts} == {"best", "printed_code"}, "nothing is said of what nobody trained"
    assert verdicts["C2", "printed_code"].comparison == "normal error: refined < coarse", "no suffix"
    assert verdicts["C3", "printed_code"].verdict == "holds", "LBS is no network: it has one set of rows"


@pytest.mark.parametrize(
    ("large", "expected", "words"),
    [
        (7.9, "fails", "0.988 times"),
        (15.9, "direction only", "1.99 times"),
        (16.0, "holds", "2.00 times"),
        (40.1, "holds", "even smaller, which is no failure"),
    ],
)
def test_c6_needs_twice_the_size_to_hold_and_does_not_mind_more_than_five_times(large, expected, words):
    one = judge(claim_named("C6"), "teen", Evidence(table1_rows(large=large)), PAPER)
    assert one.verdict == expected and words in one.reason
    assert ("no failure" in one.reason) == (large > 40)


@pytest.mark.parametrize(
    ("mm", "degrees", "expected"),
    [(0.5, 1.9, "undecided"), (0.4, 1.9, "direction only"), (0.3, 1.3, "holds"), (0.4, 2.1, "fails")],
)
def test_c10_compares_the_cnn_with_dense_in_posed_faces(mm, degrees, expected):
    def rows(fed_by, mm, degrees):
        values = {("refined", "mm"): mm, ("refined", "deg"): degrees, ("dense", "mm"): 0.5, ("dense", "deg"): 2.0}
        kinds = {"mm": "vertex", "deg": "normal"}
        return [
            Row("table4", "teen", method, f"{kinds[unit]}_error_mean{fed_by}", unit, value, SD, 3, 25, "laptop", "b")
            for (method, unit), value in values.items()
        ]

    assert verdict("C10", rows("", mm, degrees)) == expected
    assert verdict("C10", rows("[rig]", mm, degrees)) == "not tested"
    single = [replace(row, sd=None, seeds=1) for row in rows("", mm, degrees)]
    assert verdict("C10", single) == "one run", "nothing is known of its spread"
    one = judge(claim_named("C10"), "teen", Evidence(rows("", mm, degrees) + rows("[rig]", 0.7, 3.0)), PAPER)
    assert (
        one.verdict == expected and "through the rig itself, which favour neither: distance: refined 0.7" in one.reason
    )


def times_of(table="table3", character="teen", **milliseconds: float) -> list[Row]:
    facts = None, 1, 1_000, "laptop", "b"
    return [Row(table, character, name, "time_all_cores", "ms", ms, *facts) for name, ms in milliseconds.items()]


def test_c7_measures_the_time_beside_the_rigs_node_by_node_first():
    given = times_of(rig_nodes=50.0, rig=20.0, refined=8.0, refined_fast=4.0, refined_half=1.0)
    one = judge(claim_named("C7"), "teen", Evidence(given), PAPER)
    assert one.verdict == one.published == "measured" and one.comparison == "time: the CNN < the rig, node by node"
    assert one.effect == pytest.approx(4 / 50), "by the best evaluation of the same weights"
    assert one.paper == pytest.approx(4.2 / 75) and "5.00 times as fast as the rig, compiled" in one.reason
    assert verdict("C7", given[1:]) == "not tested", "the rig has two times"


def with_a_second_run(rows: list[Row], **changes: float) -> list[Row]:
    """Return times with how much each method's speed-up over the rig changed from an earlier run to this one."""
    facts = "ratio", None, 1, None, "laptop", "b"
    changed = [
        replace(rows[0], method=name, metric="change_time_all_cores[rig]", unit=facts[0], value=value, poses=None)
        for name, value in changes.items()
    ]
    return rows + changed


@pytest.mark.parametrize(
    ("dense", "expected"), [(1.0, "holds"), (2.0, "direction only"), (2.3, "undecided"), (3.0, "fails")]
)
def test_c8_wants_dense_to_be_faster_than_both_cnns_by_more_than_two_runs_differ(dense, expected):
    given = times_of(dense_fast=dense, coarse_fast=2.4, refined_fast=2.6)
    assert verdict("C8", given) == "one run", "the spread of a single run of times is not known"
    given = with_a_second_run(given, dense=1.01, coarse=1.0, refined=1.0)
    assert verdict("C8", given) == expected and verdict("C9", given) == "not tested"


def test_c8_has_a_verdict_for_each_back_end_and_is_undecided_where_they_differ():
    given = times_of(dense_fast=3.0, coarse_fast=2.0, refined_fast=2.0, dense_jax=1.0, coarse_jax=2.0, refined_jax=4.0)
    given += times_of(dense_onnx=5.0, dense_onnx_spinning=1.0, coarse_onnx=2.0, refined_onnx=2.0, dense_half=9.0)
    given += times_of(coarse=1.0, refined=1.0)  # PyTorch lacks dense
    given = with_a_second_run(given, dense=1.001, coarse=1.0, refined=1.0)
    judged = [one for one in judge_all(Evidence(given), PAPER) if one.claim == "C8" and one.character == "teen"]
    assert [(one.place, one.verdict) for one in judged] == [
        ("", "undecided"),
        ("compiled code", "fails"),
        ("JAX", "holds"),
        ("ONNX Runtime", "holds"),
    ]
    assert "Depends on the back end: compiled code fails" in judged[0].reason
    without = [row for row in given if not row.method.endswith("_fast")]
    assert verdict("C8", without) == "holds", "all back ends agree"


def test_c9_measures_the_cpu_beside_a_gpu_whose_operations_are_started_one_by_one_first():
    given = times_of(coarse_fast=0.5, refined=5.0, refined_fast=1.0)
    gpu = {"coarse_gpu": 2.0, "refined_gpu": 4.0, "refined_gpu_graph": 0.8}
    given += [replace(given[0], method=name, metric="time_gpu", value=ms) for name, ms in gpu.items()]
    one = judge(claim_named("C9"), "teen", Evidence(given), PAPER)
    assert one.verdict == "measured" and one.effect == pytest.approx(1 / 4) and one.paper == pytest.approx(4.2 / 8.7)
    assert "refined on a GPU, operations started as a whole 0.800 ms (25 % more)" in one.reason
    assert verdict("C9", given[:3]) == "not tested", "no GPU"
    elsewhere = beside([replace(row, value=10 * row.value) for row in given])
    both = judge(claim_named("C9"), "teen", Evidence([*given[:3], *elsewhere]), PAPER)
    assert both.effect == pytest.approx(1 / 4) and "one by one 40.0 ms" in both.reason
    own = judge(claim_named("C9"), "teen", Evidence([*given, *elsewhere]), PAPER)
    assert own.reason == one.reason, "a run that has been on a GPU needs no other machine"
    quicker = replace(given[0], method="refined_fast", metric="time_one_core", value=0.8)
    quick = judge(claim_named("C9"), "teen", Evidence([*given, quicker]), PAPER)
    assert quick.effect == pytest.approx(0.2), "on one core a pose may be quicker than on all"


def test_c9_says_where_the_papers_own_laptop_contradicts_it():
    rows = times_of(character="woman", refined=1.0, coarse=1.0)
    rows += [replace(row, method=f"{row.method}_gpu", metric="time_gpu") for row in rows]
    one = judge(claim_named("C9"), "woman", Evidence(rows), PAPER)
    words = "On the paper's laptop Valka's refined model is faster on the GPU: 5.20 ms on the CPU, 4.50 ms there."
    assert words in one.reason


def test_c11_measures_the_rigid_segments_of_the_attachment_rows_beside_tau():
    facts = ("mm", 0.15, None, 1, 9, "quick", "r")
    given = [
        Row("table2_segments", "teen", "attachment", f"vertex_error_{s}[rigid]", *facts) for s in ("mean", "p95", "max")
    ]
    one = judge(claim_named("C11"), "teen", Evidence(given), PAPER)
    assert one.verdict == "measured" and one.effect == pytest.approx(0.5)
    assert verdict("C11", [replace(row, table="table2") for row in given]) == "not tested"


@pytest.mark.parametrize(
    ("mm", "degrees", "expected"),
    [(0.5, 2.0, "undecided"), (0.49, 1.99, "holds"), (0.4, 2.1, "fails"), (0.6, 1.9, "fails")],
)
def test_c12_compares_balanced_draws_with_the_raw_animation_on_clips_that_neither_has_seen(mm, degrees, expected):
    def rows(change, mm, degrees, where="clips"):
        facts = SD, 3, 64, "laptop", "b"
        return [
            Row("bench_training", "teen", "coarse", f"{where}_vertex_error[{change}]", "mm", mm, *facts),
            Row("bench_training", "teen", "coarse", f"{where}_normal_error[{change}]", "deg", degrees, *facts),
        ]

    profile, raw = rows(BALANCED, mm, degrees), rows(RAW_ANIMATION, 0.5, 2.0)
    frames = [*rows(BALANCED, 0.3, 1.0, "validation"), *rows(RAW_ANIMATION, 0.1, 0.5, "validation")]
    assert verdict("C12", profile + raw) == expected
    one = judge(claim_named("C12"), "teen", Evidence(profile + raw + frames), PAPER)
    assert (
        one.verdict == expected and "neighbours are in the training: distance: augmented and balanced 0.3" in one.reason
    )
    one = judge(claim_named("C12"), "teen", Evidence([*profile, *raw, *rows(USUAL, 0.2, 1.5)]), PAPER)
    assert "Without balancing: distance: augmented 0.2" in one.reason and "neighbours" not in one.reason
    assert verdict("C12", profile) == verdict("C12", frames) == "not tested"
    toon = [replace(row, character="toon") for row in profile + raw]
    assert verdict("C12", toon, "toon") == "not tested", "Ray has no animation"


def test_c12_lets_rare_expressions_count_as_much_as_frequent_ones_where_it_can():
    def rows(change, mm, degrees, mean=""):
        facts = SD, 3, 64, "laptop", "b"
        return [
            Row("bench_training", "teen", "coarse", f"clips_vertex_error{mean}[{change}]", "mm", mm, *facts),
            Row("bench_training", "teen", "coarse", f"clips_normal_error{mean}[{change}]", "deg", degrees, *facts),
        ]

    over_poses = [*rows(BALANCED, 0.7, 2.6), *rows(RAW_ANIMATION, 0.6, 2.0)]
    rare = [*rows(BALANCED, 0.8, 2.7, "_expressions"), *rows(RAW_ANIMATION, 1.2, 3.4, "_expressions")]
    assert verdict("C12", over_poses) == "fails" and verdict("C12", over_poses + rare) == "holds"
    one = judge(claim_named("C12"), "teen", Evidence(over_poses + rare), PAPER)
    assert "In the mean over poses: distance: augmented and balanced 0.7" in one.reason


def test_a_wide_interval_leaves_undecided_what_a_narrow_one_decides():
    given = {"normal": {"refined": 0.65}}
    assert verdict("C3", mean_rows(**given)) == "one run"
    assert verdict("C3", mean_rows(**given, sd=0.02)) == "holds"
    assert verdict("C3", mean_rows(**given, sd=0.2)) == "undecided"
    one = judge(claim_named("C3"), "teen", Evidence(mean_rows(**given, sd=0.2)), PAPER)
    assert one.seeds == 3 and one.sd == one.limit_sd == 0.2 and one.low < 0.65 < 1 < one.high
    alone = judge(claim_named("C3"), "teen", Evidence(mean_rows(**given)), PAPER)
    assert alone.low is alone.high is None and "one run or two, whose spread nothing tells" in alone.reason
    both = Evidence([*mean_rows(**given), *mean_rows(**given, sd=0.02, character="woman")])
    lent = judge(claim_named("C3"), "teen", both, PAPER)
    assert lent.verdict == "holds" and "one run or two, with the spread of other characters" in lent.reason


def test_a_straight_line_that_beats_the_papers_networks_is_mentioned():
    given = mean_rows(normal={"refined": 0.65, "linear": 0.62, "dense": 0.6}, sd=SD)
    one = judge(claim_named("C3"), "teen", Evidence(given), PAPER)
    words = "A straight line has a smaller normal error than coarse and refined: 0.620°"
    assert one.verdict == "holds" and words in one.reason
    for given in (mean_rows(normal={"refined": 0.9, "linear": 2.0}), mean_rows(normal={"refined": 0.9})):
        assert "straight line" not in judge(claim_named("C3"), "teen", Evidence(given), PAPER).reason


def test_what_is_missing_is_named_with_the_target_that_makes_it():
    one = judge(claim_named("C1"), "woman", Evidence([]), PAPER)
    assert (one.verdict, one.published, one.value) == ("not tested", "holds", None)
    assert "table2.csv has no vertex_error_mean of refined for woman; `make table2 CHARACTERS=woman`" in one.reason


def test_a_number_that_only_a_remark_needs_undoes_no_verdict():
    facts = ("mm", 0.2, None, 1, 9, "quick", "r")
    mean, *tails = (
        Row("table2_segments", "teen", "attachment", f"vertex_error_{s}[rigid]", *facts) for s in ("mean", "p95", "max")
    )
    one, whole = (judge(claim_named("C11"), "teen", Evidence(rows), PAPER) for rows in ([mean], [mean, *tails]))
    assert whole.reason == f"{one.reason} The 95th percentile over their vertices and the test poses is 0.200 mm, " + (
        "the maximum 0.200 mm."
    )
    assert one.verdict == "measured" and replace(one, reason=whole.reason) == whole


def test_verdicts_are_read_back_as_they_are_and_pivot(tmp_path):
    better, worse = {"refined": 0.4}, {"refined": 1.1}
    sets = mean_rows(normal=better, sd=SD), mean_rows(normal=worse, character="ict", sd=SD), table1_rows()
    evidence = Evidence([row for rows in sets for row in rows])
    verdicts = judge_all(evidence, PAPER)
    write_verdicts(tmp_path / "claims.csv", verdicts)
    assert read_verdicts(tmp_path / "claims.csv") == verdicts
    pivot = verdict_frame(tmp_path / "claims.csv").pivot(index="claim", columns="character", values="verdict")
    assert pivot.loc["C2", "teen"] == "holds" and pivot.loc["C2", "ict"] == "fails"
    assert pivot.shape == (len(CLAIMS), 5) and pivot.loc["C2", "woman"] == "not tested"
    text = (tmp_path / "claims.csv").read_text().replace("not tested", "not sure")
    (tmp_path / "claims.csv").write_text(text)
    words = "holds, direction only, one run, undecided, fails, measured or not tested"
    with pytest.raises(InputError, match=rf"claims.csv, line \d+: verdict: expected {words}, got 'not sure'"):
        read_verdicts(tmp_path / "claims.csv")


def test_every_character_that_is_judged_on_sample_rows_gets_every_claim():
    verdicts = judge_all(Evidence(table2_rows(("teen", "mine"))), PAPER)
    assert len({(one.claim, one.character) for one in verdicts}) == len(verdicts) == 5 * len(CLAIMS)


@pytest.mark.parametrize(("half", "quarter", "expected"), [(0.5, 0.4, 0.5 / 0.6), (0.5, 0.61, 0.61 / 0.6)])
def test_c13_measures_the_worst_of_maps_on_new_meshes_beside_deformation_transfer(half, quarter, expected):
    facts = None, 1, 40, "laptop", "b"
    values = {"coarse": (half, quarter), "deformation_transfer_coarse": (0.6, 0.6), "coarse_carried": (0.3, 0.3)}
    given = [
        Row("figure13", "teen", method, f"{kind}_error_mean[{mesh}]", unit, value, *facts)
        for kind, unit in (("vertex", "mm"), ("normal", "deg"))
        for method, both in (values | {"deformation_transfer": (0.2, 0.2)}).items()
        for mesh, value in zip(("half", "quarter"), both, strict=True)
    ]
    one = judge(claim_named("C13"), "teen", Evidence(given), PAPER)
    assert one.verdict == "measured" and one.effect == pytest.approx(expected)
    assert (
        "has 0.300 mm and 0.300° on half" in one.reason and "sees the true mesh of each pose has 0.200 mm" in one.reason
    )


def test_c14_measures_how_the_refined_models_errors_grow_under_inverse_kinematics():
    facts = None, 1, 25, "laptop", "b"
    posed = {("refined", "vertex", "mm"): 1.5, ("refined", "normal", "deg"): 1.0, ("dense", "vertex", "mm"): 3.0}
    posed |= {("dense", "normal", "deg"): 2.0}
    given = [
        Row("table4", "toon", name, f"{kind}_error_mean{limited}", unit, value * share, *facts)
        for (name, kind, unit), value in posed.items()
        for limited, share in (("", 1.0), ("_limited", 0.5))
    ]
    tested = mean_rows(character="toon")
    one = judge(claim_named("C14"), "toon", Evidence([*given, *tested]), PAPER)
    before = {(row.method, row.metric): row.value for row in tested}
    growth = [value / before[name, f"{kind}_error_mean"] for (name, kind, _), value in posed.items()]
    assert one.verdict == "measured" and one.effect == pytest.approx(max(growth[:2]))
    assert one.comparison == "distance: refined under IK < on test poses" and one.paper == pytest.approx(0.58 / 0.40)
    words = [significant(share * value, 2) for share in (1.0, 0.5) for value in growth]
    assert f"Dense networks have {words[2]} and {words[3]} times as much in distance and normals." in one.reason
    assert f"the refined model has {words[4]} and {words[5]} times as much, dense networks {words[6]} and" in one.reason


def test_c15_measures_squares_where_they_are_beside_squares_on_all_charts():
    facts = None, 1, None, "laptop", "b"
    given = [
        Row("table1", "teen", "coarse", "segments", "count", 10.0, *facts),
        Row("table1", "teen", "refined", "segments", "count", 8.0, *facts),
        Row("table3", "teen", "coarse", "multiplications", "count", 50.0, *facts),
        Row("table3", "teen", "refined", "multiplications", "count", 210.0, *facts),
    ]
    one = judge(claim_named("C15"), "teen", Evidence(given), PAPER)
    assert one.verdict == "measured" and one.effect == pytest.approx(210 / (50 + 20 * 10 * 16))


def test_c10_names_what_is_nearer_without_a_network():
    facts = SD, 3, 25, "laptop", "b"
    errors = {"refined": (1.0, 4.0), "dense": (2.0, 5.0), "linear": (1.5, 3.0), "neutral": (9.0, 4.5)}
    given = [
        Row("table4", "teen", method, f"{kind}_error_mean", unit, value, *facts)
        for method, both in errors.items()
        for (kind, unit), value in zip((("vertex", "mm"), ("normal", "deg")), both, strict=True)
    ]
    one = judge(claim_named("C10"), "teen", Evidence(given), PAPER)
    assert (
        one.verdict == "direction only"
        and "A straight line has a smaller normal error there: 3.00° against 4.00°." in one.reason
    )
    assert "unmoved" not in one.reason


def test_a_number_of_a_character_that_is_a_folder_names_no_command_that_fails():
    with pytest.raises(MissingNumber, match="`make table3 CHARACTERS=<recipe or folder of mine>` writes it"):
        Evidence([]).number("table3", "mine", "coarse", "time")
    with pytest.raises(MissingNumber, match="`make table3 CHARACTERS=teen@one_face` writes it"):
        Evidence([]).number("table3", "teen@one_face", "coarse", "time")
