"""How long the posing page takes in a real browser: to open, to follow a dragged point, and frames a second meanwhile.

`make bench-poser` trains what the page needs where that is missing, opens it from disk in this machine's Chromium or
Chrome and drags one control point to and fro, in each frame a little further.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.benchmarks.common import (
    add_count,
    add_methods,
    answer,
    artefacts_of,
    bench_methods,
    bench_row,
    make_parser,
)
from replicate.config import Config
from replicate.inverse import ik_stage
from replicate.methods import artefacts, regional
from replicate.methods.method_registry import choose, in_order, method_named
from replicate.methods.plan import Plan
from replicate.poser.browser_pictures import BROWSERS, browser
from replicate.poser.contents import as_on_page
from replicate.poser.face_page import face_page
from replicate.poser.notebook import read_face
from replicate.poser.pack import EVALUATED
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off

ABOUT = "the posing page in a browser: seconds to open, ms to follow a dragged point, frames a second"
WRITES = "results/runs/bench/bench_poser.csv"
TABLE = "bench_poser"
SECONDS = 10  # of dragging
READY = "window.mounted && mounted.then(Boolean)"
WITH_CARD, WITHOUT = "frames_per_s[graphics card]", "frames_per_s[processor]"
# Drags the first control point 3 mm to and fro. → {posed, frame}: medians, ms; frames, seconds; card.
DRAG = """mounted.then(({pose, view, draw}) => new Promise((done) => {
  const posed = [], frame = [], [x, y] = pose.targets, start = performance.now();
  const median = (times) => times.sort((a, b) => a - b)[times.length >> 1];
  const step = () => {
    const from = performance.now();
    pose.drag(0, x + 3 * Math.sin(posed.length / 7), y);
    posed.push(performance.now() - from);
    draw();
    frame.push(performance.now() - from);
    const seconds = (performance.now() - start) / 1000;
    if (seconds < SECONDS) requestAnimationFrame(step);
    else done({ posed: median(posed), frame: median(frame), frames: posed.length, seconds, card: view.card });
  };
  requestAnimationFrame(step);
}))"""
COLUMNS = (
    ("page_size", "page, MB"),
    ("opening", "opens in, s"),
    ("pose_ms", "IK, mesh and normals, ms"),
    ("frame_ms", "all that JavaScript does, ms"),
    (WITH_CARD, "frames a second, graphics card"),
    (WITHOUT, "frames a second, drawn by the processor"),
)


def measure(config: Config, words: Sequence[str], seconds: int) -> list[Row]:
    """Make one character's pages, drag a point of each in a browser, and return the rows."""
    if not (program := browser()):
        raise InputError(f"this machine has no browser to open the page in: install one of {', '.join(BROWSERS)}")
    plan = Plan(config)
    methods = [method for method in choose(words, config) if method.name in EVALUATED]
    if not methods:
        raise InputError(f"methods: none of those named has a page; only {', '.join(EVALUATED)} have one")
    shared = [stage(plan) for stage in (artefacts.rig_stage, artefacts.rigid_stage, artefacts.influence_stage)]
    of_methods = [stage for method in methods for stage in (*method.stages(plan), ik_stage.stage(plan, method))]
    inputs = artefacts_of(TABLE, config, [*shared, *of_methods])
    rows = []
    for method in methods:
        face = read_face(inputs, as_on_page(method.model(inputs)), method.name)
        page = face_page(face, np.random.default_rng(0), progress, TABLE)
        rows += [bench_row(TABLE, plan.character, method.name, *facts) for facts in dragged(page, program, seconds)]
    return rows


def dragged(page: str, program: str, seconds: int) -> list[tuple[str, str, float, int | None]]:
    """Drag a point of a page, given as HTML, in a browser; return (metric, unit, value, count) tuples."""
    from replicate.benchmarks.browser_tab import BrowserTab

    with tempfile.TemporaryDirectory() as folder, BrowserTab(program, Path(folder)) as tab:
        file = Path(folder) / "page.html"
        size = file.write_bytes(page.encode())
        start = time.perf_counter()
        tab.open(file.as_uri(), READY)
        opening = time.perf_counter() - start
        seen = tab.evaluate(DRAG.replace("SECONDS", str(seconds)))
    count = seen["frames"]
    return [
        ("page_size", "MB", size / 1e6, None),
        ("opening", "s", opening, 1),
        ("pose_ms", "ms", float(seen["posed"]), count),
        ("frame_ms", "ms", float(seen["frame"]), count),
        (WITH_CARD if seen["card"] else WITHOUT, "count", count / seen["seconds"], count),
    ]


def poser_table(rows: Sequence[Row], character: str) -> Table:
    """Return what one character's pages take in a browser, a line a method."""
    rows = [row for row in rows if row.table == TABLE and row.character == character]
    shown = [(metric, words) for metric, words in COLUMNS if any(row.metric == metric for row in rows)]
    body = []
    for name in in_order({row.method for row in rows}):
        cells = [find(rows, TABLE, character, name, metric) for metric, _ in shown]
        body.append((method_named(name).label, *(_cell(cell) for cell in cells)))
    notes = (
        "A point is dragged to and fro, in each frame a little further; medians over the frames, one thread.",
        "Frames: what the browser shows, 60 a second at most. Without a graphics card the processor draws, too.",
    )
    return Table(
        f"The posing page in a browser: {character}", (("", *(words for _, words in shown)),), tuple(body), notes
    )


def _cell(row: Row | None) -> str:
    if row is None:
        return "–"
    return f"{row.value:.1f}" if row.unit != "MB" else round_off(row.value, row.unit)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time the posing page in a browser.", profile="whose trainings are shown")
    add_methods(parser, "poser")
    parser.set_defaults(methods=[regional.METHOD.name])
    add_count(parser, "seconds", SECONDS, "that a point is dragged for")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    timed = partial(measure, seconds=options.seconds)
    bench_methods(TABLE, timed, poser_table, options, command_line, rig_use="for pictures in a browser")


if __name__ == "__main__":
    sys.exit(main())
