"""Figures that move: stills for everybody, and sliders that draw again."""

import ipywidgets
from IPython.utils.capture import capture_output
from matplotlib.figure import Figure

from course.sliders import move
from replicate.drawing.panels import Words


def test_stills_stand_beside_each_other_and_a_slider_draws_again(monkeypatch):
    drawn, boxes = [], []

    def draw(height):
        drawn.append(height)
        figure = Figure((2, 1), dpi=50)
        figure.add_subplot().plot([0, height])
        return figure

    made = ipywidgets.VBox
    monkeypatch.setattr(ipywidgets, "VBox", lambda children: boxes.append(made(children)) or boxes[0])
    with capture_output():
        move(draw, {"height": (0, 3, 1)}, [{"height": 0.5}, {"height": 2}], Words("alt", "Two lines."))
    assert drawn == [0.5, 2, 1]
    slider, picture = boxes[0].children
    assert (slider.style.description_width, picture.layout.align_self) == ("initial", "flex-start")  # not cut
    before = bytes(picture.value)
    slider.value = 3
    assert drawn[-1] == 3 and before != picture.value and bytes(picture.value).startswith(b"\x89PNG")
