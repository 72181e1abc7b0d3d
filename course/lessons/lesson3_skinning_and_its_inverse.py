# %% [markdown]
# # Lesson 3: Skinning and its inverse
#
# **75 minutes. You need** lessons 1 and 2, least squares and the singular value decomposition. **Afterwards you can**
#
# - say how a few rigid bones move a mesh, and where that must fail,
# - find the rotation that best aligns two point sets, and never get a mirror image instead,
# - find bones *and* weights from nothing but example poses, by two steps that take turns.
#
# **The question: how much of a face is a handful of rigid bones?** Below is a part of the answer, which you can find
# yourself by the end: six of sixteen bones of the teen. Nobody painted any of it.

# %%
import numpy as np

# %%
from course import lesson3
from course.checks.lesson3 import check_align, check_alternate, check_weights

# %%
from replicate.methods.artefacts import rig_of

rig = rig_of("teen")  # the first time it is built: 15 s to 2 min
face = lesson3.examples(rig)
print(f"{len(face.training)} poses to fit to, of {len(face.rest):,} vertices each, in mm")

# %% [markdown]
# 16 bones, found from every eighth vertex or so: that is enough to know how bones move, and takes seconds. You will
# find yours from the same vertices.

# %%
from replicate.report.notebooks import show

BONES = 16
few = np.sort(np.random.default_rng(3).choice(len(face.rest), 1500, replace=False))
suites, suites_mm = lesson3.suites_bones(face, few, BONES)  # their weights, and an error for later
w = lesson3.spread(suites, few, face)  # weights (n, 16) of all vertices
show(*lesson3.one_by_one(rig.mesh, w, 6))

# %% [markdown]
# ## Forward: linear blend skinning
#
# Every bone $b$ has a rigid motion, a rotation $\mathbf R_b$ and a translation $\mathbf t_b$. Vertex $i$ asks all
# bones where they would take it, and takes the mean of the answers by its weights:
#
# $$\mathbf v_i = \sum_{b=1}^{B} w_{ib}\,(\mathbf v_i^0\, \mathbf R_b + \mathbf t_b), \qquad
# w_{ib} \ge 0, \qquad \sum_b w_{ib} = 1.$$
#
# Points are **rows** in this course, as in the suite: $\mathbf v\,\mathbf R$, not $\mathbf R\,\mathbf v$. Weights
# belong to the character, motions to a pose. Games store at most 4 bones a vertex, and pose thousands of
# characters with this one formula.
#
# In NumPy that is two lines. Read them until you know what each index stands for; you will turn them round below.


# %%
def skin(rest, R, t, w):
    """Return the vertices of one pose, (n, 3) mm, by the formula above.

    rest: (n, 3) mm, the vertices at rest. w: (n, B) weights.
    R: (B, 3, 3) rotations, t: (B, 3) mm, translations.
    """
    by_each_bone = np.einsum("ni,bij->nbj", rest, R) + t
    return np.einsum("nb,nbj->nj", w, by_each_bone)


# %% [markdown]
# Here it moves a tube with two bones: the left one stays, the right one turns about the tube's axis and bends. In the
# middle, weights go from one bone to the other in a straight line.
#
# **Guess** first: what is left of the tube's radius, halfway, at a twist of 90 degrees? Then look.

# %%
from course.sliders import move
from replicate.drawing.panels import Words

move(
    lambda twist, bend: lesson3.draw_tube(skin, twist, bend),
    {"twist": (0, 180, 90), "bend": (0, 120, 0)},
    [{"twist": 0, "bend": 0}, {"twist": 120, "bend": 0}, {"twist": 175, "bend": 0}],
    Words(
        "A checkered tube; twisted by 120 degrees it has a waist, by 175 degrees it shrinks to a point.",
        "The same two bones and weights, more and more twist. Animators call the last one a candy wrapper.",
    ),
)

# %% [markdown] think="mean of rotations"
# **Think.** Both bones are rigid, the weights are smooth, and yet the tube collapses. Where does the volume go?
# <details><summary>Answer</summary>
#
# A blend of the answers is an answer of the blended matrix: $\sum_b w_b (\mathbf v \mathbf R_b + \mathbf t_b) = \mathbf
# v\,(\sum_b w_b \mathbf R_b) + \ldots$ And **a mean of rotations is not a rotation**. Halfway between 0° and 180° it is
# $\tfrac{1}{2}(\mathbf I + \mathbf R)$, which sends everything at right angles to the axis to zero. At an angle
# $\varphi$ the radius is $\cos(\varphi/2)$ of what it was. A face twists little, so it loses little there; its trouble
# is another one, and you will see it below. Dual quaternions (under *Go further*) mend the tube.
# </details>

# %% [markdown]
# ## Backward, one bone: the best rotation
#
# Now the inverse. We have a part of the face at rest, points $\mathbf s_i$, and the same points in a pose,
# $\mathbf q_i$. Which rigid motion takes the one to the other? The paper asks this too (its Eq. 3), to find the parts
# that need no network:
#
# $$\min_{\mathbf R \in SO(3),\ \mathbf t}\ \sum_i \| \mathbf s_i \mathbf R + \mathbf t - \mathbf q_i \|^2 .$$
#
# Kabsch's answer has four lines:
#
# 1. Subtract the means $\overline{\mathbf s}$ and $\overline{\mathbf q}$. What is left to find is $\mathbf R$.
# 2. Multiply out: all that depends on $\mathbf R$ is $\operatorname{tr}(\mathbf R^\top \mathbf H)$, to be as large as
#    can be, with $\mathbf H = \sum_i (\mathbf s_i - \overline{\mathbf s})^\top (\mathbf q_i - \overline{\mathbf q})$, a
#    3×3 matrix.
# 3. With $\mathbf H = \mathbf U \boldsymbol\Sigma \mathbf V^\top$ it is $\mathbf R = \mathbf U \mathbf D \mathbf
#    V^\top$, where $\mathbf D = \operatorname{diag}(1, 1, \det \mathbf U \cdot \det \mathbf V)$.
# 4. $\mathbf t = \overline{\mathbf q} - \overline{\mathbf s}\,\mathbf R$.
#
# Why line 3? The trace is $\operatorname{tr}(\mathbf Q \boldsymbol\Sigma)$ with $\mathbf Q = \mathbf V^\top \mathbf
# R^\top \mathbf U$, which is orthogonal, whatever $\mathbf R$ is. No entry of such a matrix is above 1, so the trace is
# at most $\sigma_1 + \sigma_2 + \sigma_3$, and $\mathbf Q = \mathbf I$ reaches that: $\mathbf R = \mathbf U \mathbf
# V^\top$.
#
# But without $\mathbf D$ you get the best *orthogonal* matrix. Flat or noisy points may prefer a mirror image, and a
# tooth that is mirrored is worse than a tooth that is 0.1 mm off. $\mathbf D$ gives up the direction that costs least:
# the last one, as NumPy sorts singular values from large to small.


# %% exercise="align"
def align(source, target):
    """Return R (3, 3) and t (3,) in mm, the rigid motion that best takes source to target; det R = +1 always.

    source, target: (k, 3) mm, the same points at rest and in a pose. Points are rows: source @ R + t.
    np.linalg.svd returns U, the singular values, and V already transposed.
    """
    ### BEGIN SOLUTION
    a, b = source.mean(0), target.mean(0)
    U, _, Vt = np.linalg.svd((source - a).T @ (target - b))
    D = np.diag([1, 1, np.linalg.det(U) * np.linalg.det(Vt)])
    R = U @ D @ Vt
    return R, b - a @ R
    ### END SOLUTION


# %% check="align" points=3
check_align(align, face)

# %% [markdown]
# What it is good for: the paper calls a part **rigid** if what `align` leaves of it is below $\tau = 0.3$ mm, the mean
# over poses, as we read its Eq. 3 ([D15](../../DEVIATIONS.md#d15-eq-3-becomes-a-length)). Rigid parts need no network;
# they follow a few vertices of the skin (§3.4). Let your function decide.

# %%
errors = {}
for part, name in enumerate(face.names):
    own = face.segment == part
    rest, poses = face.rest[own].astype(float), face.training[:20, own].astype(float)
    left = [rest @ R + t - pose for pose in poses for R, t in [align(rest, pose)]]
    errors[name] = float(np.mean([np.sqrt((one**2).sum(1).mean()) for one in left]))
show(*lesson3.rigid_chart(errors, tau_mm=0.3))

# %% [markdown]
# **Look.** The rig's teeth are rigid to the last digits of single precision. Which part comes next? It holds both
# ears: would one alone be more rigid? Raise $\tau$ until it counts as rigid, and ask whether you would accept that on a
# cinema screen.
# <details><summary>Answer</summary>
#
# The ears, which leave about a millimetre. One alone leaves about half of that, for the two also move apart:
#
# ```python
# one = (face.segment == face.names.index("ears")) & (face.rest[:, 0] > 0)
# rest, poses = face.rest[one].astype(float), face.training[:20, one].astype(float)
# np.mean([np.sqrt(((rest @ R + t - pose) ** 2).sum(1).mean()) for pose in poses for R, t in [align(rest, pose)]])
# ```
#
# That is still above $\tau$. On a screen a head may be ten metres high, forty times its size: a millimetre is four
# centimetres there, and an ear that slides so far against the hair is seen. A limit in millimetres has to know the
# screen.
# </details>
#
# ## Backward, one vertex: the weights
#
# Now the other half. Suppose that all bones' motions are known. Which weights suit a vertex? Let bone $b$ carry it
# **alone**, and write what remains in all $f$ poses into one long column:
#
# $$\mathbf r_b = \begin{pmatrix} \text{pose 1} - (\mathbf v^0 \mathbf R_b^{(1)} + \mathbf t_b^{(1)}) \\ \vdots
# \end{pmatrix} \in \mathbb R^{3f}, \qquad \mathbf S = [\mathbf r_1 \ldots \mathbf r_B].$$
#
# Because the weights sum to one, the blend leaves exactly $\mathbf S \mathbf w$. So each vertex has a small problem of
# its own, and all it knows of the face is its $\mathbf S$:
#
# $$\min_{\mathbf w} \|\mathbf S \mathbf w\|^2 \qquad \text{with} \quad \mathbf w \ge 0, \quad \sum_b w_b = 1,
# \quad \text{at most 4 of them not zero.}$$
#
# **Non-negative and sum one.** `scipy.optimize.nnls(A, y)` minimises $\|\mathbf A \mathbf x - \mathbf y\|$ with
# $\mathbf x \ge 0$ and returns $\mathbf x$ first. It knows nothing of sums. Put a row of ones under $\mathbf S$, and
# zeros with a single 1 at the end on the right side; then **divide $\mathbf x$ by its sum**:
#
# $$\mathbf A = \begin{pmatrix} \mathbf S \\ 1 \cdots 1 \end{pmatrix}, \qquad
# \mathbf y = \begin{pmatrix} \mathbf 0 \\ 1 \end{pmatrix}, \qquad \mathbf w = \mathbf x / \sum_b x_b.$$
#
# That is no approximation. Write $\mathbf x = c\,\mathbf w$ with $\sum_b w_b = 1$: for every $\mathbf w$ the best $c$
# leaves $E / (E + 1)$, where $E = \|\mathbf S \mathbf w\|^2$. This grows with $E$, so the best $\mathbf x$ has the best
# $\mathbf w$ in it. Don't be startled by $\mathbf x$ itself: its sum is $c = 1 / (E + 1)$, which is tiny where a
# vertex's $E$ is hundreds of mm².
#
# **At most four.** If more than four are above zero, keep the four largest bones and solve again for them alone.
#
# **Never worse.** Which four is a guess, and the weights of the last iteration, `old`, may be better. Compare
# $\|\mathbf S \mathbf w\|$ with that of the old weights, and return the better ones.


# %% exercise="weights"
def weights(S, old, most=4):
    """Return a vertex's weights (B,): none negative, sum 1, at most `most` above zero, never worse than `old`.

    S: (k, B) mm; column b is what remains of the vertex in all poses if bone b alone carries it.
    old: (B,) the weights of the last iteration. Don't change them.
    """
    ### BEGIN SOLUTION
    from scipy.optimize import nnls

    def convex(columns):
        x, _ = nnls(np.vstack([columns, np.ones(columns.shape[1])]), np.append(np.zeros(len(columns)), 1.0))
        return x / x.sum()

    w = convex(S)
    if np.count_nonzero(w) > most:
        keep = np.argsort(w)[-most:]
        w = np.zeros(len(old))
        w[keep] = convex(S[:, keep])
    return w if np.linalg.norm(S @ w) < np.linalg.norm(S @ old) else old
    ### END SOLUTION


# %% check="weights" points=3
check_weights(weights, face)

# %% [markdown]
# ## Taking turns
#
# Bones known: weights are easy. Weights known: bones are easy. Neither is known, so they take turns. This is **SSDR**,
# *Smooth Skinning Decomposition with Rigid Bones* (Le and Deng, 2012). Given are, in `course/lesson3.py`:
#
# - `lesson3.start(rest, poses, bones, align)` → motions and weights to begin with, of clusters of vertices, found by
#   *your* `align`,
# - `lesson3.alone(rest, poses, motions)` → the matrices $\mathbf S$ of all vertices, (n, k, B),
# - `lesson3.bone_step(rest, poses, w, motions)` → better motions for fixed weights: each bone in turn gets the rotation
#   that best explains what the others leave, a weighted `align`,
# - `lesson3.rmse(S, w, len(poses))` → the root mean square error, in mm.
#
# Neither step can raise the error, if you made `weights` never worse. So the error never rises. The frame is there;
# what remains for you is one iteration.


# %% exercise="alternate"
def alternate(rest, poses, bones, iterations):
    """Return the weights (n, B), the motions, and the RMSE in mm: a list, after the start and each iteration.

    rest: (n, 3) mm. poses: (f, n, 3) mm. An iteration is a weight step for every vertex, then a
    bone step; after it, S has to be computed again, for the motions are new.
    """
    motions, w = lesson3.start(rest, poses, bones, align)
    S = lesson3.alone(rest, poses, motions)
    errors = [lesson3.rmse(S, w, len(poses))]
    for _ in range(iterations):
        ### BEGIN SOLUTION
        w = np.stack([weights(*of_vertex) for of_vertex in zip(S, w, strict=True)])
        motions = lesson3.bone_step(rest, poses, w, motions)
        S = lesson3.alone(rest, poses, motions)
        ### END SOLUTION
        errors.append(lesson3.rmse(S, w, len(poses)))
    return w, motions, errors


# %% check="alternate" points=2
check_alternate(alternate, face)

# %% [markdown]
# ## Your bones on the teen
#
# 16 bones from the 1,500 vertices of the first picture.

# %%
rest, poses = face.rest[few].astype(float), face.training[:, few].astype(float)
found, motions, errors = alternate(rest, poses, BONES, 15)
show(*lesson3.course_chart(errors, suites_mm))

# %% [markdown]
# The motions are known now, so one more weight step gives **all** vertices their weights. It starts from the nearest
# vertex that has some.

# %%
from scipy.spatial import cKDTree

nearest = cKDTree(rest).query(face.rest)[1]
of_all = lesson3.alone(face.rest, face.training, motions)
w = np.stack([weights(*of_vertex) for of_vertex in zip(of_all, found[nearest], strict=True)])

# %%
show(*lesson3.one_by_one(rig.mesh, w, 12))

# %% [markdown]
# **Look.** Name five of your bones: what of the face moves as one piece? Where are borders soft, where hard? Each
# vertex was solved alone, without a look at its neighbours; do you see that?
# <details><summary>Answer</summary>
#
# Compare with pieces that you would cut yourself: jaw, neck, brows, a cheek, the nose with what hangs on it. Some bones
# are no such piece. They take a share of many vertices and lead few: they are there to *correct* what others do, as
# shapes of a basis do.
#
# Borders are soft where skin stretches between two pieces, as on the cheeks, and hard where it parts, as between the
# lips. But there are other hard ones, with ragged edges: two neighbours whose best four bones differ. Nothing in the
# problem asks them to agree.
# </details>
#
# ## What bones can't do
#
# The exam: a pose that was in no fit. Your weights stay, and the bones may move as they like, so this is about the best
# that *any* animator could do with them. Beside it the suite's 16 and 32 bones. They may use
# up to eight bones a vertex, yours four: so not all of the difference is the method's.

# %%
record = lesson3.wrinkled_pose()
truth = record.vertices["truth"]
R, t = lesson3.bone_step(face.rest, truth[None], w, lesson3.still(1, BONES), sweeps=100)
yours = skin(face.rest, R[0], t[0], w)

# %%
lbs16, lbs32 = (record.vertices[name] for name in ("lbs16", "lbs32"))
show(*lesson3.forehead_row(record, {"your 16 bones": yours, "the suite's 16": lbs16, "its 32": lbs32}))

# %% [markdown]
# **Look** for lines where your surface tears. What differs between two neighbours on either side of such a line? Here
# is the edge of this picture that tears most, and the weights of its two ends, by the numbers of your bones:

# %%
for vertex in lesson3.tear(record, yours):
    print(f"vertex {vertex}:", {int(b): round(float(w[vertex, b]), 2) for b in np.flatnonzero(w[vertex])})

# %% [markdown] think="millimetres"
# **Think.** Compare your 16 bones with the suite's 16, first by millimetres, then by degrees, then by eye. Which of the
# two numbers agrees with your eye? And what would SSDR have to measure to keep the folds?
# <details><summary>Answer</summary>
#
# The degrees do. A fold is a few vertices wide and a millimetre or two high, and there are several of them. To raise
# one and lower the next takes a bone for each. The fit spends its bones where most square millimetres are: jaw, lips,
# head. It sees **distance**, and folds cost little distance; so do the steps where two neighbours chose another four
# bones. The eye sees **normals**, and there both are everything. A fit that weighs how errors *change* along edges
# avoids the steps and keeps a little more of the folds; the suite's has such a term.
# </details>
#
# That is the next lesson's subject: what millimetres hide, and how degrees show it. And lesson 5 gives up on bones: it
# stores each vertex's offset itself, in an image.

# %% [markdown]
# ## Go further
#
# - B. H. Le and Z. Deng, *Smooth Skinning Decomposition with Rigid Bones*, SIGGRAPH Asia 2012: the method above; §4
#   has the weight step, §5 the bones.
# - W. Kabsch, *A solution for the best rotation to relate two sets of vectors*, Acta Crystallographica A, 1976; and S.
#   Umeyama, IEEE PAMI 1991, on the sign that keeps mirrors out.
# - L. Kavan, S. Collins, J. Žára and C. O'Sullivan, *Skinning with Dual Quaternions*, I3D 2007: the tube without a
#   waist.
# - C. L. Lawson and R. J. Hanson, *Solving Least Squares Problems*, 1974: where `nnls` comes from.
# - [The suite's notebook on skinning](../../notebooks/lbs.ipynb): more bones, other solvers, what each trick is worth.
