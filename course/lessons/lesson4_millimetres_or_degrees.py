# %% [markdown]
# # Lesson 4: Millimetres or degrees
#
# **60 minutes. You need** lesson 1, the cross product, and from lesson 3 what skinning is. **Afterwards you can**
#
# - compute the normal error of Eq. 11, also where faces have no area;
# - say how many degrees a ripple of some height and length costs;
# - build two faces that the mean distance can't tell apart, and the eye can.
#
# **The question.** Two approximations of one face, and one of them is nearer in millimetres. Is it the one you would
# ship?
#
# Below is the teen's forehead in a test pose, and the same pose as two methods predict it. The light comes in flat
# from the upper left, as when you hold a torch along a wall to find its dents. The numbers are means over all
# vertices of the head. Choose before you read on.

# %%
from course.lesson4 import chart, faces, pair_that_disagrees, profile
from course.sliders import move

# %%
from replicate.report.notebooks import Words, folder_of, show
from replicate.report.pose_record import load_pose, plain_name, pose_file, vertex_mean_mm

# %%
pose = load_pose(pose_file(folder_of("reference"), "teen"))
truth, triangles = pose.vertices["truth"], pose.faces
A, B = pair_that_disagrees(pose)
shown = {
    "the rig": truth,
    f"A: {vertex_mean_mm(pose, A):.2f} mm off": pose.vertices[A],
    f"B: {vertex_mean_mm(pose, B):.2f} mm off": pose.vertices[B],
}
about = Words("A folded forehead: the rig's, and two predictions.", "Which would you take?")
show(faces(pose, shown), about)

# %% [markdown]
# ## A ruler
#
# The first of Table 2's two errors is what a ruler says, $E_{\text{distance}} = \frac1n\sum_i \lVert \mathbf v_i -
# \mathbf v_i'\rVert$, in millimetres. It needs one line, so here it is. The meshes have the same triangles, so vertex
# $i$ is the same spot of skin in both.

# %%
import numpy as np


def mean_distance(predicted, target):
    """Return the mean distance of vertices (n, 3), mm."""
    return float(np.linalg.norm(predicted - target, axis=-1).mean())


print(f"A: {mean_distance(pose.vertices[A], truth):.2f} mm, {len(truth):,} vertices")

# %% [markdown]
# ## A protractor
#
# The eye sees no places; it sees shading. How bright a bit of skin is depends on the angle at which light meets it,
# so on its normal. Let us measure normals.
#
# A triangle with the corners $\mathbf a, \mathbf b, \mathbf c$, counter-clockwise as seen from outside, has the
# normal
#
# $$\mathbf n = \mathbf m / \lVert\mathbf m\rVert, \quad \mathbf m = (\mathbf b-\mathbf a)\times(\mathbf c-\mathbf a).$$
#
# The length of $\mathbf m$ is twice the triangle's area. If it is zero, the triangle has shrunk to a line or a point,
# and there is no normal. Write that case down as the zero vector, so that you find it again.


# %% exercise="normals"
def face_normals(vertices, faces):
    """Return each face's unit normal, (f, 3): outwards; the zero vector for a face without area.

    vertices: (n, 3), mm. faces: (f, 3) whole numbers, the three vertices of each triangle,
    counter-clockwise from outside. Leave both as they are.
    """
    ### BEGIN SOLUTION
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    vectors = np.cross(b - a, c - a)
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)
    ### END SOLUTION


# %%
from course.checks.lesson4 import check_angle, check_normals, check_pair

# %% check="normals" points=2
check_normals(face_normals)

# %% [markdown]
# Now the second error of Table 2, Eq. 11 of the paper: the mean angle between the normals of the same face in both
# meshes,
#
# $$E_{\text{normal}} = \frac1f\sum_{i=1}^{f} \arccos\left(\mathbf n_i\cdot\mathbf n_i'\right).$$
#
# Three things that the formula doesn't say:
#
# - A face that has no area in *either* of the meshes has no angle. Leave it out; $f$ counts the others.
# - Every face counts once, however large it is.
# - Rounding can make $\mathbf n\cdot\mathbf n$ a little more than 1, and then arccos gives NaN.


# %% exercise="angle"
def mean_angle(predicted, target, faces):
    """Return the mean angle between the faces' normals in degrees, as one number (Eq. 11).

    predicted, target: (n, 3), mm. faces: (f, 3), of both. Faces without area in one of the
    meshes, or in both, are left out.
    """
    ### BEGIN SOLUTION
    ours, theirs = face_normals(predicted, faces), face_normals(target, faces)
    kept = ours.any(axis=1) & theirs.any(axis=1)
    cosine = (ours * theirs).sum(axis=1)[kept]
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())
    ### END SOLUTION


# %% check="angle" points=3
check_angle(mean_angle)

# %% [markdown]
# **Look.** Here are A and B again, with your number. Above is the clay; below, each triangle has the colour of its
# own angle, as Figure 10 of the paper draws errors. Did you choose by the ruler or by the protractor? (Where the title
# says LBS, that is the skinning of lesson 3, and it has an advantage: its bones are fitted to the very pose that is
# shown. The other methods have never seen it.)
# <details><summary>Answer</summary>
#
# A is nearer in millimetres: who took A went by the ruler. B has its folds where the rig has them, and of nearly the
# same depth: who took B went by the protractor. Most of its error is a smooth shift, which eyes forgive; A's errors
# begin and end within a few millimetres. Look at B's lids and hairline, too: there it has thin lines of its own.
# </details>


# %%
def both(surface):
    return f"{mean_distance(surface, truth):.2f} mm, {mean_angle(surface, truth, triangles):.1f}°"


shown = {
    f"{letter}, {plain_name(name)}: {both(pose.vertices[name])}": pose.vertices[name]
    for letter, name in {"A": A, "B": B}.items()
}
about = Words("A and B as clay and with normal errors in colours.", "Eq. 11, face by face.")
show(faces(pose, shown, heat=True, camera="front"), about)

# %% [markdown]
# ## What a ripple costs
#
# Take flat skin and press a wave into it: $h(x) = a\,\sin(2\pi x/\lambda)$, with the length $\lambda$ from crest to
# crest and the amplitude $a$. How *high* a wave is, or how deep, we count from crest to trough: $2a$. Below you see it
# cut through, with its normals in blue; the strip is the same skin from above, lit from the right. All three waves are
# equally high, so a ruler finds them equally wrong.

# %%
stills = [{"wavelength_mm": length, "amplitude_mm": 0.5} for length in (40, 10, 5)]
about = Words(
    "Three waves of equal height: the shorter, the stronger the shading.",
    "A wave, and what the eye gets of it.",
)
move(profile, {"wavelength_mm": (3, 40, 10), "amplitude_mm": (0, 1, 0.5)}, stills, about)

# %% [markdown]
# **Try.** In a running notebook, move the sliders until the strip looks smooth to you. Then read off the degrees.
#
# On paper it takes three lines. The mean of $|\sin|$ and of $|\cos|$ is $2/\pi$. So the mean distance is
# $\frac{2}{\pi}a$. The slope $h'(x)$ has the mean size $\frac2\pi\cdot\frac{2\pi a}{\lambda} = 4a/\lambda$, and a
# small slope *is* the angle of the normal, in radians. Divide one by the other, and turn radians into degrees:
#
# $$E_{\text{normal}} \;\approx\; 360^\circ\cdot\frac{E_{\text{distance}}}{\lambda}.$$
#
# A full turn, times the distance, over the wave's length. Millimetres do not ask how long a wave is; degrees do.

# %% [markdown] think="ruler"
# **Think.** A crow's foot is a row of folds, perhaps 0.2 mm from crest to trough and 3 mm apart. One network moves
# the whole cheek by 0.2 mm. Another has the cheek right and irons the folds flat. Which has the larger error, by the
# ruler and by the protractor?
# <details><summary>Answer</summary>
#
# By the ruler, the first: all of the cheek is off, and the folds cover few vertices. By the protractor, the second: a
# cheek that is shifted as a whole keeps all its normals and costs about 0°. The folds have the amplitude 0.1 mm, so
# at them the ironed skin is 0.06 mm off in the mean, and the formula gives about 8°. The loss of Eq. 1 has both terms
# for that reason. Mind the other direction, too: a face that floats a metre beside its head has a normal error of 0°.
# Neither number alone says that a face is right.
# </details>

# %% [markdown]
# ## Two faces, one ruler
#
# Your turn to fool the ruler. Bend the true face in two ways, both wrong by the same mean distance:
#
# - **smooth**, so that normals hardly turn, and
# - **rippled**, so that they turn at least ten times as much, and by at least 10° for each mm (1° at 0.1 mm).
#
# You get the unit normals of vertices; moving along them is natural, but you need not. Nothing may stick out: no
# vertex moves by more than five times the mean distance. A shift of the whole face counts as smooth, and noise as
# rippled, for networks make both errors; but try a wave. One hint: the vertices of this forehead are 2 to 4 mm apart,
# and a wave needs a few of them.


# %% exercise="pair"
def pair(vertices, normals, distance_mm):
    """Return two bent surfaces (smooth, rippled), each (n, 3), mm.

    The mean distance of each from `vertices` is distance_mm, and rippled has at least ten times
    the normal error of smooth, and at least 10° for each mm.

    vertices: (n, 3), mm. normals: (n, 3), their unit normals. Leave both as they are.
    """
    ### BEGIN SOLUTION
    wave = np.sin(2 * np.pi * vertices[:, 1] / 8.0)  # 8 mm from crest to crest, up the face
    wave = wave / np.abs(wave).mean()
    smooth = vertices + distance_mm * normals  # the skin is thicker everywhere
    rippled = vertices + distance_mm * wave[:, None] * normals
    return smooth, rippled
    ### END SOLUTION


# %% check="pair" points=4
check_pair(pair)

# %% [markdown]
# **Look.** Your two faces. Cover the titles: which is which? Their mean distances are equal. Could another ruler tell
# them apart, one that asks for more than the mean?
# <details><summary>Answer</summary>
#
# The rippled one has a second set of folds across the first; the smooth one can hardly be told from the rig. A ruler
# that looks at the farthest vertex sees waves: a sine's crest is π/2 times its mean size, and thicker skin is as thick
# everywhere. So does one that asks for the sign: a wave is in as often as out. But a shift of the whole face has
# a sign, too, and a single spike has a far vertex. Normals see what is *bent*, and ask for no such luck.
# </details>

# %%
from replicate.geometry.mesh import vertex_normals

smooth, rippled = pair(truth, vertex_normals(truth, triangles), 0.3)
shown = {
    "the rig": truth,
    f"smooth: {both(smooth)}": smooth,
    f"rippled: {both(rippled)}": rippled,
}
about = Words("The forehead bent smoothly and in ripples, with normal errors.", "Equal by the ruler.")
show(faces(pose, shown, heat=True), about)

# %% [markdown]
# **Try.** Halve the length of your wave, again and again. The formula promises twice the degrees each time. Where
# does the mesh stop keeping that promise, and what does the forehead look like then? Guess first; then run this.


# %%
def waved(length_mm, distance_mm=0.3):
    wave = np.sin(2 * np.pi * truth[:, 1] / length_mm)
    along = vertex_normals(truth, triangles)
    return truth + distance_mm * (wave / np.abs(wave).mean())[:, None] * along


for length in (40, 20, 10, 5, 2.5):
    found = mean_angle(waved(length), truth, triangles)
    print(f"{length:4} mm: {found:4.1f}°, by the formula {360 * 0.3 / length:4.1f}°")

# %% [markdown]
# Long waves cost a little less than promised: where skin turns away from the vertical, the same wave is longer on it.
# Short ones fall between
# the vertices: what is left is noise of the mesh's own length, however short a wave you ask for.
#
# ## Where real methods stand
#
# Every mark is a method in one of three stored test poses, measured by your functions. *Linear* is a straight line from
# controls to vertices, as in lesson 2. *Dense* and *Refined* are networks of the paper: one computes vertices from
# controls, the other images of offsets, part of them at a finer resolution (lessons 5 and 6). *Regional* is this
# suite's own method: small networks, each for a region of the face.
#
# Each grey line belongs to waves of one length: on it, $E_{\text{normal}} = 360^\circ\,E_{\text{distance}}/\lambda$. So
# the chart gives every method an **equivalent length**: that of the one wave along the normals that would cost as many
# millimetres and degrees. A real error is a mixture. A ripple plus a shift of the whole face reads as a longer wave,
# though the ripple is the same.

# %%
RULES = ("folded", "median", "worst")
poses = {rule: load_pose(pose_file(folder_of("reference"), "teen", rule)) for rule in RULES}
about = Words(
    "Mean angle of normals over mean distance of seven methods in three poses.",
    "LBS is fitted to the very pose that it is shown in; the others have never seen it.",
)
show(chart(poses, mean_distance, mean_angle, waves_mm=(12, 40, 120, 400)), about)

# %% [markdown]
# **Look.** Sort the methods by one axis, then by the other. Which of them trade places? Find the same method in all
# three poses: is it its errors' size that changes, or their equivalent length? And which axis would you ask for, if you
# could have only one?
# <details><summary>Answer</summary>
#
# Two methods trade places if the one farther right is lower: the one with fewer millimetres has more
# degrees, as A against B at the start of the lesson. A mark that moves along a grey line has
# errors of the same kind, only larger; one that moves to the right of it has errors with more of a shift in them, as a
# network whose jaw is not quite open enough. For folds in raking light ask for degrees, for an eye that has to close on
# its lid or a hand that touches the cheek for millimetres. With only one of the two you know neither.
# </details>
#
# ## Go further
#
# - S. Bailey, D. Omens, P. DiLorenzo, J. O'Brien, *Fast and Deep Facial Deformations*, SIGGRAPH 2020, §5: both errors
#   side by side, and where they disagree.
# - O. Sorkine, D. Cohen-Or, S. Toledo, *High-Pass Quantization for Mesh Encoding*, SGP 2003: where bits are few,
#   errors of long waves are the ones that nobody sees.
# - L. Váša, J. Rus, *Dihedral Angle Mesh Error*, SGP 2012: angles between neighbouring faces predict what viewers
#   notice.
# - M. Corsini and others, *Perceptual Metrics for Static and Dynamic Triangle Meshes*, Computer Graphics Forum 2013:
#   what else has been tried to measure what viewers see.
#
# You now have a ruler for long waves and a protractor for short ones. The paper's networks store a face in small
# images, and an image's pixels decide which waves it can hold at all. Lesson 5 looks at those images.
