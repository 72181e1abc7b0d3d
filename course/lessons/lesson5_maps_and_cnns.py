# %% [markdown]
# # Lesson 5: Maps and CNNs
#
# **75 minutes. You need** lesson 4, least squares, and PyTorch's layers. **Afterwards you can**
#
# - store a face in images, read it back, and write the read's adjoint, which is its gradient,
# - find the best that images of a size can do, by least squares with nothing but these two functions,
# - build the paper's decoder, and say which errors are the image's fault and which are the network's.
#
# **The question: can a face be a picture?** Networks are good at pictures. Here is one pose of the teen, as pictures.

# %%
import numpy as np

# %%
from course.checks.lesson5 import check_best_map, check_decode, check_sample, check_spread
from course.lesson5 import charts, face_as_pictures, read_all, stored_poses

# %%
from replicate.approximation.deformation_map import polyharmonic_map
from replicate.methods.artefacts import rig_of

rig = rig_of("teen")  # the first time it is built: 15 s to 2 min
parts = charts(rig.mesh)  # name → vertices (k,) and texture coordinates (k, 2) from 0 to 1
record, *others = stored_poses()
offsets = record.vertices["truth"] - record.neutral  # (n, 3) mm
print(", ".join(f"{name} {len(vertices):,}" for name, (vertices, _) in parts.items()), "vertices")

# %%
from replicate.report.notebooks import show

bands = ("face_1", "face_2", "face_3", "face_4")
pictures = {name: polyharmonic_map(parts[name][1], offsets[parts[name][0]], 32) for name in bands}
show(*face_as_pictures(record, rig.mesh, pictures))

# %% [markdown]
# **Look.** Find the mouth in the maps, and the folds of the forehead. Which of the two takes up a larger share of its
# map than of the face?
# <details><summary>Answer</summary>
#
# The mouth lies between two maps: at the top of face 1, where the notch is, and at the bottom of face 2. The folds are
# the fine stripes across face 4, and they are the larger ones. All four maps have as many pixels, but the forehead's
# band has less skin than the jaw's: three and a half pixels for a centimetre, the jaw's fewer than three. Even so only
# two or three pixels lie between one fold and the next.
# </details>
#
# ## Reading a map
#
# A **deformation map** $I$ is an image with three channels. Pixel (row $r$, column $c$) of `size`×`size` pixels sits at
#
# $$u = \frac{c}{\text{size} - 1}, \qquad v = \frac{r}{\text{size} - 1},$$
#
# so the outermost pixels lie *on* the border of the chart. Row 0 is $v = 0$: `image[0]` is the *bottom* row of the
# pictures above, in which $v$ points up. Vertex $i$ has a fixed place $(u_i, v_i)$, and its offset is
# what it reads there: $\boldsymbol\Delta = g(I; U)$, in the paper's words. It reads the four pixels around it. With the
# place in pixels, $x = u\,(\text{size} - 1)$ and $y = v\,(\text{size} - 1)$, the first pixel $c = \lfloor x \rfloor$,
# $r = \lfloor y \rfloor$, and the rest $a = x - c$, $b = y - r$:
#
# $$g = (1 - a)(1 - b)\, I_{r,c} + a\,(1 - b)\, I_{r,c+1} + (1 - a)\,b\, I_{r+1,c} + a\,b\, I_{r+1,c+1}.$$
#
# At $u = 1$ there is no column $c + 1$. Keep $c$ at size − 2 or less; then $a$ becomes 1, and all is well.


# %% exercise="sample"
def sample(image, uv):
    """Return what each vertex reads from the map, (k, channels), by the formula above.

    image: (size, size, channels), row first. uv: (k, 2), u and v from 0 to 1, both ends included.
    """
    ### BEGIN SOLUTION
    place = uv * (len(image) - 1)
    corner = np.clip(np.floor(place).astype(int), 0, len(image) - 2)
    c, r = corner.T
    a, b = (place - corner).T[..., None]
    upper = (1 - a) * image[r, c] + a * image[r, c + 1]
    lower = (1 - a) * image[r + 1, c] + a * image[r + 1, c + 1]
    return (1 - b) * upper + b * lower
    ### END SOLUTION


# %% check="sample" points=2
check_sample(sample, parts)

# %% [markdown]
# ## The way back: the adjoint
#
# Reading is **linear** in the image: with all pixels in one long vector, $\boldsymbol\Delta = \mathbf G I$. Row $i$ of
# $\mathbf G$ has four numbers, vertex $i$'s weights. We never need to write $\mathbf G$ down. But whoever fits an
# image, a solver or a network, needs the transposed matrix too. If the vertices' errors are
# $\mathbf y = \mathbf G I - \boldsymbol\Delta$, then
#
# $$\frac{\partial}{\partial I}\; \tfrac{1}{2} \|\mathbf G I - \boldsymbol\Delta\|^2 = \mathbf G^\top \mathbf y.$$
#
# $\mathbf G$ gathers: a vertex collects from four pixels. $\mathbf G^\top$ scatters: a vertex gives its value to the
# same four pixels, with the same weights, and a pixel **adds up** all that it is given. How do you know that you got it
# right? By the **adjoint test**: for any image $I$ and any values $\mathbf y$,
#
# $$\langle \mathbf G I,\, \mathbf y \rangle = \langle I,\, \mathbf G^\top \mathbf y \rangle.$$


# %% exercise="spread"
def spread(values, uv, size):
    """Return Gᵀ values, an image (size, size, channels): the adjoint of `sample`.

    values: (k, channels), one row for each vertex. uv: (k, 2), from 0 to 1.
    np.add.at(image, (rows, columns), values) adds up, even where a pixel is named twice.
    """
    ### BEGIN SOLUTION
    place = uv * (size - 1)
    corner = np.clip(np.floor(place).astype(int), 0, size - 2)
    c, r = corner.T
    a, b = (place - corner).T[..., None]
    image = np.zeros((size, size, values.shape[1]))
    for down, weight in ((0, 1 - b), (1, b)):
        np.add.at(image, (r + down, c), weight * (1 - a) * values)
        np.add.at(image, (r + down, c + 1), weight * a * values)
    return image
    ### END SOLUTION


# %% check="spread" points=2
check_spread(spread, sample, parts)

# %% [markdown]
# You have just written the backward pass of a layer. It is what PyTorch does when it trains the paper's networks.
#
# ## The best map
#
# How good can a map of some size be, whatever network draws it? That is a least-squares problem, and its answer is a
# **floor**: no network with such a map has a smaller sum of squared distances, in mm². (The diagrams below show the
# mean distance and the normal error instead. There it is a good guide, but no strict bound, for nothing has minimised
# them.)
#
# $$\min_I\ \|\mathbf G I - \boldsymbol\Delta\|^2 + \lambda \|I\|^2, \qquad \lambda = 10^{-6}.$$
#
# The second term decides only what the vertices leave open: pixels that nobody reads and, where more pixels are read
# than there are vertices, which of the many best maps it is. `scipy.sparse.linalg.lsmr` solves this, and asks for
# nothing but the two directions:
#
# ```python
# G = LinearOperator((k, size * size), matvec=read, rmatvec=back, dtype=float)
# x = lsmr(G, y, damp=1e-3, atol=1e-8, btol=1e-8, maxiter=400)[0]      # damp is √λ
# ```
#
# `read` takes a vector of size² numbers to k numbers, `back` the other way. Both deal with *one* channel, so solve
# three times, for x, y and z.


# %% exercise="best_map"
def best_map(offsets, uv, size):
    """Return the map (size, size, 3) from which the vertices read their offsets as well as they can, in mm.

    offsets: (k, 3) mm. uv: (k, 2), from 0 to 1. Use sample and spread.
    """
    ### BEGIN SOLUTION
    from scipy.sparse.linalg import LinearOperator, lsmr

    def read(pixels):
        return sample(pixels.reshape(size, size, 1), uv)[:, 0]

    def back(values):
        return spread(values.reshape(-1, 1), uv, size).ravel()

    G = LinearOperator((len(uv), size * size), matvec=read, rmatvec=back, dtype=float)
    channels = [lsmr(G, one, damp=1e-3, atol=1e-8, btol=1e-8, maxiter=400)[0] for one in offsets.T]
    return np.stack(channels, axis=1).reshape(size, size, 3)
    ### END SOLUTION


# %% check="best_map" points=3
check_best_map(best_map, sample, parts, offsets)

# %% [markdown]
# **Your maps** now hold the whole face, one map for each part of it. Only the 26 teeth (1,300 of the 12,510 vertices)
# have none: each is rigid, so a rotation and a shift place it. How many pixels does a forehead need?

# %%
held = {size: record.neutral + read_all(best_map, sample, parts, offsets, size) for size in (4, 8, 16, 32, 64)}

# %%
from course.lesson5 import forehead
from course.sliders import move


def draw(size):
    size = round(size)
    if size not in held:
        held[size] = record.neutral + read_all(best_map, sample, parts, offsets, size)
    return forehead(record, held[size], f"{size}×{size} pixels")


# %%
from replicate.drawing.panels import Words

move(
    draw,
    {"size": (4, 64, 32)},
    [{"size": 4}, {"size": 8}, {"size": 16}, {"size": 32}],
    Words(
        "The forehead from maps of 4, 8, 16 and 32 pixels a side: smooth at first, all folds at last.",
        "One pose, read from your best maps of four sizes.",
    ),
)

# %% [markdown]
# Now the numbers, and beside them what the paper's trained networks make of the same pose: *coarse* draws maps of 32×32
# pixels, *refined* adds larger maps where the coarse ones lose most. So compare the coarse network with your point at
# 32 pixels; the refined one has more pixels than that, and may lie below it.

# %%
from course.lesson5 import floor_chart

networks = {"coarse CNN": record.vertices["coarse"], "refined CNN": record.vertices["refined"]}
show(*floor_chart(record, held, networks))

# %% [markdown] think="whose fault"
# **Think.** Take the size of the coarse network's maps. How much of its error is the map's fault? What would larger
# maps change? And is a floor of nearly zero good news? Commit to a share in per cent, in mm and in degrees, before you
# open the answer.
# <details><summary>Answer</summary>
#
# Divide your point at 32 pixels by the height of the dashed line: that share, in mm and in degrees, is about what
# the map costs. What lies between them is not the map's fault: such maps
# *exist*, and the network doesn't draw them. Where the gap is wide, larger maps only lower a floor that nobody stands
# on. Where it is narrow, they are what you need.
#
# A floor near zero is cheap to get: with more pixels than vertices there is a pixel for everybody, and the map is a
# list of offsets in another order. The floor tells what a representation can *hold*. What can be *predicted* from the
# controls is another question (lesson 6). Both depend on the rig and its charts, so measure your floor before you
# train.
# </details>
#
# ## Where maps lose most
#
# One map for all of a face would have few pixels for many vertices. What your 32×32 maps lose, vertex by vertex, shows
# where to spend more. The paper puts finer maps over **squares** there (its Fig. 8, §3.3).

# %%
from course.lesson5 import loss_picture

lost = []
for one in (record, *others):
    truth = one.vertices["truth"] - one.neutral
    lost.append(np.linalg.norm(read_all(best_map, sample, parts, truth, 32) - truth, axis=1))
show(*loss_picture(rig.mesh, parts, np.mean(lost, axis=0), 32))

# %% [markdown]
# **Look.** Where does the chart lose, and what do its triangles have in common there? Compare their size with the
# grid's. Which parts have more vertices than their maps have pixels? And why does the picture show the mouth?
# <details><summary>Answer</summary>
#
# The chart loses where its triangles are smaller than the grid's squares: several vertices with offsets of their own
# read the same four pixels. Five parts have more vertices than 1,024 pixels, the four bands of the face and the cranium
# (the first cell printed all counts), but that alone says little: elsewhere in the same chart there is room enough. At
# the mouth it is another reason. Two lips are near in the chart and move apart, and a map has no cut between two
# neighbouring pixels.
# </details>
#
# [Figure 8's notebook](../../notebooks/figure08.ipynb) has the same face in one chart, too: `teen@one_face`.
#
# ## What draws the map: the decoder
#
# The paper's network (its Fig. 3) turns controls into a map. Dense layers first, because controls have no neighbours;
# then convolutions, because pixels have.
#
# 1. `net.dense`: linear layers, to 256 numbers and then to 512. A leaky ReLU with slope `net.slope` follows each **but
#    the last**.
# 2. Reshape the last one's 512 numbers to 8 rows, 8 columns and 8 channels, in this order: `(b, 8, 8, 8)`. PyTorch's
#    convolutions want the channels before rows and columns: `.permute(0, 3, 1, 2)`.
# 3. `net.upsampled`: for each of these 3×3 convolutions double the image, by `interpolate(x, scale_factor=2,
#    mode="nearest")`, then the convolution, then a leaky ReLU.
# 4. `net.last`: one more 3×3 convolution and a leaky ReLU.
# 5. `net.output`: a 1×1 convolution to 3 channels, and nothing after it. Channels last again.


# %% exercise="decode"
def decode(net, params):
    """Return the maps (b, size, size, 3) that a network draws, computed by the list above.

    params: (b, m) controls, a tensor. torch.nn.functional has leaky_relu(x, slope) and interpolate.
    """
    ### BEGIN SOLUTION
    from torch.nn.functional import interpolate, leaky_relu

    x = params
    for layer in net.dense[:-1]:
        x = leaky_relu(layer(x), net.slope)
    x = net.dense[-1](x).reshape(len(params), 8, 8, -1).permute(0, 3, 1, 2)
    for layer in net.upsampled:
        x = leaky_relu(layer(interpolate(x, scale_factor=2, mode="nearest")), net.slope)
    x = leaky_relu(net.last(x), net.slope)
    return net.output(x).permute(0, 2, 3, 1)
    ### END SOLUTION


# %% check="decode" points=3
check_decode(decode, sample, parts)

# %% [markdown]
# What do convolutions add? Ask networks that know **nothing**: weights at random, no training. Below are the maps that
# yours draws in four poses, and those of a network with the same hidden layers whose last layer is dense.

# %%
import torch

from course.lesson5 import decoder_picture, fresh_dense, fresh_network, weights_of

# %%
net = fresh_network(len(rig.controls), parts["face_1"][1])
dense = fresh_dense(net)
with torch.no_grad():
    poses = torch.from_numpy(np.random.default_rng(5).uniform(-1, 1, (4, len(rig.controls)))).float()
    rows = {"convolutions": decode(net, poses).numpy(), "dense": dense(poses).reshape(4, 32, 32, 3).numpy()}
show(*decoder_picture(rows))
learned = weights_of(net.dense[-1:], net.upsampled, net.last, net.output)
print(f"weights after the first 256 numbers: {learned:,}; with a dense last layer: {weights_of(*dense[2:]):,}")

# %% [markdown] think="order"
# **Think.** You shuffle the vertices' texture coordinates: every vertex gets the place of another. What happens to the
# floor, and what to the two networks?
# <details><summary>Answer</summary>
#
# The floor rises, by far. The places are the same ones, so crowds and gaps stay where they were. But the offsets were
# smooth over the map: where several vertices share four pixels, they wanted nearly the same, and a blend of four served
# them all. After the shuffle strangers share pixels, and no blend serves them. Try it: permute the rows of each part's
# `uv`, and fit 32×32 pixels again. With a pixel for each vertex the floor would not depend on the order.
#
# That much hurts both networks. Otherwise the dense one doesn't mind: it never knew which pixels are neighbours. The
# CNN also loses what it was built on. It shares its
# weights among all places, which is right only where neighbouring pixels belong to neighbouring pieces of skin that
# move alike. That assumption is worth many weights, and it ends at every seam between charts.
# </details>
#
# So the map can hold the face, and the decoder leans to smooth maps by nature. What lies between the trained network
# and your floor is learning: what the network is told, and from where it starts. That is lesson 6.

# %% [markdown]
# ## Go further
#
# - S. W. Bailey, D. Omens, P. Dilorenzo and J. F. O'Brien, *Fast and Deep Facial Deformations*, SIGGRAPH 2020: §3.1 has
#   the map and the decoder, §3.3 the squares.
# - X. Gu, S. J. Gortler and H. Hoppe, *Geometry Images*, SIGGRAPH 2002: whole surfaces as pictures, eighteen years
#   earlier.
# - D. Ulyanov, A. Vedaldi and V. Lempitsky, *Deep Image Prior*, CVPR 2018: what an untrained decoder knows of images.
# - D. C.-L. Fong and M. Saunders, *LSMR: An Iterative Algorithm for Sparse Least-Squares Problems*, SIAM Journal on
#   Scientific Computing, 2011: the solver that you called.
# - [What keeps the coarse networks from their floor](../../notebooks/table2_training.ipynb), a study in this suite.
