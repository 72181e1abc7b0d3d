"""Bad input from the command line to its one sentence: exit code 2, and nothing written."""

import re

import pytest

from data_recipes.recipe_paths import RECIPES
from replicate import __main__ as cli

TINY = (RECIPES / "tiny.toml").read_text(encoding="utf-8")


@pytest.fixture
def refused(capfd, cache, tmp_path, monkeypatch):
    """Run table2 on a recipe and return the sentence with which it is refused."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))

    def run(recipe, *arguments) -> str:
        file = tmp_path / "mine.toml"
        file.write_bytes(recipe if isinstance(recipe, bytes) else recipe.encode())
        assert cli.main(["table2", "--profile", "quick", "--characters", str(file), *arguments]) == 2
        said = capfd.readouterr().err.strip().splitlines()
        assert not (tmp_path / "results").exists()
        assert not [entry for entry in cache.glob("*") if entry.is_dir() and list(entry.glob("manifest.json"))]
        assert "Traceback" not in "".join(said)
        return said[-1]

    return run


@pytest.mark.parametrize(
    ("recipe", "parts"),
    [
        (TINY + "\n[nostril]\nwide = 3\n", ["mine.toml", "unknown key 'nostril'", "allowed are name, vertices"]),
        (TINY + "\n[acting]\nholds = 2\n", ["mine.toml", "'acting.holds': found 2, allowed is a number from 0 to 1"]),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", ["mine.toml", "no UTF-8", "allowed is a recipe in TOML"]),
        ("name = ", ["mine.toml", "broken TOML"]),
        ('clip_files = ["none.csv"]\n' + TINY, ["none.csv", "found no readable file"]),
    ],
)
def test_a_bad_recipe_is_refused_before_anything_is_made(refused, cache, recipe, parts):
    sentence = refused(recipe)
    assert all(part in sentence for part in parts), sentence
    assert not cache.exists()


@pytest.mark.parametrize(
    ("clip", "said"),
    [
        ("squash\nnan\n", r"line 2, squash is 'nan', where numbers from -1 to 1 are allowed"),
        ("wings\n0\n", r"'wings' in the header is no control of this rig"),
    ],
)
def test_a_bad_clip_is_refused_by_name_and_line(refused, tmp_path, clip, said):
    (tmp_path / "shot.csv").write_text(clip, encoding="utf-8")
    sentence = refused('clip_files = ["shot.csv"]\n' + TINY)
    assert "shot.csv" in sentence and re.search(said, sentence), sentence


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[coarse]\nmap_sise = 64\n", r"unknown key coarse\.map_sise: allowed are map_size"),
        ("[samples]\ncount = 0\n", r"samples\.count is 0: allowed is a whole number of at least 1"),
        ("[samples\n", "not a readable TOML file"),
    ],
)
def test_a_bad_configuration_is_refused_by_key(refused, tmp_path, text, said):
    (tmp_path / "mine_config.toml").write_text(text, encoding="utf-8")
    sentence = refused(TINY, "--config", str(tmp_path / "mine_config.toml"))
    assert "mine_config.toml" in sentence and re.search(said, sentence), sentence
