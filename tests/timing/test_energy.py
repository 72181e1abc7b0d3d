"""Energy by the counters of Linux's powercap: which of them count, what a call used, and why there may be none."""

from pathlib import Path

import pytest

from replicate.timing.machine import counters, energy_j, why_no_energy


def zone(folder: Path, name: str, kind: str, microjoules: str = "1000", largest: int = 9_999) -> Path:
    made = folder / name
    made.mkdir(parents=True)
    for file, text in (("name", kind), ("energy_uj", microjoules), ("max_energy_range_uj", str(largest))):
        (made / file).write_text(f"{text}\n")
    return made / "energy_uj"


def test_the_counters_are_those_of_processors_each_once(tmp_path):
    first, second = zone(tmp_path, "intel-rapl:0", "package-0"), zone(tmp_path, "intel-rapl:1", "package-1")
    zone(tmp_path, "intel-rapl:0:0", "core")
    zone(tmp_path, "intel-rapl-mmio:0", "package-0")
    zone(tmp_path, "intel-rapl:2", "package-2", microjoules="")  # nothing to read
    (tmp_path / "intel-rapl").mkdir()
    assert [counter.file for counter in counters(tmp_path)] == [first, second]
    assert why_no_energy(counters(tmp_path), tmp_path) == ""


def test_a_call_used_what_the_counter_went_on_by_even_past_its_end(tmp_path):
    file = zone(tmp_path, "intel-rapl:0", "package-0", microjoules="9000")
    (counter,) = counters(tmp_path)
    assert counter.joules(9_000, 9_500) == pytest.approx(500e-6)
    assert counter.joules(9_000, 500) == pytest.approx(1_500e-6)

    def use():
        file.write_text(str((int(file.read_text()) + 300) % 10_000))

    joules, calls = energy_j(use, [counter], least_s=0.0)
    assert calls == 1 and joules == pytest.approx(300e-6), "the first call, which warms up, does not count"


def test_a_machine_without_counters_says_so(tmp_path):
    assert counters(tmp_path / "none") == []
    assert "has no counters under" in why_no_energy([], tmp_path / "none")
    zone(tmp_path, "intel-rapl:0", "package-0", microjoules="")
    assert "can't be read" in why_no_energy(counters(tmp_path), tmp_path)
