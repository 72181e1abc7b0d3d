# %% [markdown]
# # Lesson 2: Blendshapes and PCA
#
# **70 minutes. You need** lesson 1, least squares and eigenvalues. **Afterwards you can**
#
# - find the shapes that a face moves in, from its poses alone,
# - fit a straight line from controls to a face, and tell what it will never do,
# - choose what "close" means, by measuring in a metric of your own.
#
# **The question: how far does a straight line get?** Below, one pose that no fit has seen: the rig, and what a line
# from the controls makes of it. Which of the errors would you have seen without the colours?

# %%
import numpy as np

from replicate.methods.artefacts import rig_of

# %%
rig = rig_of("teen")

# %%
from course.checks.lesson2 import check_basis, check_pca, check_ridge
from course.lesson2 import error_chart, errors, first_line, fit_picture, halves, known_poses, shapes_picture

# %%
from replicate.report.notebooks import show

SMOOTH, FOLDED = 26, 33  # two of the held-out poses
poses = known_poses(rig)
line = first_line(poses)
show(*fit_picture(rig, poses, SMOOTH, {"a straight line": line[SMOOTH]}))

# %% [markdown]
# **Look.** The line folds a forehead that should be smooth, and leaves the eyes half open. Keep that in mind.
#
# ## What we work with
#
# From now on the rig is a black box. All that we have of it are poses: controls $\mathbf p_i$ and offsets
# $\boldsymbol\Delta_i = \mathbf V_i - \mathbf V^0$, drawn from the teen's animation as the paper does (Eq. 5). The
# poses that we judge by come from *clips*, single scenes of the animation, of which no frame was used: neighbouring
# frames are nearly equal, and a fit that has seen one knows the other.

# %%
print(f"to learn from: {len(poses.inputs)} poses of {poses.inputs.shape[1]} controls")
print(f"offsets: {poses.offsets.shape}, mm; to judge by: {len(poses.test_inputs)} poses")
print("neutral face: {:.2f} mm and {:.2f}° off".format(*errors(poses, 0 * poses.test_offsets)))

# %% [markdown]
# That last line is the bar to clear: a fit that is no better than *no movement at all* has learned nothing.
#
# ## Shapes that a face moves in
#
# An artist's **blendshapes** are offsets $\mathbf B_k$, one for each slider, that are added:
#
# $$\mathbf V = \mathbf V^0 + \sum_k c_k\, \mathbf B_k$$
#
# The face is then linear in its coefficients $c_k$. Without an artist, which $K$ shapes would serve best? Those that
# leave least of all poses unexplained:
#
# $$\min_{\mathbf m,\,\mathbf B,\,c} \sum_i \left\|\boldsymbol\Delta_i - \mathbf m - \sum_k c_{ik}\mathbf B_k\right\|^2,
# \qquad \langle \mathbf B_k, \mathbf B_l \rangle = \begin{cases} 1 & k = l \\ 0 & k \ne l \end{cases}$$
#
# The answer is **principal component analysis**: $\mathbf m$ is the mean, the $\mathbf B_k$ are the strongest
# eigenvectors of the covariance. That has $37{,}530 \times 37{,}530$ numbers here. But $N$ poses span at most $N$
# dimensions. Write the centred poses as rows of $\mathbf X$, $N \times 3n$. With the eigenvalues $\lambda_k$ and
# eigenvectors $\mathbf u_k$ of the small matrix $\mathbf X \mathbf X^\top$, $N \times N$,
#
# $$\mathbf B_k = \frac{1}{\sqrt{\lambda_k}}\, \mathbf u_k^\top \mathbf X, \qquad \lambda_1 \ge \lambda_2 \ge \ldots$$
#
# The $\mathbf u_k$ are the *columns* of what `np.linalg.eigh` returns. Each $\mathbf u_k^\top \mathbf X$ is a row
# of $3n$ numbers, which becomes a shape $(n, 3)$ again. Offsets come in single precision: turn them into doubles
# first, since the 200th eigenvalue is a millionth of the first. (`np.linalg.svd` is right, too, but several times
# as slow, and without `full_matrices=False` it asks for those $37{,}530^2$ numbers.)


# %% exercise="pca"
def pca(offsets, count):
    """Return the mean, (n, 3) mm, and the `count` strongest shapes, (count, n, 3), orthonormal, the strongest first.

    offsets: (N, n, 3) mm. count: fewer than N.
    """
    ### BEGIN SOLUTION
    mean = offsets.mean(axis=0)
    x = (offsets - mean).reshape(len(offsets), -1).astype(np.float64)
    values, vectors = np.linalg.eigh(x @ x.T)
    values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
    shapes = (vectors / np.sqrt(values)).T @ x
    return mean, shapes.reshape(count, *mean.shape)
    ### END SOLUTION


# %% check="pca" points=3
check_pca(pca, poses)

# %% [markdown]
# Here are the first shapes of *your* basis. A coefficient is measured in mm along its shape: with orthonormal shapes
# it is just an inner product.

# %%
mean, shapes = pca(poses.offsets, 200)


def coefficients(offsets):
    return np.tensordot(offsets - mean, shapes, ((1, 2), (1, 2)))  # (N, 200)


def rebuild(values):
    return mean + np.tensordot(values, shapes[: values.shape[1]], 1)  # as many shapes as there are columns


known = coefficients(poses.offsets)
show(*shapes_picture(rig, mean, shapes[:3], 2 * known[:, :3].std(axis=0)))

# %% [markdown]
# **Look.** Would an animator want a slider for any of these? (What is added and what is subtracted is chance: an
# eigenvector has no sign.)
# <details><summary>One answer</summary>
#
# Hardly. Each of them moves the jaw, the brows, the lids and the length of the head together, because they move
# together in the animation. A slider is there to move one thing.
# </details>
#
# ## How many shapes?
#
# Left half of each face: the rig. Right half: what your shapes can make of it when they are told the *best*
# coefficients, a **floor** for every method that uses them.

# %%
from course.sliders import move
from replicate.drawing.panels import Words

truth = coefficients(poses.test_offsets)


def draw(count):
    count = round(count)
    return halves(rig, poses, FOLDED, rebuild(truth[FOLDED : FOLDED + 1, :count])[0], f"{count} shapes")


words = Words("A wrinkled face: half rig, half of some shapes.", "Left halves: the rig. Right halves: your shapes.")
move(draw, {"count": (1, 200, 20)}, [{"count": 5}, {"count": 20}, {"count": 200}], words)

# %% [markdown]
# **Look.** Five shapes bring the brows *with* their folds, since the two come together in the animation. The lids
# come later. PCA takes first what is large in mm and frequent, whatever it means for an eye that looks at it.
#
# ## A straight line
#
# Now the other half of the problem: controls are given, coefficients are not. The simplest guess is a line. With
# controls $\mathbf a_i$ (over their largest values, as `poses.inputs` are already) and targets $\mathbf t_i$,
# **ridge regression** finds
#
# $$\min_{\mathbf W,\,\mathbf w_0}\ \frac1N \sum_i \left\| \mathbf a_i \mathbf W + \mathbf w_0 - \mathbf t_i \right\|^2
# + \lambda \|\mathbf W\|^2 .$$
#
# The penalty $\lambda$ keeps controls that hardly ever move from taking wild weights; the constant $\mathbf w_0$ pays
# none. With a last column of ones, $\mathbf A = (\mathbf a\ \ 1)$, and $\mathbf D = \operatorname{diag}(1, \ldots, 1,
# 0)$,
#
# $$\left(\mathbf A^\top \mathbf A + N \lambda \mathbf D\right) \begin{pmatrix} \mathbf W \\ \mathbf w_0 \end{pmatrix}
# = \mathbf A^\top \mathbf T .$$


# %% exercise="ridge_line"
def ridge_line(inputs, targets, strength):
    """Return the weights (m + 1, d) of ridge regression; the last row is the constant.

    inputs: (N, m), without the ones. targets: (N, d). strength: λ.
    """
    ### BEGIN SOLUTION
    a = np.column_stack([inputs, np.ones(len(inputs))]).astype(np.float64)
    penalty = np.append(np.ones(a.shape[1] - 1), 0.0)
    return np.linalg.solve(a.T @ a + len(a) * strength * np.diag(penalty), a.T @ targets)
    ### END SOLUTION


# %% check="ridge_line" points=2
check_ridge(ridge_line, poses)

# %% [markdown]
# Targets are your 200 coefficients, not 37,530 coordinates: a line to the coefficients is the line to the vertices,
# seen through the shapes. The chart puts the floor beside it.

# %%
weights = ridge_line(poses.inputs, known, 1e-4)
guess = poses.test_inputs @ weights[:-1] + weights[-1]
COUNTS = (2, 5, 10, 20, 50, 100, 200)
curves = {
    "floor: best coefficients": [errors(poses, rebuild(truth[:, :k])) for k in COUNTS],
    "straight line to coefficients": [errors(poses, rebuild(guess[:, :k])) for k in COUNTS],
}
levels = {"neutral face": errors(poses, 0 * poses.test_offsets), "straight line to vertices": errors(poses, line)}
show(*error_chart(COUNTS, curves, levels))

# %% [markdown]
# **Look.** The floor (blue) keeps falling: the shapes are good. The line to coefficients (orange) gets no lower here
# than the line to vertices (the lower dotted line). In mm it is soon there, and more shapes are wasted on it; in
# degrees it is still on its way, since late shapes are small in mm and full of folds. What lies between the two curves
# is what a *nonlinear* map from controls to the same coefficients could win. Studios ship just that, a small network to
# PCA coefficients; the suite has it as its method `pca`.
#
# **Try.** Other strengths, `1e-6` or `1e-2`. How would you choose one without looking at the held-out poses?
# <details><summary>One answer</summary>
#
# Set some clips of the *training* poses aside, fit to the rest with each strength, and take the one with the least
# error on those set aside; then fit once more to all. Whole clips, for the reason above.
# </details>
#
# ## What "close" means
#
# PCA took mm. Eyes see shading, and shading is normals. For a small offset, a normal turns by the *difference* of
# offsets along an edge over the edge's length. So let us measure offsets in another metric: of one coordinate
# $\mathbf x$, $(n)$ numbers,
#
# $$\|\mathbf x\|_Q^2 = \mathbf x^\top \mathbf Q\, \mathbf x
# = \frac1n \sum_v x_v^2 + \frac{\alpha^2}{f} \sum_{\text{triangles}}\ \sum_{\text{its edges } ij}
# \frac{(x_i - x_j)^2}{\ell_{ij}^2},$$
#
# and of an offset the sum over x, y and z. It is the relative with squares of the loss that the paper's networks
# minimise (Eq. 1, in lesson 6), with its weight $\alpha = 5$ of normals. $\mathbf Q$ is sparse, $n \times n$;
# `apply_metric(metric, offsets)` gives $\mathbf Q \mathbf x$ of each coordinate, in the shape of the offsets.
#
# The best shapes in this metric are orthonormal *in it*, $\langle \mathbf B_k, \mathbf Q \mathbf B_l \rangle = 1$
# or 0. You need only one change: the small matrix is now $\mathbf X \mathbf Q \mathbf X^\top$, summed over x, y and
# z. ($\mathbf X$ has $3n$ columns and $\mathbf Q$ only $n$ rows: so call `apply_metric` with the centred offsets,
# $(N, n, 3)$, and flatten what it gives.)

# %%
from replicate.regional.basis import apply_metric, loss_metric

n, f = len(rig.mesh.neutral), len(rig.mesh.faces)
metric = loss_metric(rig.mesh.neutral, rig.mesh.faces, n, f, 5.0)
print(f"Q: {metric.shape}, {metric.nnz / n:.1f} numbers a row")


# %% exercise="basis_in"
def basis_in(offsets, metric, count):
    """Return the mean, (n, 3) mm, and the `count` strongest shapes in a metric, (count, n, 3), orthonormal in it.

    offsets: (N, n, 3) mm. metric: Q, sparse (n, n). count: fewer than N. The strongest shape comes first.
    """
    ### BEGIN SOLUTION
    mean = offsets.mean(axis=0)
    centred = (offsets - mean).astype(np.float64)
    x, weighed = (part.reshape(len(offsets), -1) for part in (centred, apply_metric(metric, centred)))
    values, vectors = np.linalg.eigh(x @ weighed.T)
    values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
    return mean, ((vectors / np.sqrt(values)).T @ x).reshape(count, *mean.shape)
    ### END SOLUTION


# %% check="basis_in" points=3
check_basis(basis_in, poses, metric)

# %% [markdown]
# Coefficients are inner products again, now in the metric. What do as many shapes hold in either?

# %%
same_mean, seen = basis_in(poses.offsets, metric, 200)
best = np.tensordot(apply_metric(metric, poses.test_offsets - same_mean), seen, ((1, 2), (1, 2)))


def rebuild_seen(values):
    return same_mean + np.tensordot(values, seen[: values.shape[1]], 1)


floor = curves["floor: best coefficients"]
floors = {"shapes by mm": floor, "shapes by mm and normals": [errors(poses, rebuild_seen(best[:, :k])) for k in COUNTS]}
show(*error_chart(COUNTS, floors, {"straight line to vertices": levels["straight line to vertices"]}))

# %%
K = 200
by_mm, by_normals = rebuild(truth[FOLDED : FOLDED + 1, :K])[0], rebuild_seen(best[FOLDED : FOLDED + 1, :K])[0]
fits = {f"{K} shapes, mm": by_mm, f"{K} shapes, normals": by_normals}
show(*fit_picture(rig, poses, FOLDED, fits, clay=False))

# %% [markdown]
# **Look.** Nothing is free: as soon as there are some dozens of shapes, what one metric gains in degrees it pays in
# mm. (With few shapes both begin with the same large motions.) Which of the two would you show to an
# animator, and which to somebody who fits glasses to a head?
#
# ## The suite's own
#
# The same methods in the suite, with all training poses and random frames held out, from its committed results:
# *linear* is a line to all vertices, *pca* a network to PCA coefficients, *pca_line* that network with a
# line beside it. Beware: of *random* frames held out, the neighbours were trained on. So compare its rows with each
# other, not with your chart.

# %%
import replicate

NAMES = {"vertex_error_mean": "distance, mm", "normal_error_mean": "normals, °"}
table = replicate.results("reference").query("table == 'table2' and character == 'teen' and metric in @NAMES")
table = table.pivot(index="method", columns="metric", values="value").rename(columns=NAMES)
table.loc[["neutral", "linear", "pca", "pca_line"], list(NAMES.values())].round(2)

# %% [markdown]
# Is the network ahead of the line in both columns? Lesson 6 comes back to what networks find hard about a straight
# line.

# %% [markdown] think="data"
# **Think.** Go back to the first picture. The line has folded a smooth forehead, and in other poses it folds too
# little. With a hundred times as many poses, which part of its error goes away, and which stays?
#
# <details><summary>Answer</summary>
#
# Two errors are mixed. With 600 poses, 258 controls and a penalty, some weights are poorly known; that part shrinks
# with more poses. The other part stays: skin folds only beyond a threshold of compression, and a line has no
# threshold. It takes one slope for all poses, too much where the forehead is still smooth, too little where it is
# folded. The same goes for lids that meet, and for two controls that do not add up. What *linear* in the table
# above has left, with all training poses and the neighbours of its held-out frames, is nearly all of this kind.
# </details>

# %% [markdown]
# ## What to take along
#
# A few hundred shapes hold this face well, and one can choose in which metric. A line from the controls finds the
# large motions and misses what has a threshold. Lesson 3 goes another way: not shapes that are added, but bones that
# turn; it asks what *they* can do that a line can't, and how one finds bones from poses alone.

# %% [markdown]
# ## Go further
#
# - V. Blanz, T. Vetter, *A Morphable Model for the Synthesis of 3D Faces*, SIGGRAPH 1999: PCA of faces, of people in
#   place of poses.
# - J. P. Lewis, K. Anjyo, T. Rhee, M. Zhang, F. Pighin, Z. Deng, *Practice and Theory of Blendshape Facial Models*,
#   Eurographics STAR 2014: why artists' shapes are not orthogonal, and why that is good.
# - T. Neumann, K. Varanasi, S. Wenger, M. Wacker, M. Magnor, C. Theobalt, *Sparse Localized Deformation Components*,
#   ACM Transactions on Graphics (SIGGRAPH Asia) 2013: shapes that move one place of a face at a time.
# - L. Sirovich, *Turbulence and the Dynamics of Coherent Structures*, Quarterly of Applied Mathematics 1987: the
#   small matrix in place of the large one.
# - The suite's own [rig report](../../notebooks/rig_report.ipynb): how many shapes each of its faces needs.
