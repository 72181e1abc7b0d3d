"""`controls.csv` and `face.toml` as people and spreadsheets write them: what is clear is read, in one way only."""

import csv
import io

import numpy as np
import pytest
from sample_folders import CONTROLS, FACE, NAMES, shard, write

from data_recipes.catalogue import control_count, forget_folders, sampled_parts
from data_recipes.sampled.face_file import read_face
from data_recipes.sampled.importing import import_rig
from data_recipes.sampled.sample_folder import open_folder
from data_recipes.sampled.writing import write_folder
from replicate.base.exceptions import InputError


@pytest.fixture(autouse=True)
def fresh():
    """Forget folders of other tests."""
    forget_folders()


def folder_with(tmp_path, controls: str | None = None, toml: str | None = None, **columns: np.ndarray):
    """Return a good folder with another text, and with columns of parameters (40 poses a shard) behind the others."""
    folder = write(tmp_path / "box")
    if controls is not None:
        (folder / "controls.csv").write_bytes(controls.encode())
    if toml is not None:
        (folder / "face.toml").write_bytes(toml.encode())
    for k, file in enumerate(sorted((folder / "poses").iterdir())):
        arrays = shard(20 * k)
        arrays["params"] = np.column_stack([arrays["params"], *columns.values()]).astype(np.float32)
        np.savez(file, **arrays)
    return folder


def limits(folder) -> dict[str, tuple[float, float, float]]:
    """Return lower, default and upper of each control."""
    return {control.name: (control.lower, control.default, control.upper) for control in open_folder(folder).controls}


WRITTEN = {
    "a byte order mark": "\ufeff" + CONTROLS,
    "semicolons": CONTROLS.replace(",", ";"),
    "semicolons and commas for points": CONTROLS.replace(",", ";").replace(";1;", ";1,0;"),
    "tabs": CONTROLS.replace(",", "\t"),
    "blanks": CONTROLS.replace(",", " , "),
    "carriage returns": CONTROLS.replace("\n", "\r\n"),
    "carriage returns alone": CONTROLS.replace("\n", "\r"),
    "capitals in the header": CONTROLS.replace("name,lower", "Name,LOWER"),
    "another order of columns": "".join(",".join(line.split(",")[::-1]) + "\n" for line in CONTROLS.splitlines()),
    "empty cells and lines of a spreadsheet": CONTROLS.replace("\n", ",,\n") + ",,,,,,\n\n",
    "quotes": CONTROLS.replace("jaw", '"jaw"'),
}


@pytest.mark.parametrize("way", WRITTEN)
def test_a_table_of_controls_is_the_same_however_it_is_written(tmp_path, way, capfd):
    expectation = open_folder(write(tmp_path / "good")).controls
    assert open_folder(folder_with(tmp_path, WRITTEN[way])).controls == expectation
    assert not capfd.readouterr().err


def test_controls_without_a_region_are_of_the_face(tmp_path):
    text = "".join(line.rpartition(",")[0] + "\n" for line in CONTROLS.splitlines())
    assert {control.region for control in open_folder(folder_with(tmp_path, text)).controls} == {"face"}


@pytest.mark.parametrize("cells", [("", ""), ("-inf", "inf"), ("-Infinity", ""), ("-INF", "+inf")])
def test_limits_that_are_not_there_are_those_of_the_poses_that_were_not_drawn(tmp_path, cells, capfd):
    folder = folder_with(tmp_path, CONTROLS.replace("brow_up,-1,0,1", f"brow_up,{cells[0]},0,{cells[1]}"))
    acted = np.concatenate([shard(20 * k)["params"][:20, 1] for k in (0, 1)])
    assert limits(folder)["brow_up"] == pytest.approx((0, 0, acted.max()))
    assert limits(folder)["jaw"] == (0, 0, 1)
    assert capfd.readouterr().err == f"{folder}/controls.csv: limits taken from the poses: brow_up\n"


def test_one_limit_alone_may_be_missing(tmp_path):
    folder = folder_with(tmp_path, CONTROLS.replace("brow_up,-1,0,1", "brow_up,-3,0,"))
    assert limits(folder)["brow_up"][0] == -3 and 0.8 < limits(folder)["brow_up"][2] <= 1


@pytest.mark.parametrize("line", ["locked,0,0,0,face", "locked,,0,,face", "locked,0.1,0.1,0.1,face"])
def test_a_control_that_nothing_moves_is_left_out_with_a_word(tmp_path, line, capfd):
    value = float(line.split(",")[2])
    folder = folder_with(tmp_path, CONTROLS.replace("smile", f"{line}\nsmile"))
    for k, file in enumerate(sorted((folder / "poses").iterdir())):
        arrays = shard(20 * k)
        arrays["params"] = np.insert(arrays["params"], 2, value, axis=1)
        np.savez(file, **arrays)
    moves = np.ones((30, 4), bool)
    moves[:, 3] = False
    np.save(folder / "influence.npy", moves)
    found = open_folder(folder)
    assert tuple(limits(folder)) == NAMES and control_count(*sampled_parts(folder)) == 3
    np.testing.assert_array_equal(found.poses.params[:40], shard(0)["params"])
    np.testing.assert_array_equal(found.moves, np.ones((30, 3), bool) & [True, True, False])
    assert capfd.readouterr().err == f"{folder}/controls.csv: controls that nothing moves, left out: locked\n"
    (tmp_path / "rig").mkdir()
    assert len(import_rig(*sampled_parts(folder), tmp_path / "rig").controls) == 3


def test_a_control_without_a_range_that_the_poses_move_is_refused(tmp_path):
    folder = folder_with(tmp_path, CONTROLS + "locked,0,0,0,face\n", locked=np.linspace(0, 1, 40))
    with pytest.raises(InputError, match=r"params\[1, 3\]: expected 0, as its control has no range, got 0.0256"):
        open_folder(folder)


def test_a_face_of_locked_controls_alone_is_refused(tmp_path):
    folder = write(tmp_path / "box")
    (folder / "controls.csv").write_text("name,lower,default,upper\na,0,0,0\nb,0,0,0\nc,0,0,0\n")
    for k, file in enumerate(sorted((folder / "poses").iterdir())):
        np.savez(file, **shard(20 * k) | {"params": np.zeros((40, 3), np.float32)})
    with pytest.raises(InputError, match=r"controls\.csv: expected a control that poses move, got none"):
        open_folder(folder)


LONG = "|" + "character_grp|" * 6 + "ctl.translateY"


@pytest.mark.parametrize(
    "name", ["|grp|ctl_up.translateY", LONG, "ctl, up", "口を開ける", 'the "jaw"', "Smile", "jaw;open"]
)
def test_names_of_controls_are_those_of_the_users_program(tmp_path, name):
    text = io.StringIO()
    csv.writer(text).writerows(
        [name if cell == "jaw" else cell for cell in line.split(",")] for line in CONTROLS.split("\n")
    )
    folder = folder_with(tmp_path, text.getvalue())
    assert tuple(limits(folder)) == (name, *NAMES[1:])
    (tmp_path / "rig").mkdir()
    rig = import_rig(*sampled_parts(folder), tmp_path / "rig")
    again = tmp_path / "again"
    write_folder(rig, again, 20, [{"params": shard(0)["params"][:20]}])
    assert limits(again) == limits(folder)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("jaw,0,0,1", "jaw,1,0,0", "line 2: 'jaw': expected lower below upper, got 1 and 0"),
        ("jaw,0,0,1", "jaw,0,2,1", "line 2: 'jaw': expected a default from 0 up to 1, got 2"),
        ("jaw,0,0,1", "jaw,1,0,1", "line 2: 'jaw': expected a default from 1 up to 1, got 0"),
        ("jaw,0,0,1", "jaw,,-5,-6", "line 2: 'jaw': expected a default up to -6, got -5"),
        ("jaw,0,0,1", "jaw,0,,1", "line 2: default of 'jaw': expected a number up to 1e+09, got ''"),
        ("jaw,0,0,1", "jaw,0,0,1e300", "line 2: upper of 'jaw': expected a number up to 1e+09, got '1e300'"),
        ("jaw,0,0,1", "jaw,0,0,nan", "line 2: upper of 'jaw': expected a number up to 1e+09, got 'nan'"),
        ("jaw,", f"{'j' * 201},", "line 2: name: expected a printable text of 1 to 200 bytes"),
        (
            "name,lower,default,upper,region\n",
            "",
            "line 1: expected name,lower,default,upper,region, got 'jaw,0,0,1,mouth'",
        ),
        (
            "name,lower",
            "name,min",
            "line 1: expected name,lower,default,upper,region, got 'name,min,default,upper,region'",
        ),
        (
            "lower,default",
            "lower,lower",
            "line 1: expected name,lower,default,upper,region, got 'name,lower,lower,upper",
        ),
        ("jaw,0,0,1,mouth", "jaw,0,0,1,mouth,x", "line 2: expected 5 values, name,lower,default,upper,region, got 6"),
        ("smile,", "jaw,", "line 4 names the control 'jaw' again"),
    ],
)
def test_what_is_not_clear_is_refused_by_line_and_control(tmp_path, old, new, sentence):
    assert old in CONTROLS
    with pytest.raises(InputError) as error:
        open_folder(folder_with(tmp_path, CONTROLS.replace(old, new, 1)))
    assert f"controls.csv: {sentence}" in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "key", "value"),
    [
        ("", "\ufeff", "name", "box"),
        ("\n", "\r\n", "name", "box"),
        ('"mm"', '"dm"', "mm", 100.0),
        ('"mm"', '"ft"', "mm", 304.8),
        ('"mm"', '"CM"', "mm", 10.0),
        ('up = "y"', 'up = "Z"', "up", "z"),
        ('segments = "groups"\n', "", "segments", "groups"),
        ('"groups"', '"Islands"', "segments", "islands"),
        ('"box"', '"my-face"', "name", "my-face"),
        ('"box"', '"顔-2"', "name", "顔-2"),
    ],
)
def test_a_face_file_is_read_however_it_is_written(tmp_path, old, new, key, value):
    text = FACE.replace(old, new) if old else new + FACE
    assert text != FACE
    assert getattr(read_face(folder_with(tmp_path, toml=text)), key) == value


@pytest.mark.parametrize("name", ["", "a b", "-x", "a/b", "n" * 101])
def test_a_name_that_no_result_could_have_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="name: expected at most 100 letters, digits, _ and -, got"):
        read_face(folder_with(tmp_path, toml=FACE.replace('"box"', f'"{name}"')))
