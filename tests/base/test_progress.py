"""Progress goes to whoever draws it, and nowhere when nobody does."""

from replicate.base import progress as module
from replicate.base.progress import progress, report_to


def test_without_a_terminal_nothing_is_drawn(capfd):
    with progress(10, "counting") as bar:
        bar.update(3)
    assert bar.steps == 3 and capfd.readouterr() == ("", "")


def test_a_worker_reports_where_it_began_and_where_it_ended():
    reports = []
    report_to(lambda *report: reports.append(report))
    try:
        with progress(100, "training", initial=40) as bar:
            for _ in range(60):
                bar.update()
    finally:
        report_to(None)
    assert reports[0] == ("training", 40, 100) and reports[-1] == ("training", 100, 100)


def test_reports_are_no_flood():
    reports = []
    report_to(lambda *report: reports.append(report))
    try:
        with progress(100_000, "training") as bar:
            for _ in range(100_000):
                bar.update()
    finally:
        report_to(None)
    assert len(reports) < 100 and module._reporter is None
