"""Recipes are read exactly; whatever doesn't fit gets one sentence: file, key, what was expected and what was found."""

import json
import re

import pytest

from data_recipes.recipe import reading
from data_recipes.recipe.reading import load_recipe, without_place
from data_recipes.recipe_paths import character_names
from replicate.base.exceptions import InputError
from replicate.base.schema import to_json
from replicate.base.user_files import read_toml

TEMPLATE = """
half_columns = 14
anchors = [[0, -140, 0, 0, -18, -18], [17, 22, 66, 66, 0, -10]]
angles = [[0, 0], [14, 180]]
neck_rows = 2
face_columns = 7
hair_row = 15
crown_across = 6
mouth_rows = [4, 6]
mouth_columns = 3
mouth_rings = 3
lip_rings = 1
eye_rows = [9, 11]
eye_columns = [2, 5]
nostril_rows = [6, 7]
nostril_columns = [1, 2]
ear_rows = [8, 11]
ear_columns = [9, 11]
coarse_rows = [11, 17]
coarse_from = 11
"""

SEGMENTS = "layouts.fine.segments"


def key_of(path):
    """Return what a key has of a recipe."""
    return to_json(without_place(load_recipe(path)))


def write(folder, text="", template="", top='name = "someone"\nvertices = 900'):
    lines = TEMPLATE
    for line in template.splitlines():
        key = line.split(" =")[0]
        lines = re.sub(rf"^{key} = .*\n", "", lines, flags=re.M) + line + "\n"
    path = folder / "someone.toml"
    path.write_text(f"{top}\n{text}\n[template]\n{lines}")
    return path


def test_the_recipes_of_the_project_load():
    assert {"teen", "tiny"} <= set(character_names())
    for name in character_names():
        assert load_recipe(name).name == name


def test_a_key_left_out_keeps_its_default_and_a_given_one_counts(tmp_path):
    recipe = load_recipe(write(tmp_path, "[eyes]\nradius = 17\n[mouth]\nbag_rings = [[0, 1, 2], [1, 2.5, 3]]"))
    assert (recipe.eyes.radius, recipe.eyes.centre) == (17.0, (33.5, 0.0, 62.0))
    assert recipe.mouth.bag_rings == ((0.0, 1.0, 2.0), (1.0, 2.5, 3.0))
    assert recipe.template.mouth_rows == (4, 6)
    assert recipe.file == "someone.toml"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[eyes]\nradias = 17", "unknown key eyes.radias: expected centre, radius"),
        ("[nostril]\na = 1", "unknown key nostril: expected name, vertices"),
        ("[eyes]\nradius = 170", "eyes.radius: expected a number from 3 to 60, got 170"),
        ("[eyes]\nradius = nan", "eyes.radius: expected a number from 3 to 60, got nan"),
        ("[eyes]\nradius = true", "eyes.radius: expected a number from 3 to 60, got True"),
        ("[eyes]\nradius = 'big'", "eyes.radius: expected a number from 3 to 60, got 'big'"),
        ("[eyes]\ncentre = [1, 2]", "eyes.centre: expected 3 numbers from -300 to 300, got [1, 2]"),
        ("[eyes]\ncentre = [1, 2, inf]", "eyes.centre: expected 3 numbers from -300 to 300, got [1, 2, inf]"),
        ("[eyes]\npupil = 'square'", "eyes.pupil: expected round or slit, got 'square'"),
        ("[eyes]\npupil_deg = 50", "eyes.pupil_deg: expected less than iris_deg = 28.5, got 50.0"),
        ("[teeth]\nupper = 5", "teeth.upper: expected an even number from 2 to 80, got 5"),
        ("[teeth]\nupper = 4.0", "teeth.upper: expected an even number from 2 to 80, got 4.0"),
        ("[teeth]\nupper = 16", "teeth.widths_upper: expected a width for each of the 8 teeth of a half, got 7"),
        (
            "[teeth]\nwidths_upper = [8, 900]",
            "teeth.widths_upper: expected a list of one or more numbers from 0.5 to 60, got [8, 900]",
        ),
        (
            "[teeth]\nwidths_upper = []",
            "teeth.widths_upper: expected a list of one or more numbers from 0.5 to 60, got []",
        ),
        ("[tongue]\ncap = [2, 3]", "tongue.cap: expected two even numbers, got [2, 3]"),
        ("[tongue]\ngum_columns_lower = 6", "tongue.gum_columns_lower: expected an odd number, got 6"),
        ("[mouth]\nbag_rings = [[0, 1]]", "mouth.bag_rings: expected rows of 3 numbers from 0 to 400, got [[0, 1]]"),
        ("[controls]\nface = 58", "controls.face: expected a whole number from 0 to 57, got 58"),
        (
            f"[{SEGMENTS}]\nears = 'ear_left'",
            f"{SEGMENTS}: expected a table of lists of the parts face, cranium",
        ),
        (
            f"[{SEGMENTS}]\nears = ['ear_left', 'nose']",
            "gum_lower, tongue, got {'ears': ['ear_left', 'nose']}",
        ),
        (
            f"[{SEGMENTS}]\nears = ['ear_left']",
            f"{SEGMENTS}.ears: expected two or more parts, got ['ear_left']",
        ),
        (
            f"[{SEGMENTS}]\nneck = ['ear_left', 'ear_right']",
            f"{SEGMENTS}.neck: expected a name that no other segment has, got 'neck'",
        ),
        (
            f"[{SEGMENTS}]\na = ['neck', 'neck']",
            f"{SEGMENTS}.a: expected each part once, got 'neck' again",
        ),
        (
            f"[{SEGMENTS}]\na = ['neck', 'face']",
            f"{SEGMENTS}.a: expected parts other than 'face', which needs all of its chart, got ['neck', 'face']",
        ),
        ("[acting]\nholds = 2", "acting.holds: expected a number from 0 to 1, got 2"),
    ],
)
def test_a_section_that_does_not_fit_is_refused_in_one_sentence(tmp_path, text, sentence):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as error:
        load_recipe(path)
    assert sentence in str(error.value)
    assert "someone.toml" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("anchors = [[0, -140, 0, 0, -18, -18]]", "template.anchors: expected two or more rows with growing"),
        ("angles = [[0, 0], [9, 90], [7, 180]]", "half_columns = 14, got [0.0, 9.0, 7.0]"),
        ("eye_rows = [9, 30]", "eye_rows: expected two different rows from neck_rows = 2 to 17, got [9, 30]"),
        ("ear_rows = [9, 9]", "ear_rows: expected two different rows from neck_rows = 2 to 17, got [9, 9]"),
        (
            "eye_rows = [11, 9]",
            "template.eye_rows: expected two whole numbers from 0 to 300, the smaller first, got [11, 9]",
        ),
        ("mouth_rows = [3, 6]", "template.mouth_rows: expected rows an even number apart, got [3, 6]"),
        ("nostril_rows = [5, 7]", "template.nostril_rows: expected rows above mouth_rows and below eye_rows"),
        ("hair_row = 17", "template.hair_row: expected a row below the last one, 17, got 17"),
        ("crown_across = 14", "template.crown_across: expected fewer than half_columns = 14, got 14"),
        ("face_columns = 8", "template.face_columns: expected eye_columns < face_columns < ear_columns - 1"),
        ("mouth_columns = 7", "template.mouth_columns: expected fewer than face_columns = 7, got 7"),
        ("nostril_columns = [2, 7]", "template.nostril_columns: expected fewer than face_columns = 7, got 7"),
        ("coarse_rows = [10, 17]", "template.coarse_rows: expected rows a multiple of 3 apart, got [10, 17]"),
        ("lip_rings = 3", "template.lip_rings: expected fewer than mouth_rings = 3, got 3"),
    ],
)
def test_a_template_whose_parts_collide_is_refused(tmp_path, line, sentence):
    with pytest.raises(InputError, match=re.escape(sentence)):
        load_recipe(write(tmp_path, template=line))


@pytest.mark.parametrize(
    ("top", "sentence"),
    [
        ("vertices = 9", "name is missing: expected a value"),
        ('name = "a b"\nvertices = 9', "name: expected a name of at most 100 letters, digits and _, got 'a b'"),
        ('name = "a"\nvertices = 0', "vertices: expected a whole number from 1 to 1000000, got 0"),
        ('name = "a"\nvertices = 9\neyes = 3', "eyes: expected a table [eyes], got 3"),
        (
            'name = "a"\nvertices = 9\nclip_files = "a.csv"',
            "clip_files: expected a list of paths of CSV files, got 'a.csv'",
        ),
        (
            'name = "a"\nvertices = 9\nclip_files = ["a/x.csv", "b/x.csv"]',
            "clip_files: expected files of different names, got",
        ),
        ("name = ", "not a readable TOML file"),
    ],
)
def test_a_recipe_without_its_head_is_refused(tmp_path, top, sentence):
    with pytest.raises(InputError, match=re.escape(sentence)):
        load_recipe(write(tmp_path, top=top))


def test_files_that_are_no_recipes_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"missing\.toml: there is no such file"):
        load_recipe(tmp_path / "missing.toml")
    with pytest.raises(InputError, match=r"no character xyz: there are .*teen.*, and paths of \.toml recipes"):
        load_recipe("xyz")
    (tmp_path / "picture.toml").write_bytes(b"\x89PNG\r\n\xff\x00")
    with pytest.raises(InputError, match="byte 0 is no UTF-8"):
        load_recipe(tmp_path / "picture.toml")


def test_a_recipes_key_follows_what_it_says_and_not_how_it_is_written(tmp_path):
    plain = key_of(write(tmp_path))
    path = write(tmp_path)
    path.write_text("# a comment\n" + path.read_text().replace("vertices = 900", "vertices   =   900  # many"))
    assert key_of(path) == plain
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    assert key_of(write(elsewhere)) == plain
    assert key_of(write(tmp_path, "[eyes]\nradius = 20.5")) == plain, "a default, written down"
    assert key_of(write(tmp_path, "[eyes]\nradius = 20.6")) != plain
    assert load_recipe(path).eyes.radius == 20.6


def test_the_order_of_segments_is_part_of_a_recipes_key(tmp_path):
    pairs = ['ears = ["ear_left", "ear_right"]', 'gums = ["gum_upper", "gum_lower"]']
    keys = [
        key_of(write(tmp_path, "[layouts.one_face.segments]\n" + "\n".join(lines))) for lines in (pairs, pairs[::-1])
    ]
    assert json.dumps(keys[0], sort_keys=True) != json.dumps(keys[1], sort_keys=True)


def test_a_recipe_is_read_once(tmp_path, monkeypatch):
    path, read = write(tmp_path), []
    monkeypatch.setattr(reading, "read_toml", lambda file: read.append(file) or read_toml(file))
    load_recipe(path)
    assert read == [path]


def test_a_frill_has_all_of_its_numbers_or_none(tmp_path):
    assert load_recipe(write(tmp_path, "[frills]\njaw = []")).frills.jaw == ()
    with pytest.raises(InputError, match=r"frills\.jaw: expected 12 numbers from -300 to 300, got \[1, 2\]"):
        load_recipe(write(tmp_path, "[frills]\njaw = [1, 2]"))


def test_a_variant_is_a_layout_of_the_recipes_charts_and_no_other_word(tmp_path):
    file = str(write(tmp_path))
    assert load_recipe(f"{file}@fine").charts.face_bands == 4 and load_recipe(f"{file}@one_face").charts.face_bands == 1
    for word in ("fien", "", "fine@"):
        with pytest.raises(
            InputError, match=r"after @: expected one_face, fine, a layout of its charts; 1 to 6, a .*, got '.*'"
        ):
            load_recipe(f"{file}@{word}")


def test_a_layout_that_does_not_count_is_no_part_of_a_recipes_key(tmp_path):
    plain = key_of(write(tmp_path))
    assert key_of(write(tmp_path, "[layouts.fine]\nface_bands = 3")) == plain
    assert key_of(write(tmp_path, "[layouts.one_face]\nface_bands = 3")) != plain
