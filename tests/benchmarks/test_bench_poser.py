"""The posing page's times: a point is dragged in a real browser, and what is refused before anything is trained."""

import numpy as np
import pytest
from browser import Tab, program
from posing_page import page_of

from replicate.base.exceptions import InputError
from replicate.benchmarks import bench_poser
from replicate.benchmarks.bench_poser import DRAG, READY, TABLE, WITHOUT, dragged, measure, poser_table
from replicate.config import resolve
from replicate.report.results import Row, read_results, write_results


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What the page says of a second of dragging, and where it had the first control point before and has it then."""
    folder = tmp_path_factory.mktemp("tab")
    (folder / "page.html").write_text(page_of(), encoding="utf-8")
    where = "mounted.then(({pose}) => [...pose.targets.slice(0, 3), ...pose.reached(0)])"
    with Tab(folder) as tab:
        tab.open((folder / "page.html").as_uri(), READY)
        before = tab.evaluate(where)
        return tab.evaluate(DRAG.replace("SECONDS", "1")), np.array(before), np.array(tab.evaluate(where))


def test_each_frame_drags_the_point_a_little_and_is_drawn(seen):
    times, before, after = seen
    assert times["frames"] > 1 and 1 <= times["seconds"] < 10
    assert 0 < times["posed"] <= times["frame"]
    assert times["card"] is False, "the tests' browser has no graphics card"
    dragged = 3 * np.sin((times["frames"] - 1) / 7)
    np.testing.assert_allclose(after[:3] - before[:3], [dragged, 0, 0], atol=1e-3)
    assert np.abs(after[3:] - before[3:]).max() > 0, "the face follows"


def test_a_page_is_opened_dragged_and_measured():
    text = page_of()
    numbers = {metric: (unit, value, count) for metric, unit, value, count in dragged(text, program(), 1)}
    assert list(numbers) == ["page_size", "opening", "pose_ms", "frame_ms", WITHOUT]
    assert numbers["page_size"] == ("MB", len(text.encode()) / 1e6, None)
    assert all(value > 0 for _, value, _ in numbers.values())
    unit, frames, count = numbers[WITHOUT]
    assert unit == "count" and frames < count <= 66, "a browser shows sixty a second"


def test_a_table_names_who_drew_the_frames(tmp_path):
    numbers = (("page_size", "MB", 10.96), ("opening", "s", 1.234), ("frame_ms", "ms", 14.2), (WITHOUT, "count", 11.7))
    rows = [Row(TABLE, "teen", "regional", *number, None, 1, None, "bench", "teen") for number in numbers]
    write_results(tmp_path / "bench_poser.csv", rows)  # which checks units
    table = poser_table(read_results(tmp_path / "bench_poser.csv"), "teen")
    assert table.headers[0][1:] == (
        *("page, MB", "opens in, s", "all that JavaScript does, ms"),
        "frames a second, drawn by the processor",
    )
    assert table.body == (("Regional (ours)", "10.96", "1.2", "14.2", "11.7"),)


def test_methods_without_a_page_and_machines_without_a_browser_are_refused_before_anything_is_made(monkeypatch):
    monkeypatch.setattr(bench_poser, "artefacts_of", lambda *_: pytest.fail("something is made"))
    monkeypatch.setattr(bench_poser, "browser", lambda: "/usr/bin/browser")
    with pytest.raises(InputError, match="methods: none of those named has a page; only regional, coarse, refined"):
        measure(resolve("tiny", "quick"), ["dense"], 1)
    monkeypatch.setattr(bench_poser, "browser", lambda: None)
    with pytest.raises(InputError, match="no browser to open the page in: install one of chromium"):
        measure(resolve("tiny", "quick"), ["regional"], 1)
