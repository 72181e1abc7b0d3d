"""The machine's peaks: in the range of what processors do."""

from replicate.timing import machine
from replicate.timing.machine import CACHE_BYTES, bytes_per_s, multiply_adds_per_s


def test_a_core_multiplies_and_reads_as_fast_as_cores_do(monkeypatch):
    monkeypatch.setattr(machine, "REPEATS", 3)
    monkeypatch.setattr(machine, "ROUNDS", 20_000)
    assert 1e9 < multiply_adds_per_s() < 1e12
    assert 1e8 < bytes_per_s(CACHE_BYTES) < 1e12


def test_more_rounds_take_longer(monkeypatch):
    monkeypatch.setattr(machine, "REPEATS", 3)
    rates = []
    for rounds in (20_000, 200_000):
        monkeypatch.setattr(machine, "ROUNDS", rounds)
        rates.append(multiply_adds_per_s())
    assert 0.2 < rates[0] / rates[1] < 5, "a loop that is compiled away takes no time for ten times the rounds"
