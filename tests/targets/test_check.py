"""`make check`: what it writes, what it prints, and how it ends where results would be meaningless."""

import numpy as np
import pytest
import sample_folders

from replicate import __main__ as cli
from replicate.base.exceptions import InputError
from replicate.drawing.panels import has_figure
from replicate.rig_study.first_look import CONTROL, FACE, MEANINGLESS, OK, SEGMENT, WORSE, Finding
from replicate.targets.check.shown import (
    in_lines,
    reach_chart,
    read_findings,
    segments_table,
    warnings_table,
    write_findings,
)

FACTS = {"vertices": 5, "faces": 4, "segments": 1, "controls": 2, "training_poses": 9, "validation_poses": 1,
         "test_poses": 3, "frames_per_second": 24.0}  # fmt: skip


def findings(controls: int = 2, said: int = 1) -> list[Finding]:
    """Return findings like those of `look`."""
    found = [Finding(FACE, "", name, "count", value) for name, value in FACTS.items()]
    found += [Finding(FACE, "m, guessed", "size", "mm", 161.5), Finding(FACE, "", "influence_threshold", "mm", None)]
    found += [Finding(FACE, "", f"bad_{k}", "count", 1.0, WORSE, f'"{k}", he said, is odd') for k in range(said)]
    for k in range(controls):
        never = k == 1
        values = {"training_low": 0.0, "training_high": float(not never), "training_of_limits": 1.0,
                  "used_in_training": 0.0 if never else 0.25, "reach": None if never else float(k),
                  "vertices": 3}  # fmt: skip
        for metric, value in values.items():
            bad = MEANINGLESS if never and metric == "used_in_training" else OK
            found.append(Finding(CONTROL, f"c{k}", metric, "", value, bad))
    parts = {
        "vertices": 5,
        "off_its_place": 0.0,
        "rigid": 1.0,
        "misplaced": 0.5,
        "attached_yet_misplaced": None,
        "controls": 2,
        "texels_a_vertex": 204.8,
    }
    return found + [Finding(SEGMENT, "jaw", metric, "", value) for metric, value in parts.items()]


def test_findings_are_read_back_as_they_were_written(tmp_path):
    write_findings(tmp_path / "check.csv", "teen", findings())
    assert read_findings(tmp_path / "check.csv") == findings()
    (tmp_path / "check.csv").write_text("kind\nface\n")
    with pytest.raises(InputError, match="expected the header"):
        read_findings(tmp_path / "check.csv")


def test_what_is_printed_begins_with_the_facts_and_has_the_worst_in_few_lines():
    lines = in_lines("teen", findings(), "check_teen.csv")
    assert lines[0].startswith(
        "teen: 5 vertices, 4 faces, 1 segment, 2 controls; 161.5 mm large (unit: m, guessed); 9 tr"
    )
    assert lines[1] == 'worse: "0", he said, is odd' and "c1: never moves in training" in lines[3]
    assert "c0: 0 to 1 in training, in 25% of the poses; moves 3 vertices, only together with others" in lines[4]
    assert "jaw: 5 vertices, 2 controls, rigid, follows nothing, 2e+02 texels a vertex" in lines[-1]
    many = in_lines("teen", findings(90, 30), "check_teen.csv")
    assert len(many) <= 25 and "18 more in check_teen.csv" in many[13]
    assert "86 more in check_teen.csv" in many[14] and "c1: never moves" in many[15]
    assert in_lines("teen", findings(said=0), "check_teen.csv")[1] == "nothing is amiss"


def test_the_chart_marks_controls_that_never_move_and_counts_those_it_leaves_out():
    figure, words = reach_chart(findings(90), "teen")
    texts = {text.get_text().strip() for text in figure.axes[0].texts}
    assert {"never moves in training", "only together with others", "… 30 more …"} <= texts
    assert len(figure.axes[0].patches) == 60 and "1 of 90 never move in training" in words.caption


def test_tables_name_what_is_amiss_and_each_segment():
    assert warnings_table("teen", findings()).body == (("worse", '"0", he said, is odd'),)
    assert warnings_table("teen", findings(said=0)).body == (("ok", "nothing is amiss"),)
    assert segments_table("teen", findings()).body[0][:3] == ("jaw", "rigid, follows nothing", "5")


def one_pose_each(folder, pair=False):
    """Write a folder with a pose for each of thirty controls, and the neutral. pair: instead one that moves two."""
    sample_folders.write(folder, 0)
    rest, rng, m = sample_folders.neutral(), np.random.default_rng(0), 30
    params = np.concatenate([pair * (np.eye(m)[:1] + np.eye(m)[1:2]), np.eye(m)]).astype(np.float32)
    places, ways = rng.uniform(-90, 90, (m, 2)), rng.normal(0, 6, (m, 3))
    away = ((rest[:, None, :2] - places) ** 2).sum(-1)
    shapes = np.exp(-away / 2 / 30**2).T[:, :, None] * ways[:, None]
    lines = "".join(f"s{k:02},0,0,1,face\n" for k in range(m))
    (folder / "controls.csv").write_text("name,lower,default,upper,region\n" + lines)
    vertices = (rest + np.tensordot(params, shapes, 1)).astype(np.float32)
    np.savez(folder / "poses" / "a.npz", params=params, vertices=vertices)
    return folder


def test_the_command_reports_on_samples_and_ends_with_2_where_training_can_learn_nothing(
    cache, tmp_path, monkeypatch, capfd
):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    monkeypatch.setattr("replicate.report.notebooks.execute", lambda source, out, given, stamp: out.write_text(stamp))
    sound, few = sample_folders.write(tmp_path / "sound"), one_pose_each(tmp_path / "few", pair=True)
    assert cli.main(["check", "--profile", "quick", "--characters", str(sound), str(few)]) == 2
    printed, folder = capfd.readouterr(), tmp_path / "runs" / "quick"
    assert printed.err.splitlines()[-1].startswith("few: results would be meaningless: ")
    assert "of 30 controls never move in training (s" in printed.err.splitlines()[-1]
    assert "sound: 30 vertices, 40 faces, 2 segments, 3 controls; 200 mm large (unit: mm, as its" in printed.out
    assert "only add shapes" not in printed.out
    for name in ("sound", "few"):
        assert read_findings(folder / f"check_{name}.csv")
        assert all(has_figure(folder / f"check_{name}{what}.png") for what in ("", "_reach"))
    capfd.readouterr()
    assert cli.main(["check", "--profile", "quick", "--characters", str(sound)]) == 0
    assert "nothing to do" in capfd.readouterr().out


def test_a_pose_for_each_control_is_a_face_of_shapes_with_nothing_amiss(cache, tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    monkeypatch.setattr("replicate.report.notebooks.execute", lambda source, out, given, stamp: out.write_text(stamp))
    sculpts = one_pose_each(tmp_path / "sculpts")
    assert cli.main(["check", "--profile", "quick", "--characters", str(sculpts)]) == 0
    printed = capfd.readouterr()
    assert f"{sculpts}/poses: no pose moves more than one control, so the face is read as the sum of" in printed.err
    assert "sculpts: 30 vertices, 40 faces, 2 segments, 30 controls; 200 mm large (unit: mm, as its" in printed.out
    assert "its controls only add shapes: a straight line is all of it (METHODS=linear)" in printed.out
    assert "never moves in training" not in printed.out and "meaningless" not in printed.out
