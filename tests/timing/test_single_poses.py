"""Times of single poses: who is timed how often, and what is summarised."""

import gc
import time

import numpy as np
import pytest

from replicate.timing.single_poses import TURN, WARM_UP, Times, Turns, Way, summary, time_single_poses


def test_ways_take_turns_of_some_poses_one_at_a_time():
    calls = []
    ways = {
        name: Way(lambda pose, name=name: calls.append((name, pose.shape, float(pose[0, 0])))) for name in ("a", "b")
    }
    done = []
    times = time_single_poses(ways, np.arange(6.0).reshape(3, 2), 12, done.append)
    assert len(calls) == 2 * (WARM_UP + 1 + TURN + 1 + 2) and {shape for _, shape, _ in calls} == {(1, 2)}
    last = [(name, (1, 2), pose) for name in ("a", "b") for pose in (0.0, 2.0, 4.0)]
    assert calls[-6:] == last, "poses 9, 10 and 11 of three, of which the first does not count"
    assert done == [10, 2] and {one.evaluations for one in times.values()} == {12}


def test_a_slow_way_takes_part_in_fewer_turns_and_is_warm_before_the_first():
    calls = []
    ways = {"slow": Way(calls.append, every=4), "other": Way(len)}
    times = time_single_poses(ways, np.zeros((1, 1)), 8 * TURN, lambda done: None)
    assert times["slow"].evaluations == 2 * TURN and len(calls) == WARM_UP + 2 * (TURN + 1)
    assert times["other"].evaluations == 8 * TURN


def test_turns_go_on_where_they_ended_and_warm_up_once():
    calls = []
    turns = Turns({"a": Way(lambda pose: calls.append(float(pose[0, 0])))}, np.arange(100.0)[:, None])
    turns.take(0, lambda done: None)
    turns.take(TURN, lambda done: None)
    turns.take(5, lambda done: None)
    turns.take(TURN + 2, lambda done: None)
    later = calls[WARM_UP:]
    assert len(later) == 27 + 4, "one before each of four turns does not count"
    assert [pose for k, pose in enumerate(later) if k not in (0, 11, 17, 28)] == [*range(27)]
    assert turns.times()["a"].evaluations == 27


def test_the_garbage_collector_rests_meanwhile_and_works_again_after_an_error():
    def fail(pose):
        assert not gc.isenabled()
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        time_single_poses({"a": Way(fail)}, np.zeros((1, 1)), 1, lambda done: None)
    assert gc.isenabled()


def test_a_way_that_waits_takes_as_long_as_it_waits():
    times = time_single_poses({"wait": Way(lambda pose: time.sleep(0.002))}, np.zeros((1, 1)), 5, lambda done: None)
    assert times["wait"].p05 >= 2.0


def test_times_are_summarised():
    even = summary([2.0] * 20)
    assert even == Times(2.0, 2.0, 2.0, 2.0, 20)
    wide = summary([1.0] * 17 + [9.0] * 3)
    assert wide.median == 1.0 and wide.p95 == 9.0 and wide.mean == pytest.approx(2.2)
