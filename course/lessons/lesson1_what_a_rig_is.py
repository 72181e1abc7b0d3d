# %% [markdown]
# # Lesson 1: What a rig is
#
# **60 minutes. You need** linear algebra and NumPy. **Afterwards you can**
#
# - read a face rig as a chain of deformers that share one state,
# - write two of its nodes, a soft limit and a jaw, so that they are silent at rest,
# - measure where a face stops being linear in its controls, and tell a curve from a kink.
#
# **The question: what happens between a slider and a face?** The whole course is about replacing that something by
# something faster, as Bailey and others did in *Fast and Deep Facial Deformations* (2020), which we call *the paper*.
# So let us see first what they replaced.

# %%
import numpy as np

from replicate.methods.artefacts import rig_of

# %%
rig = rig_of("teen")  # the first time it is built: 15 s to 2 min

# %%
from course.checks.lesson1 import check_bend, check_soft_limit, check_turn_jaw
from course.lesson1 import bend_chart, chain_picture, heat_row, portrait, posed, student_nodes

# %%
from replicate.report.notebooks import show
from replicate.rig_study.tour import BROWS_UP, pose_params

POSE = {**BROWS_UP, "jaw_open": 0.75, "smile_*": 0.6, "nose_wrinkle_*": 0.5, "squint_*": 0.5}
NODES = ("pose_curves", "skull_slide", "jaw", "lip_contact", "flesh", "wrinkles", "teeth")
show(*chain_picture(rig, pose_params(rig, POSE), NODES))

# %% [markdown]
# ## A function with many inputs
#
# A rig is a function from *controls* (the animator's sliders) to vertices,
#
# $$\mathbf V = r(\mathbf p), \qquad \mathbf p \in \mathbb R^m, \quad \mathbf V \in \mathbb R^{n \times 3}\ \text{mm},$$
#
# and $r$ of the default pose is the neutral face $\mathbf V^0$. The offsets from it are $\boldsymbol\Delta = \mathbf
# V - \mathbf V^0$. Everything in this course is about $\boldsymbol\Delta$.

# %%
neutral = rig.mesh.neutral
print(f"{len(rig.controls)} controls, {len(neutral):,} vertices, {len(rig.mesh.faces):,} triangles")
print("every 30th control:", ", ".join(control.name for control in rig.controls[::30]))
print("the chain:", " → ".join(node.name for node in rig.nodes))

# %% [markdown]
# Inside, it is no one formula but a **chain of deformers** (*nodes*), $r = d_{14} \circ \cdots \circ d_2 \circ d_1$.
# All share one *state*: the raw controls `p`, the limited controls `u`, the positions `x`, and what later nodes need.
# Run the chain and you have the rig:
#
# ```python
# state = {"p": params, "u": params - default, "x": neutral}
# for node in nodes:
#     state = node.function(constants, state)
# vertices = state["x"]
# ```
#
# **Look** at the first picture again. Which node makes the smile? Which one opens the mouth? The lower teeth stay up
# until the last node. What would you see if *wrinkles* ran first?
# <details><summary>Answer</summary>
#
# *Pose curves* makes the smile, *jaw* opens the mouth, and after it *lip contact* and *flesh* put lips and skin right.
# If *wrinkles* ran first, you would see a smooth forehead: the node measures how much skin is compressed, and nothing
# is yet.
# </details>
#
# You will now write two nodes of this chain, and put them into the teen.

# %% [markdown]
# ## The first node: soft limits
#
# An animator's slider ends at 1. The paper's training poses don't: its Eq. 5 multiplies controls by random factors up
# to 3. A rig has to bear that, so the first node bends each control towards a limit. With $z = p - p_\text{default}$,
#
# $$u = \frac{z}{\left(1 + (z/c)^6\right)^{1/6}}, \qquad
# c = \begin{cases} c_\text{below} & z < 0 \\ c_\text{above} & z \ge 0 \end{cases}$$
#
# Every deformer has to be **silent at rest**: nothing in, nothing out. Here $z = 0$ gives $u = 0$, and near 0 the node
# changes next to nothing: the share that it takes away grows with the sixth power of $z/c$. With $c = 0.156$, a control
# at −0.1 loses 1 %.


# %% exercise="soft_limit"
def soft_limit(z, below, above):
    """Return the controls u, bent towards their limits by the formula above.

    z: (m,) controls without their defaults. below, above: (m,) the limits c on each side, both positive numbers.
    """
    ### BEGIN SOLUTION
    c = np.where(z < 0, below, above)
    return z / (1 + (z / c) ** 6) ** (1 / 6)
    ### END SOLUTION


# %% check="soft_limit" points=2
check_soft_limit(soft_limit, rig)

# %% [markdown]
# **Try.** The slider `jaw_open` begins at 0, with the lips closed. What is $u$ of it at $z = -1$? Its limits are these:
#
# ```python
# k = [control.name for control in rig.controls].index("jaw_open")
# below, above = (rig.face.constants["limits"][side][k : k + 1] for side in ("below", "above"))
# soft_limit(np.array([-1.0]), below, above)
# ```
#
# You get a little less than 0: pressed lips. Why do riggers leave a control some slack on its closed side?
# <details><summary>Answer</summary>
#
# Lips are soft: closing goes on for a little after they touch, as in an *m* or in anger. And what sets a control from
# outside, a curve between two keys or a solver, overshoots: a hard end would stop it with a visible jolt.
# </details>

# %% [markdown]
# ## The jaw
#
# The jaw turns about its hinge. Its motion is a *rotation vector* $\mathbf r$: its direction is the axis, its length
# the angle in radians. Skin hangs between skull and jaw, so each vertex has a **weight** $w_v \in [0, 1]$ and takes
# its share:
#
# $$\mathbf x_v \leftarrow R(w_v \mathbf r)\,(\mathbf x_v - \mathbf o) + \mathbf o + w_v \mathbf t$$
#
# with the pivot $\mathbf o$ and a glide $\mathbf t$, in mm. Rodrigues says how a vector $\mathbf a$ turns by $\mathbf
# q = w_v \mathbf r$, of length $\varphi$:
#
# $$R(\mathbf q)\,\mathbf a = \mathbf a + \frac{\sin\varphi}{\varphi}\; \mathbf q \times \mathbf a
# + \frac{1 - \cos\varphi}{\varphi^2}\; \mathbf q \times (\mathbf q \times \mathbf a)$$
#
# Both quotients have limits at rest ($\varphi = 0$), 1 and ½. A computer doesn't know that. Two ways out: NumPy's
# `np.sinc(z)` is $\sin(\pi z) / (\pi z)$ and knows its limit, and $1 - \cos\varphi = 2 \sin^2(\varphi / 2)$. Or let
# `scipy.spatial.transform.Rotation.from_rotvec` do it.


# %% exercise="turn_jaw"
def turn_jaw(x, weight, pivot, rotation, translation):
    """Return the positions x after the jaw's motion, each vertex by its weight.

    x: (n, 3) mm. weight: (n,), 0 to 1. pivot: (3,) mm. rotation: (3,) rotation vector in radians, of weight 1.
    translation: (3,) mm, of weight 1. The argument x must not change.
    """
    ### BEGIN SOLUTION
    turn = weight[:, None] * rotation
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    arm = x - pivot
    once = np.cross(turn, arm)
    sine, versine = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi)) ** 2 / 2
    return pivot + arm + sine * once + versine * np.cross(turn, once) + weight[:, None] * translation
    ### END SOLUTION


# %% check="turn_jaw" points=3
check_turn_jaw(turn_jaw, rig)

# %% [markdown]
# Now **your two nodes run inside the teen**, the other twelve are the rig's. The last still asks for three times a
# fully open jaw, as Eq. 5 may.

# %%
from course.sliders import move
from replicate.drawing.panels import Words, panel_grid

mine = student_nodes(soft_limit, turn_jaw)


def draw(jaw_open, smile):
    params = pose_params(rig, {"jaw_open": jaw_open, "smile_*": smile})
    return panel_grid([[portrait(rig, params, posed(rig, params, mine))]], [f"jaw {jaw_open:g}, smile {smile:g}"])


# %%
STILLS = [{"jaw_open": jaw, "smile": smile} for jaw, smile in ((0.4, 0.0), (1.0, 0.8), (3.0, 0.8))]
words = Words("The teen with an open jaw, three times.", "The teen with your soft limit and your jaw in its chain.")
move(draw, {"jaw_open": (0, 3, 0.4), "smile": (0, 1, 0)}, STILLS, words)

# %% [markdown]
# **Try.** Switch the limit off, with `mine["limit"] = lambda constants, state: state`, and draw jaw 2 and 3: by the
# slider, or by `draw(2, 0.8)` in a cell of its own. What gives way first? (`mine = student_nodes(soft_limit, turn_jaw)`
# switches it on again: do that before you go on.)
#
# ## Where it bends
#
# Is the jaw linear in its control? Near rest, yes: a small turn moves a vertex along a straight line, its
# **tangent**. A large one goes along an arc. Let $\mathbf d$ be a direction in the space of controls, such as "open
# the jaw". What the tangent at $\mathbf p_0$ misses at the size $t$ is
#
# $$\mathbf b(t) = r(\mathbf p_0 + t\,\mathbf d) - \left(r(\mathbf p_0) + t\,\dot{\mathbf V}\right), \qquad
# \dot{\mathbf V} \approx \frac{r(\mathbf p_0 + h\,\mathbf d) - r(\mathbf p_0 - h\,\mathbf d)}{2h}, \quad h = 0.01.$$
#
# How fast it grows with $t$ tells a curve from a kink, as you will see in a chart.


# %% exercise="bend"
def bend(face, rest, direction, t):
    """Return what the tangent at `rest` misses of a face at rest + t · direction: b(t), (n, 3) mm.

    face: a function, controls (m,) → vertices (n, 3) mm, in single precision. rest, direction: (m,). t: a number.
    """
    ### BEGIN SOLUTION
    h = 0.01
    velocity = (face(rest + h * direction) - face(rest - h * direction)) / (2 * h)
    return face(rest + t * direction) - (face(rest) + t * velocity)
    ### END SOLUTION


# %% check="bend" points=2
check_bend(bend, rig)

# %% [markdown]
# Your function can now interrogate the rig. `face` is the teen with your nodes; `loose` is the same without the
# contact of the lips, which are closed at rest.


# %%
def face(params):
    return posed(rig, params, mine)


def loose(params):
    return posed(rig, params, mine | {"lip_contact": lambda constants, state: state})


def mean_bends(function, amounts):
    direction = pose_params(rig, amounts)
    return [float(np.linalg.norm(bend(function, rig.default, direction, t), axis=1).mean()) for t in SIZES]


# %%
SIZES = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1)  # further down, single precision is seen
curves = {
    "jaw": mean_bends(face, {"jaw_open": 1}),
    "jaw, no lip contact": mean_bends(loose, {"jaw_open": 1}),
    "smile": mean_bends(face, {"smile_*": 1}),
    "brows up": mean_bends(face, BROWS_UP),
}
show(*bend_chart(SIZES, curves))

# %% [markdown]
# Read the chart from right to left: each step halves $t$. A *smooth* function leaves a quarter of $\mathbf b$ each
# time (Taylor), as the dotted line does. At a *kink*, where no tangent fits, half of it remains, as on the dashed line.
# If the kink is rounded, or lies a little beside $\mathbf p_0$, you see more than a quarter for $t$ beyond it, and a
# sudden drop at its place.
#
# **Look.** Which of the curves leave a quarter each time? Where do the others leave more, and what happens on the face
# there?
# <details><summary>Answer</summary>
#
# Without contact the jaw is a curve as Taylor has it: a quarter each time. So is the smile. With contact the jaw has a
# **rounded kink** at $t$ of about 0.02 to 0.1: at first the closed lips move as if nothing were between them, then they
# part, and from there on each is on its own. Above that place 0.35 to 0.42 remains each time; below it, the bend leaves
# less than Taylor's quarter, 0.20 and 0.12, since the kink drops out. Raised brows start as a curve, too; near
# $t = 1/16$ the forehead begins to fold, and the folds deepen less and less.
# </details>
#
# ## Two sliders at once
#
# A linear function has a second property: two actions add up. The **surplus** of two poses $\mathbf a$ and $\mathbf
# b$ is what doesn't:
#
# $$r(\mathbf p_0 + \mathbf a + \mathbf b) - r(\mathbf p_0 + \mathbf a) - r(\mathbf p_0 + \mathbf b) + r(\mathbf p_0)$$
#
# In part riggers make it on purpose: a *corrective* shape is multiplied by both controls, since a laugh is rounder
# than a smile plus an open mouth.

# %%
# the teen's defaults are all 0, so p0 + a is a itself
rest, a, b = rig.default, pose_params(rig, {"jaw_open": 0.8}), pose_params(rig, {"smile_*": 0.8})
surplus = face(a + b) - face(a) - face(b) + face(rest)
jaw, brows = pose_params(rig, {"jaw_open": 1}), pose_params(rig, BROWS_UP)
views = {
    "jaw, no contact: bend": (loose(rest + jaw), bend(loose, rest, jaw, 1)),
    "brows up: bend": (face(rest + brows), bend(face, rest, brows, 1)),
    "jaw + smile: surplus": (face(a + b), surplus),
}
show(*heat_row(rig, views))

# %% [markdown]
# **Look.** Each picture shows another reason why the face is not linear. Which? (The jaw is drawn `loose`: with
# contact, the lips alone would fill the scale.)
# <details><summary>Answer</summary>
#
# The jaw turns, so its points go along an arc. The two patches over the raised brows are there without the node
# *wrinkles*, too: skin slides along the curved skull, and soft limits do their part; only the lines on the forehead are
# folds. On the right, two controls are multiplied.
# </details>
#
# Lesson 2 asks how much of all that a straight line can still catch.

# %% [markdown] think="order"
# **Think.** Wrinkles run after jaw, lids and flesh, but before the node *head shape*, which squashes and stretches
# the whole head. What would go wrong if they ran earlier, and what if they ran last?
#
# <details><summary>Answer</summary>
#
# A wrinkle measures how much skin is compressed across its folds, whatever compressed it. If the node ran before the
# jaw or the flesh, it would not see what these compress: a squint by the lids would leave the crow's feet smooth. If
# it ran last, it would see the squash of the whole head as compression, and a head that an animator makes shorter for
# comic effect would fold all over. Deformers don't commute: their order is a decision of the rigger, and part of the
# rig. A network that approximates the rig never sees the order; it has to learn its result.
# </details>

# %% [markdown]
# ## What to take along
#
# A rig is a chain of small deformers. Each is silent at rest and simple by itself; the chain curves, folds and has
# kinks, and its controls interact. All of it can be run, differentiated and measured. In lesson 2 we forget the chain
# and look only at its results: a few hundred poses. How far do a straight line and a handful of shapes get?

# %% [markdown]
# ## Go further
#
# - S. Bailey, D. Omens, P. DiLorenzo, J. O'Brien, *Fast and Deep Facial Deformations*, ACM Transactions on Graphics
#   (SIGGRAPH) 2020: the paper of this course.
# - J. P. Lewis, K. Anjyo, T. Rhee, M. Zhang, F. Pighin, Z. Deng, *Practice and Theory of Blendshape Facial Models*,
#   Eurographics STAR 2014: what sculpted shapes, in-betweens and correctives are; read §3 before lesson 2.
# - J. Mancewicz, M. Derksen, H. Rijpkema, C. Wilson, *Delta Mush: Smoothing Deformations While Preserving Detail*,
#   DigiPro 2014: the node *flesh*, in two pages.
# - M. Watt and others, *LibEE: A Multithreaded Dependency Graph for Character Animation*, DigiPro 2012: how a studio
#   runs chains of thousands of nodes.
# - The suite's own [tour of the rig](../../notebooks/rig_tour.ipynb): every layer off and on, wrinkles in detail,
#   exact derivatives.
