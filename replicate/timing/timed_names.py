"""What is timed, by the names that results have for it: methods, other ways to evaluate them, and what is none."""

from collections.abc import Iterable

from replicate.methods.method_registry import in_order, method_named

RIG, NODES, RIGID_STEP = "rig", "rig_nodes", "rigid_step"
PLAIN, JAX, FAST, HALF = "_plain", "_jax", "_fast", "_half"  # endings of a method's name: how it is evaluated
ONNX, ONNX_THREADS, ONNX_SPINNING = "_onnx", "_onnx_threads", "_onnx_spinning"
GPU, GRAPH = "_gpu", "_gpu_graph"
BACKENDS = {
    "": "the suite's",
    PLAIN: "plain",
    JAX: "JAX",
    ONNX: "ONNX Runtime",
    ONNX_THREADS: "ONNX, all threads",
    ONNX_SPINNING: "ONNX, spinning",
    FAST: "fast",
    HALF: "fast, 16 bits",
    GPU: "torch on a GPU",
    GRAPH: "CUDA graph",
}
THREADED = (ONNX_THREADS, ONNX_SPINNING)  # of them: those that are none on one core
ON_GPU = (GPU, GRAPH)  # those that a GPU runs, but for the rigid step
EXACT = (
    "",
    PLAIN,
    JAX,
    ONNX,
    *THREADED,
    FAST,
    *ON_GPU,
)  # those that give the method's own vertices, but for float32's rounding
RIGS = {NODES: "The rig, node by node", RIG: "The rig, compiled"}
PARTS = {RIGID_STEP: "Rigid step alone"}
CHANGE = "change_"  # how metrics begin that compare a run with the one before it


def parted(name: str) -> tuple[str, str]:
    """Return the method's name and the ending that says how it is evaluated, "" for none."""
    for ending in filter(None, BACKENDS):
        if name.endswith(ending):
            return name.removesuffix(ending), ending
    return name, ""


def label_of(name: str, marked: bool = False) -> str:
    """Return what tables call what is timed. marked: with the mark of a method's footnote."""
    own, ending = parted(name)
    known = RIGS | PARTS
    if ending:
        return f"{known.get(own) or method_named(own).label}, {BACKENDS[ending]}"
    return known.get(own) or (method_named(own).title if marked else method_named(own).label)


def in_table_order(present: Iterable[str]) -> list[str]:
    """Return names in the order of tables: the rig, each method with its other evaluations, the rigid step."""
    names = set(present)
    methods = in_order({parted(name)[0] for name in names} - {*RIGS, *PARTS})
    every = [own + ending for own in (*RIGS, *methods, *PARTS) for ending in BACKENDS]
    return [name for name in every if name in names]
