"""Figure 9: forehead wrinkles of several methods, close up."""

import argparse
from collections.abc import Sequence

from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.methods.method_registry import methods as all_methods
from replicate.report.publication import publish_pictures
from replicate.targets.figure_methods import FIGURE09
from replicate.targets.options import OF_A_RUN
from replicate.targets.running import make
from replicate.targets.shown_records import input_stages, load_records, picture_settings

ABOUT = "forehead wrinkles, close up: the truth, and what several methods keep of it"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's figure; those of the methods, the slow ones, come first."""
    registry = all_methods(plan.config)
    shown = [registry[name] for name in FIGURE09 if name in registry]
    inputs = input_stages(plan, shown, typical=False)
    figure = plan.stage("figure09", draw, picture_settings(plan, shown), *inputs)
    return [*(stage for method in shown for stage in method.stages(plan)), *inputs, figure]


def draw(context: StageContext) -> None:
    """Draw the forehead as it is and as several methods have it (Fig. 9)."""
    from replicate.drawing.face_sheet import LARGEST_BYTES
    from replicate.drawing.panels import save_figure
    from replicate.report.pose_record import FOLDED
    from replicate.targets.figure09.forehead_wrinkles import figure09

    record = load_records(context.config.character, context.inputs)[FOLDED]
    figure, words = figure09(record)
    save_figure(figure, context.out / f"figure09_{record.character}.png", words, LARGEST_BYTES)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character and publish it."""
    publish_pictures("figure09", make(options, stages), notebook=False)
