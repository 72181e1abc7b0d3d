"""Training curves come back to the last bit; a broken log is named with its line."""

import pytest
from sample_rows import CURVE

from replicate.base.exceptions import InputError
from replicate.report.results import read_curves, read_log, write_curves


def test_curves_are_read_back_to_the_last_bit(tmp_path):
    curves = {("teen", "dense"): CURVE, ("teen", "coarse"): CURVE[:1]}
    write_curves(tmp_path / "c.csv", curves)
    assert read_curves(tmp_path / "c.csv") == curves
    assert (tmp_path / "c.csv").read_text().splitlines()[1] == "teen,coarse,100,3.5,1.25,4.5"


def test_a_training_log_is_read_and_a_broken_one_is_named_with_its_line(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("step,loss,mm,degrees\n100,3.5,1.25,4.5\n")
    assert read_log(path) == CURVE[:1]
    path.write_text("step,loss,mm,degrees\n100,3.5,x,4.5\n")
    with pytest.raises(InputError, match="line 2: mm: expected a number, got 'x'"):
        read_log(path)
    path.write_text("step,loss\n")
    with pytest.raises(InputError, match=r"line 1: expected the header .*, got 'step,loss'"):
        read_log(path)
    with pytest.raises(InputError, match="make table2"):
        read_curves(tmp_path / "missing.csv")
