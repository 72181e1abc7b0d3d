"""What lesson 1 draws with: the teen's rig run node by node, with students' functions in the place of the rig's own."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Float

from data_recipes.deformers import node_chain
from data_recipes.deformers.face import jaw_motion
from data_recipes.deformers.node_chain import FaceConstants, Node, State
from data_recipes.face_rig import FaceRig
from data_recipes.rig import Prop
from replicate.drawing.characters import BACKGROUND
from replicate.drawing.light import PORTRAIT, RAKING
from replicate.drawing.panels import Words, error_scale, panel_grid, tidy
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.rig_study.tour import scale_for

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

Nodes = Mapping[str, Callable[[FaceConstants, State], State]]  # by name: what runs in the place of a rig's node


@cache
def compiled(node: Node) -> Callable:
    """Return a node's function, compiled by JAX."""
    return jax.jit(node.function)


def steps(rig: FaceRig, params: Float[np.ndarray, " m"], mine: Nodes | None = None) -> Iterator[tuple[str, np.ndarray]]:
    """Run node after node; yield each one's name and the vertices after it, (n, 3) mm.

    mine: nodes that run in the place of the rig's own.
    """
    constants = rig.face.on_device
    state = node_chain.start(constants, np.asarray(params, np.float32)[None])
    for node in rig.nodes:
        function = (mine or {}).get(node.name) or compiled(node)
        state = function({name: constants[name] for name in node.reads}, state)
        yield node.name, np.asarray(state["x"])[0].T


def posed(rig: FaceRig, params: Float[np.ndarray, " m"], mine: Nodes | None = None) -> Float[np.ndarray, "n 3"]:
    """Return the rig's vertices in a pose, mm; mine: as for `steps`."""
    *_, (_, vertices) = steps(rig, params, mine)
    return vertices


def student_nodes(soft_limit: Callable, turn_jaw: Callable) -> Nodes:
    """Return the nodes "limit" and "jaw" made of the lesson's two exercises."""

    def limit(constants: FaceConstants, state: State) -> State:
        limits = {name: np.asarray(values) for name, values in constants["limits"].items()}
        x = np.asarray(state["p"])[0] - limits["default"]
        return state | {"u": np.asarray(soft_limit(x, limits["below"], limits["above"]), np.float32)[None]}

    def jaw(constants: FaceConstants, state: State) -> State:
        motion, own = jaw_motion(constants, state["u"]), constants["jaw"]
        x = np.array(state["x"][0].T)
        moved = np.asarray(own["support"])
        turn, shift = np.asarray(motion.rotation)[0], np.asarray(motion.translation)[0]
        x[moved] = turn_jaw(x[moved], np.asarray(own["weight"]), np.asarray(own["pivot"]), turn, shift)
        return state | {"jaw": motion, "x": np.ascontiguousarray(x.T)[None]}

    return {"limit": limit, "jaw": jaw}


def portrait(
    rig: FaceRig, params: Float[np.ndarray, " m"], vertices: Float[np.ndarray, "n 3"], width: int = 400
) -> np.ndarray:
    """Return a picture of a face with its paint, hair and eyes; width: pixels."""
    view = camera_for("three_quarter", rig.mesh.neutral)
    surfaces = [
        Surface(vertices, rig.mesh.faces, paint=rig.paint),
        *prop_surfaces(props_of(rig, params, vertices), view),
    ]
    return render(surfaces, view, width, round(1.15 * width), BACKGROUND, PORTRAIT)


def props_of(rig: FaceRig, params: Float[np.ndarray, " m"], vertices: Float[np.ndarray, "n 3"]) -> list[Prop]:
    """Return a rig's eyes, hair and other props in a pose whose vertices are known."""
    columns = {control.name: k for k, control in enumerate(rig.controls)}
    pose, face = np.asarray(params, np.float32)[None], rig.face
    return face.chain.pose_props(face.props, face.constants, columns, pose, vertices, rig.mesh.neutral)


def chain_picture(
    rig: FaceRig, params: Float[np.ndarray, " m"], shown: Sequence[str], width: int = 225
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the neutral face, and a pose after some of the nodes, in two rows; width: pixels."""
    view, height = camera_for("front", rig.mesh.neutral), round(1.1 * width)
    faces = {"neutral": rig.mesh.neutral} | {name: x for name, x in steps(rig, params) if name in shown}
    names = ["neutral", *(f"after {name.replace('_', ' ')}" for name in shown)]
    pictures = [render(clay_face(rig, x), view, width, height, studio=RAKING) for x in faces.values()]
    half = (len(pictures) + 1) // 2
    figure = panel_grid([pictures[:half], pictures[half:]], [names[:half], names[half:]])
    return figure, Words(
        f"Clay renders of {rig.name}: the neutral face, and one pose after {', '.join(shown)}.",
        "One pose of the teen on its way through the chain: the neutral face, and what it looks like after some of the "
        "fourteen nodes. The eyes stay as they are at rest.",
    )


def clay_face(rig: FaceRig, vertices: Float[np.ndarray, "n 3"]) -> list[Surface]:
    """Return a face of clay with eyeballs at rest."""
    props = rig.face.props
    eyes = [(p.name, p.vertices, p.faces, p.colours) for p in props if p.name.startswith("eye_")]
    return [Surface(np.asarray(vertices, np.float32), rig.mesh.faces), *prop_surfaces(eyes)]


def bend_chart(
    sizes: Sequence[float], curves: Mapping[str, Sequence[float]]
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): how far a face is from its tangent, mm, at some sizes of a control, for each curve."""
    from matplotlib.figure import Figure

    figure = Figure((9.6, 4.6), dpi=100, layout="constrained")
    axes = figure.add_subplot()
    for (name, curve), marker in zip(curves.items(), "osD^v", strict=False):
        axes.loglog(sizes, curve, marker=marker, label=name)
    top = 1.5 * max(max(curve) for curve in curves.values())
    for power, style, words in ((1, "--", "a half each time: a kink"), (2, ":", "a quarter each time: a curve")):
        line = [top * (size / sizes[-1]) ** power for size in sizes]
        axes.loglog(sizes, line, color="#777777", linestyle=style, linewidth=1.2, label=words)
    axes.set(xlabel="size t of the control", ylabel="distance from the tangent, mm (mean)")
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5), fontsize=11)
    tidy(axes)
    error_scale(axes, "y")
    axes.minorticks_off()
    axes.set_xticks(sizes, [str(Fraction(size)) for size in sizes])
    ends = "; ".join(f"{name} {curve[0]:.2g} to {curve[-1]:.2g} mm" for name, curve in curves.items())
    return figure, Words(
        f"Curves of the mean distance from the tangent against the size of a control, both logarithmic: {ends}.",
        f"How far the face is from its tangent at rest, from t = {Fraction(sizes[0])} to {sizes[-1]}: "
        f"{ends}. Grey: what is left each time that t is halved.",
    )


HEAT = "YlOrRd"  # light at 0, so that the shape of the face is seen


def heat_row(
    rig: FaceRig, faces: Mapping[str, tuple[np.ndarray, np.ndarray]], width: int = 300
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): faces beside one another with vectors (n, 3) in mm on them, as colours by length.

    faces: by title, the vertices and the vectors. width: of a picture, pixels.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable

    view, pictures, titles, most = camera_for("front", rig.mesh.neutral), [], [], []
    for title, (vertices, vectors) in faces.items():
        length = np.linalg.norm(vectors, axis=1)
        limit = scale_for(length)
        paint = np.rint(255 * colormaps[HEAT](np.clip(length / limit, 0, 1))[:, :3]).astype(np.uint8)
        surface = Surface(np.asarray(vertices, np.float32), rig.mesh.faces, paint=paint)
        pictures.append(render([surface], view, width, round(1.1 * width), studio=RAKING))
        titles.append(f"{title}, 0–{limit:g} mm")
        most.append(f"{title} {length.max():.1f} mm")

    def draw_bar(figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes") -> None:
        bar = figure.colorbar(ScalarMappable(cmap=HEAT), cax=axes)
        bar.set_ticks([0, 1], labels=["0", "end of scale"])
        bar.ax.tick_params(labelrotation=90)

    return panel_grid([pictures], titles, bar=(0, 0, draw_bar)), Words(
        f"Faces coloured by how far each vertex is from what a linear face would do; at most: {', '.join(most)}.",
        f"What a face that is linear in its controls would miss, each on its own scale; at most: {', '.join(most)}.",
    )
