"""Sentences of texts and notebooks that quote results: the numbers behind them lie where the sentences say."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from replicate.base import paths

ENTRIES = tomllib.loads((Path(__file__).parent / "quoted_numbers.toml").read_text())["number"]
FILTERS = ("table", "character", "method", "metric", "seed", "segment", "kind")  # columns that pick lines of a CSV file


def name_of(entry: dict) -> str:
    return f"{Path(entry['text']).name}: {entry['says']}"


def prose(text: str) -> str:
    """Return what a text or a notebook's markdown cells say, with single spaces for line breaks."""
    content = (paths.ROOT / text).read_text(encoding="utf-8")
    if text.endswith(".ipynb"):
        cells = [cell["source"] for cell in json.loads(content)["cells"] if cell["cell_type"] == "markdown"]
        content = "\n".join("".join(source) for source in cells)
    return " ".join(content.split())


@pytest.fixture(scope="module")
def read():
    """A function that reads a CSV file of the reference once."""
    import pandas

    tables = {}

    def read_once(name: str) -> pandas.DataFrame:
        if name not in tables:
            tables[name] = pandas.read_csv(paths.REFERENCE / f"{name}.csv")
        return tables[name]

    return read_once


def numbers(read, place: dict) -> np.ndarray:
    """Return the values at a place: `file`, conditions on columns of `FILTERS`, and `column`, else "value"."""
    table = read(place["file"].format(**place))
    if "table" not in place and "table" in table.columns:
        place = {"table": Path(place["file"]).name.removesuffix("_seeds"), **place}
    for column in FILTERS:
        if column not in place or column not in table.columns:
            continue
        wanted = place[column] if isinstance(place[column], list) else [place[column]]
        exact = table[column].isin(wanted)
        begins = [word[:-1] for word in wanted if isinstance(word, str) and word.endswith("*")]
        table = table[exact | table[column].astype(str).str.startswith(tuple(begins))] if begins else table[exact]
    assert len(table), f"{place} is in no line"
    order = [column for column in FILTERS if column in table.columns]
    return table.sort_values(order, kind="stable")[place.get("column", "value")].to_numpy()


def behind(read, entry: dict, character: str) -> np.ndarray:
    """Return the numbers behind a sentence, for one character."""
    place = {"file": entry["file"], "character": character, **entry["value"]}
    values = numbers(read, place)
    if "over" in entry:
        divisors = numbers(read, {**place, **entry["over"]})
        assert 1 in (len(values), len(divisors)) or len(values) == len(divisors), "they are no pairs"
        values = values / divisors
    return values


@pytest.mark.parametrize("text", sorted({entry["text"] for entry in ENTRIES}))
def test_a_text_says_what_its_entries_quote(text):
    said = prose(text)
    missing = [entry["says"] for entry in ENTRIES if entry["text"] == text and entry["says"] not in said]
    assert not missing, f"{text} no longer says {missing}: mend these entries of quoted_numbers.toml, and their bands"


@pytest.mark.parametrize("entry", ENTRIES, ids=name_of)
def test_the_numbers_behind_a_sentence_are_as_it_says(entry, read):
    low, high = entry["band"]
    for character in entry["characters"].split():
        for value in behind(read, entry, character):
            assert low <= value <= high, (
                f"{character} has {value:.4g}, outside of {low} to {high}: mend {entry['text']}"
            )


def test_conditions_pick_lines_and_pair_them(read):
    import pandas

    lines = [("t", "a", m, f"e[{k}]", v) for m, k, v in (("x", 1, 2.0), ("y", 1, 4.0), ("x", 2, 3.0), ("y", 2, 12.0))]
    table = pandas.DataFrame(lines, columns=["table", "character", "method", "metric", "value"])
    entry = {"file": "t", "value": {"method": "x", "metric": "e[*"}, "over": {"method": "y"}}
    assert behind(lambda name: table, entry, "a").tolist() == [0.5, 0.25]
    assert behind(lambda name: table, entry | {"over": {"method": "y", "metric": "e[1]"}}, "a").tolist() == [0.5, 0.75]
    with pytest.raises(AssertionError, match="is in no line"):
        behind(lambda name: table, entry, "b")
