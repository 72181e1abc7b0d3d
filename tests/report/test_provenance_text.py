"""Pages say where their results come from: what characters share stands once, and each line says whose it is."""

import json
from pathlib import Path

import pytest

from replicate.base.exceptions import InputError
from replicate.base.paths import run_folder
from replicate.engine.provenance import LABELS
from replicate.report import notebooks
from replicate.report.notebooks import LINE, provenance_line, provenance_text

COMMIT = "0123456789abcdef0123456789abcdef01234567"
COMMAND = "python -m replicate table2 --profile quick"


@pytest.fixture
def manifest(tmp_path, monkeypatch) -> Path:
    """The manifest of the results of the profile "quick"; it isn't there yet."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    run_folder("quick").mkdir(parents=True)
    return run_folder("quick") / "manifest.json"


def stages(*seconds: float, **own) -> dict:
    return {f"stage{number}": {"wall_s": wall, **own} for number, wall in enumerate(seconds)}


def test_one_run_is_named_with_its_commit_its_changes_and_its_time(manifest):
    manifest.write_text(json.dumps({"git": {"commit": COMMIT, "clean": False}, "stages": stages(60, 30)}))
    text = provenance_text("quick")
    assert "0123456789ab, with changes of its own" in text and "1.5 min" in text
    assert COMMIT not in text, "the manifest has all digits"
    several = {"commit": COMMIT, "clean": False, "commits": ["f00d", COMMIT]}
    manifest.write_text(json.dumps({"git": several}))
    assert "0123456789ab and f00d, with changes of their own" in provenance_text("quick")


def test_the_gpu_of_any_stage_is_named(manifest):
    for own, expected in (({}, "GPU: none"), ({"gpu": "Quadro"}, "GPU: Quadro")):
        manifest.write_text(json.dumps({"gpu": None, "stages": stages(60) | {"timing": {"wall_s": 1.0, **own}}}))
        assert expected in provenance_text("quick")


def test_what_characters_share_stands_once_and_the_rest_under_their_names(manifest):
    shared = {"git": {"commit": "c0ffee", "clean": True}, "profile": "quick", "processor": "abacus", "cores": 2}
    shared["packages"] = {"jax": "0.9"}
    each = {
        "toon": {"seeds": [0], "stages": stages(120), "command": f"{COMMAND}; {COMMAND} --seed 1"},
        "teen": {"seeds": [0], "stages": stages(60), "command": COMMAND},
        "woman": {"seeds": [1], "stages": stages(60), "command": COMMAND},
    }
    manifest.write_text(json.dumps(shared | {"characters": each}))
    rows = provenance_text("quick").splitlines()
    assert sum("c0ffee" in row for row in rows) == sum("abacus" in row for row in rows) == 1
    labels = [row.partition("  ")[0] for row in rows]
    assert labels == [
        *("results", "commit", "machine", "packages"),
        *("command, teen woman", "profile, seeds, teen toon", "time of all stages, teen woman"),
        *("profile, seeds, woman", "command, toon", "", "time of all stages, toon"),
    ]
    column = rows[0].index(str(manifest.parent))
    assert [row[column:] for row in rows if COMMAND in row] == [COMMAND, COMMAND, f"{COMMAND} --seed 1"]
    assert all(row[column - 1] == " " != row[column] for row in rows)


def test_stages_made_elsewhere_are_named_while_they_are_few_and_counted_else(manifest):
    few, many = stages(1, 2, python="3.11.2"), stages(*range(9), packages={"jax": "0.9"}, instruction_set="sse")
    each = {"teen": {"stages": few | {"table2-teen": {"wall_s": 3}}}, "toon": {"stages": many}}
    manifest.write_text(json.dumps({"characters": each}))
    rows = [row for row in provenance_text("quick").splitlines() if "made elsewhere" in row]
    assert [row.split("  ")[-1].strip() for row in rows] == [
        "python 3.11.2: stage0, stage1",
        "instruction_set sse, jax 0.9: 9 stages",
    ]


def test_another_target_has_a_text_of_its_own_and_none_names_what_writes_it(manifest):
    table1 = {"characters": {"teen": {"stages": stages(60)}}}
    manifest.write_text(json.dumps({"git": {"commit": "c0ffee", "clean": True}, "targets": {"table1": table1}}))
    assert "1.0 min" in provenance_text("quick", "table1") and "c0ffee" not in provenance_text("quick", "table1")
    manifest.unlink()
    with pytest.raises(InputError, match="`make table2` writes it"):
        provenance_text("quick")


def test_numbers_from_table_2s_poses_name_them_and_leave_the_rest_to_table_2(manifest):
    drawn = {"pictures": {"commit": COMMIT, "clean": True}}
    facts = {"profile": "quick", "seeds": [0], "run": "c0ffee", "from": "table2_teen_pose*.npz", **drawn}
    manifest.write_text(json.dumps({"targets": {"figure10": {"characters": {"teen": facts}}}}))
    text = provenance_text("quick", "figure10")
    assert "table2_teen_pose*.npz of Table 2's run c0ffee" in text and "quick, [0]" in text and COMMIT[:12] in text
    assert "unknown" not in text and "None" not in text


def test_lines_are_no_longer_than_a_page_has_room_for_and_nothing_is_lost(manifest):
    commands = [
        f"{COMMAND} --characters teen woman dragon toon --seed {k} --methods coarse refined dense" for k in (1, 2)
    ]
    each = {
        who: {"command": "; ".join(commands), "seeds": [len(who)]} for who in ("teen", "a_character_of_somebody_else")
    }
    manifest.write_text(json.dumps({"characters": each}))
    text = provenance_text("quick")
    folder, *lines = text.splitlines()  # a path may be as long as it likes
    assert folder.startswith("results ") and all(len(line) <= LINE for line in lines)
    assert all(command in " ".join(text.split()) for command in commands)
    label = "profile, seeds, a_character_of_somebody_else"
    assert f"{label}\n{'':{LABELS}}None, [28]" in text, "a long label has a line of its own"


def test_one_line_names_the_runs_or_counts_them(manifest):
    each = {"teen": {"run": "a1", "seeds": [0, 1]}, "toon": {"run": "b2", "seeds": [1]}}
    shared = {"git": {"commit": COMMIT, "clean": True}, "profile": "quick"}
    manifest.write_text(json.dumps(shared | {"characters": each}))
    assert provenance_line("quick") == (
        "Where these numbers come from: runs a1 and b2, commit 0123456789ab, profile quick, seeds 0 and 1."
    )
    many = {f"c{k}": {"run": f"r{k}", "seeds": [0]} for k in range(5)}
    manifest.write_text(json.dumps({"characters": many}))
    assert provenance_line("quick") == "Where these numbers come from: 5 runs, seed 0."
    manifest.write_text("{}")
    assert provenance_line("quick").endswith(": unknown.")


def test_the_rest_is_folded_below_a_link_to_the_manifest(manifest, monkeypatch):
    shown = []
    monkeypatch.setattr("IPython.display.display", lambda what, raw: shown.append(what))
    manifest.write_text(json.dumps({"profile": "<b>", "command": COMMAND}))
    notebooks.show_provenance("quick")
    notebooks.show_provenance("reference", "table1")
    own, committed = (what["text/html"] for what in shown)
    assert '<a href="manifest.json">' in own and own.startswith("<details><summary>") and COMMAND in own
    assert "<b>" not in own and '<a href="../results/reference/manifest.json">' in committed
    assert all("<" not in what["text/markdown"] for what in shown)
