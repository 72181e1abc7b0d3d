"""A stage's progress: nothing for two seconds, then a bar on a terminal or a line every half minute."""

import io

import pytest

from replicate.engine import display
from replicate.engine.display import RunDisplay, StageDisplay, duration


class Screen(io.StringIO):
    def __init__(self, terminal):
        super().__init__()
        self.terminal = terminal

    def isatty(self):
        return self.terminal


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets."""
    now = [1000.0]
    monkeypatch.setattr(display.time, "monotonic", lambda: now[0])
    return now


def test_a_stage_of_under_two_seconds_says_nothing(clock):
    screen = Screen(terminal=False)
    stage_display = StageDisplay("coarse", 0, screen)
    for _ in range(10):
        clock[0] += 0.19
        stage_display.progress("training", 5, 10)
    stage_display.end("made")
    assert screen.getvalue() == ""


def test_lines_come_at_most_every_half_minute_with_the_time_that_is_left(clock):
    screen = Screen(terminal=False)
    stage_display = StageDisplay("coarse", 0, screen)
    for second in range(100):
        clock[0] += 1
        stage_display.progress("training", second, 1000)
    stage_display.end("made")
    lines = screen.getvalue().splitlines()
    assert lines[0] == "coarse: started" and lines[-1] == "coarse: made in 100 s"
    assert len(lines) == 2 + 3
    assert lines[1] == "coarse: training 31 of 1,000, about 16 min left"


def test_what_a_resumed_stage_had_done_before_does_not_flatter_its_time_left(clock):
    screen = Screen(terminal=False)
    stage_display = StageDisplay("coarse", 0, screen)
    for second in range(40):
        clock[0] += 1
        stage_display.progress("training", 900 + second, 1000)
    assert "training 931 of 1,000, about 69 s left" in screen.getvalue()


def test_a_terminal_gets_a_bar_with_the_stages_name(monkeypatch):
    monkeypatch.setattr(display, "DELAY_S", 0.0)
    screen = Screen(terminal=True)
    stage_display = StageDisplay("coarse", 0, screen)
    stage_display.progress("training", 1, 10)
    stage_display._bar.refresh()
    stage_display.end("made")
    assert "coarse: training" in screen.getvalue() and "/10" in screen.getvalue()
    assert "coarse: made in 0 s" in screen.getvalue()


def test_durations_are_words_that_fit_a_line():
    assert [duration(s) for s in (3.4, 119, 150, 7_300)] == ["3 s", "119 s", "2 min", "2 h 2 min"]


def test_a_run_is_one_line_every_half_minute_where_there_is_no_terminal(clock):
    screen = Screen(terminal=False)
    whole = RunDisplay(57, screen)
    for second in range(95):
        clock[0] += 1
        whole.show(second // 8, 3, 480.0 if second > 50 else None, 3)
    whole.end()
    assert screen.getvalue().splitlines() == [
        "3 of 57 artefacts, 3 under way",
        "7 of 57 artefacts, 3 under way, about 8 min left",
        "11 of 57 artefacts, 3 under way, about 8 min left",
    ]


def test_a_run_whose_time_is_up_says_so_and_no_longer_tells_the_same_rest_as_if_it_were_all(clock):
    screen = Screen(terminal=False)
    whole = RunDisplay(36, screen)
    for late, left_s in ((False, 39.0), (True, 39.0), (True, 0.0), (True, None)):
        clock[0] += 31
        whole.show(32, 1, left_s, 1, late)
    assert screen.getvalue().splitlines() == [
        "32 of 36 artefacts, 1 under way, about 39 s left",
        "32 of 36 artefacts, 1 under way, longer than expected; then about 39 s",
        "32 of 36 artefacts, 1 under way, longer than expected",
        "32 of 36 artefacts, 1 under way, longer than expected",
    ]


def test_what_a_stage_says_is_left_of_it_goes_by_with_the_time(clock):
    stage_display = StageDisplay("coarse", 0, Screen(terminal=False))
    assert stage_display.left_s is None
    stage_display.progress("training", 0, 10)
    clock[0] += 5
    stage_display.progress("training", 5, 10)
    assert stage_display.left_s == 5.0
    clock[0] += 3
    assert stage_display.left_s == 2.0, "though it has said nothing since"
    clock[0] += 3
    assert stage_display.left_s is None


def test_what_first_steps_wait_for_is_not_reckoned_for_all(clock):
    stage_display = StageDisplay("samples", 0, Screen(terminal=False))
    stage_display.progress("samples", 0, 1000)
    clock[0] += 40  # something is compiled
    stage_display.progress("samples", 10, 1000)
    assert stage_display.left_s is None
    clock[0] += 1
    stage_display.progress("samples", 30, 1000)
    assert stage_display.left_s == 48.5


def test_a_run_of_a_few_seconds_or_of_one_artefact_has_no_line_of_its_own(clock):
    for terminal, total, seconds in ((False, 57, 20), (True, 57, 1), (True, 1, 100), (False, 1, 100)):
        screen = Screen(terminal)
        whole = RunDisplay(total, screen)
        for _ in range(seconds):
            clock[0] += 1
            whole.show(0, 1, None, 1)
        whole.end()
        assert screen.getvalue() == "", (terminal, total)


def test_on_a_terminal_the_run_stands_below_the_bars_of_its_stages(clock):
    screen = Screen(terminal=True)
    whole = RunDisplay(57, screen)
    clock[0] += 3
    whole.show(12, 2, 480.0, 2)
    assert "\n\n\r12 of 57 artefacts, 2 under way, about 8 min left |" in screen.getvalue()
    before = len(screen.getvalue())
    whole.show(13, 1, 0.0, 1)
    assert "\n\r13 of 57 artefacts, 1 under way |" in screen.getvalue()[before:]
    assert "\n\n\r13" not in screen.getvalue()[before:]
    whole.end()
    assert screen.getvalue().endswith("\r"), "what is printed next begins at the left"
