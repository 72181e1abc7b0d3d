"""What is timed, by the names that results have for it: methods, and what is none."""

from collections.abc import Iterable

from replicate.methods.method_registry import in_order, method_named

RIG, NODES, RIGID_STEP = "rig", "rig_nodes", "rigid_step"
PLAIN = "_plain"  # the ending of a method's name where its networks are evaluated the plain way
RIGS = {NODES: "The rig, node by node", RIG: "The rig, compiled"}
PARTS = {RIGID_STEP: "Rigid step alone"}


def label_of(name: str, marked: bool = False) -> str:
    """Return what tables call what is timed. marked: with the mark of a method's footnote."""
    if name in (known := RIGS | PARTS):
        return known[name]
    if name.endswith(PLAIN):
        return f"{method_named(name.removesuffix(PLAIN)).label}, plain"
    return method_named(name).title if marked else method_named(name).label


def in_table_order(present: Iterable[str]) -> list[str]:
    """Return names in the order of tables: the rig, each method with its plain evaluation, the rigid step."""
    names = set(present)
    methods = in_order({name for name in names if name not in {*RIGS, *PARTS} and not name.endswith(PLAIN)})
    both = [name for method in methods for name in (method, method + PLAIN) if name in names]
    return [*(name for name in RIGS if name in names), *both, *(name for name in PARTS if name in names)]
