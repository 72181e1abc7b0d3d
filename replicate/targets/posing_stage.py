"""What Table 4 and Figure 11 end with: a stage that sees methods, IK networks and a character's drags."""

from collections.abc import Callable, Iterable, Sequence

from replicate.artefacts.plan import Plan, reference
from replicate.engine.stage import Stage
from replicate.inverse.configurations import files_of
from replicate.methods.method import Method
from replicate.methods.prediction import reading


def posing_stage(
    plan: Plan, name: str, function: Callable, settings: object, methods: Sequence[Method], inputs: Iterable[Stage]
) -> Stage:
    """Return a stage that poses a character by its drags; the code that its methods are read with counts as its own.

    function, settings: as for `Plan.stage`. inputs: what it needs; a stage that is named twice counts once.
    """
    readers = [source for method in methods for source in reading(method, plan.config).sources]
    functions = ", ".join(dict.fromkeys(map(reference, (function, *readers))))
    once = {stage.title: stage for stage in inputs}
    return plan.stage(name, functions, settings, *once.values(), files=files_of(plan.config.character))
