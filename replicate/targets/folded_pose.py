"""Figures of one test pose, the one whose forehead folds most: as it is, and as a few methods have it."""

from collections.abc import Callable, Sequence

from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method_registry import methods as all_methods
from replicate.report.pose_record import FOLDED, PoseRecord
from replicate.targets.shown_records import load_records, picture_settings, record_stages


def folded_pose_stages(
    plan: Plan, figure: str, names: Sequence[str], draw: Callable[[StageContext], None]
) -> list[Stage]:
    """Return the stages of one character's figure; those of the methods, the slow ones, come first.

    figure: the name of the last stage. names: of the methods; those that the registry lacks are left out. draw: the
    last stage's function.
    """
    registry = all_methods(plan.config)
    shown = [registry[name] for name in names if name in registry]
    return record_stages(plan, shown, figure, draw, picture_settings(plan, shown), typical=False)


def save_folded_pose(context: StageContext, figure_of: Callable[[PoseRecord], tuple]) -> None:
    """Draw the pose of a stage's character and save the figure, which is called as the stage, and its numbers.

    figure_of: the pose → (figure, words), as `save_figure` takes them.
    """
    from replicate.drawing.face_sheet import LARGEST_BYTES
    from replicate.drawing.panels import save_figure
    from replicate.targets.pose_numbers import save_rows

    records = load_records(context.config.character, context.inputs)
    figure, words = figure_of(records[FOLDED])
    save_figure(figure, context.out / f"{context.name}_{context.config.character}.png", words, LARGEST_BYTES)
    save_rows(context, records)
