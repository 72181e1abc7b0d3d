# %% [markdown]
# # Lesson 6: What networks must learn
# **75 minutes. You need** lesson 2 (ridge regression) and lesson 4 (normal errors), and torch's `nn.Module`.
# **Afterwards you can** write the loss of the paper and say what its α depends on; give a network a straight line
# to start from, and measure what that is worth; explain why a layer that multiplies suits a face rig.
#
# **What should a network learn of a face, and what is better handed to it?** Below is a test pose of the teen, by
# the rig and by five approximations. *LBS* is linear blend skinning (lesson 3), *refined* the paper's CNN, *dense*
# plain networks of dense layers that it is compared with, *linear* a straight line that took seconds to fit, and
# *regional* are small networks with all that this lesson is about.

# %%
from replicate.base.paths import REFERENCE
from replicate.report.notebooks import show, show_picture

show_picture(REFERENCE / "figure10_teen_median")

# %% [markdown]
# **Look.** Where on the face is the line wrong? Where are the dense networks wrong? Are those the same places?
# <details><summary>Answer</summary>
#
# In part. Both miss folds of the forehead, and the lips. The line is also wrong above the eyes, and a little everywhere
# that skin bends. The dense networks are worst on thin bright lines: a network for each segment of the face, and two
# that don't quite agree tear the skin along their border. So what they have to learn better is not what the line has
# to.
# </details>
#
# ## 1. The straight line
# We work on a head of 918 vertices with 49 controls, `tiny`, which trains in seconds. Training poses are 2,500
# products of animation frames and random factors (Eq. 5); test poses are frames of *other clips*. Controls are
# divided by their largest value in training, so a row of `params` is $\mathbf p$ without units, and `offsets` are
# $\mathbf V-\mathbf V^0$ in mm.
#
# Ridge regression from lesson 2 gives one matrix $W$ with $\Delta\approx(\mathbf p,1)\,W$; its last row is the
# constant. $\Delta$ are the offsets. (The first time the head is built, which takes 15 s to 2 min.)

# %%
from course import lesson6
from course import lesson6_pictures as pictures

face = lesson6.tiny_face()
WEIGHTS, line = lesson6.ridge_line(face, face.test_params)  # W (m + 1, 3n); its offsets (b, n, 3) at the test poses
print(f"{len(face.neutral)} vertices, {face.params.shape[1]} controls, {len(face.params):,} training poses")
for name, offsets in (("the face at rest", 0 * line), ("the straight line", line)):
    mm, degrees = lesson6.errors(face, offsets)
    print(f"{name:18}{mm:5.2f} mm, {degrees:4.2f}°")

# %% [markdown]
# The second line is what every network of this lesson has to beat. Anything worse than the first is not even
# worth storing.
#
# ## 2. What a network is told: Eq. 1
# The paper's networks minimise, for each pose, distances *and* normals:
#
# $$E=\frac1n\sum_{i=1}^{n}\|\mathbf v_i-\hat{\mathbf v}{}_i\|_1
# +\frac{\alpha}{f}\sum_{j=1}^{f}\|\mathbf n_j-\hat{\mathbf n}{}_j\|_1,\qquad \alpha=5,\ \text{in mm.}$$
#
# $\|\cdot\|_1$ is the sum of the absolute values of three coordinates. $\mathbf n_j$ is the *unit* normal
# of face $j$: the cross product of two of its edges, over its length. A batch has the mean of its poses' losses.
#
# **Exercise 1: the loss** (12 minutes). All in torch, so that gradients flow. A face without area has no
# direction; give it the normal 0. Unlike the mean in lesson 4, $f$ counts it. Mind the gradient there, too: one NaN,
# or a slope of $10^{12}$, is enough to ruin all weights. Dividing by a tiny number has such a slope. Safe is a *double
# where*: replace the squared length by 1 where it is 0, *before* the root and the division, and the result by 0 after.


# %%
import torch
from torch import nn


# %% exercise="loss"
def loss(vertices, target, faces, alpha):
    """Return Eq. 1, a tensor of one number.

    vertices, target: (b, n, 3), predicted and true positions in mm. faces: (f, 3), indices of corners. alpha: α.
    """

    ### BEGIN SOLUTION
    def normals(positions):
        a, b, c = (positions[:, faces[:, k]] for k in range(3))
        cross = torch.linalg.cross(b - a, c - a)
        squared = cross.square().sum(-1, keepdim=True)
        empty = squared == 0
        return torch.where(empty, 0.0, cross / torch.where(empty, 1.0, squared).sqrt())

    distance = (vertices - target).abs().sum(-1).mean()
    turned = (normals(vertices) - normals(target)).abs().sum(-1).mean()
    return distance + alpha * turned
    ### END SOLUTION


# %% check="loss" points=3
from course.checks.lesson6 import check_loss

check_loss(loss)

# %% [markdown]
# ## 3. What units do
# The first term has a unit, mm. The second has none. So α carries the unit of length, and the same number means
# something else in another file.
#
# The authors' released code has positions in a unit of about 450 mm. It weighs their distances with 10, and the
# *mean* of a normal's three differences with 50, which is $\frac{50}{3}$ for their sum. What is that in mm?
#
# **Exercise 2: α in mm** (8 minutes). A program minimises $w_d\,D+w_n\,N$. $N$ is the normals' term of Eq. 1
# without α, and $D$ the distances' term with positions in a unit of $u$ mm. Which α gives Eq. 1, with positions
# in mm, the same minimum?


# %% exercise="units"
def alpha_in_mm(distance_weight, normal_weight, unit_mm):
    """Return the α with which Eq. 1 in mm is that loss up to a factor."""
    ### BEGIN SOLUTION
    return normal_weight * unit_mm / distance_weight  # as D in units of u mm is D in mm over u
    ### END SOLUTION


# %% check="units" points=2
from course.checks.lesson6 import check_units

check_units(alpha_in_mm)

# %% [markdown]
# **Look.** Now a small dense network (two hidden layers of 64, about 190,000 weights) learns $\Delta$ with *your*
# loss: with the paper's α, with a hundredth of it, with that of the released code, and with the α of somebody who
# has loaded metres and left 5 as it is. Which errors suffer, and at which end? Does anything gain?
# <details><summary>Answer</summary>
#
# At the large end distance suffers, and by far: it stays near that of the face at rest. Normals gain next to nothing
# for it. At the small end normals suffer a little, and distance gains as little: up to the paper's 5 mm α hardly
# matters here.
# </details>

# %%
rest, ridge = lesson6.errors(face, 0 * line), lesson6.errors(face, line)
logs = {}
for alpha in (0.05, 5.0, alpha_in_mm(10, 50 / 3, 450), alpha_in_mm(1, 5, 1000)):
    network = lesson6.Alone(lesson6.small_network(face), lesson6.rms(face.offsets))
    logs[alpha] = lesson6.train(network, face, loss, alpha=alpha)
    if alpha == 5.0:
        alone = network
show(*pictures.balances(logs, ridge, rest))

# %% [markdown]
# (`train` also clips gradients, to a norm of 1 over all weights, so a larger loss doesn't take larger steps.)
#
# In this loss a head that is shifted as a whole costs nothing in normals; one that is turned does. At a large α most
# of the gradient is about normals, and the steps of training are spent on them: the head stays where it started.
# [bench_released](../../notebooks/bench_released.ipynb) follows this up on a whole character, one setting at a
# time.
#
# ## 4. The line beside the network
# After 400 steps, is the network with α = 5 below the line? Compare the dot with the cross. Most of what it has
# learnt so far, the line had after a second.
#
# So give it to the network. The line stays fixed (the suite's regional method starts from the same line, but goes on to
# train it), the network adds to it, and what it has to learn is
# $\Delta-(\mathbf p,1)W$, what the line leaves. Two details matter:
#
# - The network's outputs should be about 1 in size, so they are multiplied by a length. It is the RMS (the root
#   of the mean square) of its *targets* over the training poses: of what the line leaves, not of all offsets.
# - The line's weights are part of the model but not trained: `self.register_buffer(name, tensor)` keeps them.
#
# **Exercise 3: beside the line** (15 minutes). `network(params)` gives (b, n, 3) numbers; yours gives offsets in
# mm. The check trains your model and the plain network by the same batches and steps. Yours has to end below the
# line *and* below the plain network, in both errors.


# %% exercise="beside"
class BesideLine(nn.Module):
    """A straight line that stays as it is, plus a network that learns the rest."""

    def __init__(self, network, weights, params, offsets):
        """network: (b, m) → (b, n, 3) tensors. weights: (m + 1, 3n), float32 in numpy, the constant in the last row.

        params (b, m), offsets (b, n, 3) in mm: numpy, the training poses, to find the network's unit.
        """
        super().__init__()
        ### BEGIN SOLUTION
        self.network = network
        self.register_buffer("weights", torch.as_tensor(weights))
        left = torch.as_tensor(offsets) - self.line(torch.as_tensor(params))
        self.unit_mm = float(left.square().mean().sqrt())

    def line(self, params):
        return (params @ self.weights[:-1] + self.weights[-1]).unflatten(1, (-1, 3))
        ### END SOLUTION

    def forward(self, params):
        """Return the offsets (b, n, 3), mm, at scaled parameters (b, m)."""
        ### BEGIN SOLUTION
        return self.line(params) + self.unit_mm * self.network(params)
        ### END SOLUTION


# %% check="beside" points=3
from course.checks.lesson6 import check_beside

check_beside(BesideLine)

# %% [markdown]
# And the whole training, with your loss and your model, beside the plain network of before:

# %%
both = BesideLine(lesson6.small_network(face), WEIGHTS, face.params, face.offsets)
log = lesson6.train(both, face, loss)
show(*pictures.curves(ridge, {"network": logs[5.0], "network beside the line": log}))

# %% [markdown]
# Before its first step your model is the line, but for the small noise of a fresh network. All its steps go to
# what a line can't say. The face, in a pose that turns many normals:

# %%
models = {"network": alone, "network beside the line": both}
predictions = {name: lesson6.predict(model, face.test_params) for name, model in models.items()}
show(*pictures.heads(face, {"line": line, **predictions}))
print(lesson6.wins(face, line, predictions["network"]))

# %% [markdown]
# One pose is not the mean. In an extreme one a network may beat the line that is ahead of it over all test poses: so
# compare the picture's numbers with the two shares that are printed.

# %% [markdown]
# **Try.** Train both anew with `steps=1600`: `train` goes on from what a model has learnt, so make fresh ones first,
# `lesson6.Alone(lesson6.small_network(face), lesson6.rms(face.offsets))` and a new `BesideLine`. Does the plain network
# get below the line? Does it catch up with yours?
# On whole characters, with thousands of steps, [table2_line](../../notebooks/table2_line.ipynb) asks the same.

# %% [markdown] think="longer"
# **Think.** A dense network could represent the line exactly. Why, then, does it matter who gives it the line?
# And two architectures are compared after the same training: A has smaller errors than B. What else, apart from
# "A is better", could that mean?
#
# <details><summary>Answer</summary>
#
# What a network *can* represent says nothing about what some thousand steps of Adam find. The line is a sum of
# large, smooth movements along 49 directions. A network must build it from hidden units that bend, one small step
# at a time, and all that time its gradients are about the line and not about the creases. With the line given,
# all steps go to what is left.
#
# So "A has smaller errors than B" may mean that A can represent more; or that A *starts* nearer, learns faster,
# or likes this learning rate, unit or α better. Test it: give both the same start, train both longer, try two
# rates each. If the order turns, the comparison was about the training. The table of table2_line shows how much
# of the distance between CNN and dense networks is left once both have the line.
# </details>

# %% [markdown]
# ## 5. Gates: layers that multiply
# What does the line leave? Rigs have *correctives*: a shape that comes in when a smile and an open jaw come
# together, scaled by the product $x\cdot y$ of two controls. A line has no products. A layer of ReLUs has none
# either: it is made of flat pieces. A gated layer multiplies two linear maps of what it sees:
#
# $$\mathbf h=\mathrm{silu}(\mathbf x U+\mathbf d)\circ(\mathbf x V+\mathbf c),\qquad
# \mathrm{silu}(a)=a\,\sigma(a)=\frac{a}{1+e^{-a}}.$$
#
# **Exercise 4: a gate** (12 minutes). Write the layer. Then find, by hand and without training, two gates whose
# weighted sum is *exactly* $x\cdot y$. You need this: $\sigma(a)+\sigma(-a)=1$, so
# $\mathrm{silu}(a)-\mathrm{silu}(-a)=a$.


# %% exercise="gate"
def gated(x, U, d, V, c):
    """Return the gated layer's h (b, k). x: (b, j). U, V: (j, k). d, c: (k,). All are tensors."""
    ### BEGIN SOLUTION
    return nn.functional.silu(x @ U + d) * (x @ V + c)
    ### END SOLUTION


def product_gates():
    """Return tensors U (2, 2), V (2, 2) and w (2,) so that gated((x, y), U, 0, V, 0) @ w is x·y for all x and y."""
    ### BEGIN SOLUTION
    U = torch.tensor([[1.0, -1.0], [0.0, 0.0]])  # the first gate sees x, the second −x
    V = torch.tensor([[0.0, 0.0], [1.0, 1.0]])  # both have the value y
    return U, V, torch.tensor([1.0, -1.0])
    ### END SOLUTION


# %% check="gate" points=2
from course.checks.lesson6 import check_gate

check_gate(gated, product_gates)

# %% [markdown]
# **Look.** Your two gates beside eight leaky ReLUs, which have *learnt* to multiply from 51,200 examples in the
# white square (the best of four trainings). What happens outside?
# <details><summary>Answer</summary>
#
# ReLUs go on straight: their level lines end up as polygons. Gates go on as a product.
# </details>

# %%
U, V, w = product_gates()
shapes = {
    "$x\\cdot y$": lambda xy: xy.prod(1),
    "8 leaky ReLUs, trained": lesson6.leaky_product(),
    "2 gates, by hand": lambda xy: gated(torch.tensor(xy), U, torch.zeros(2), V, torch.zeros(2)) @ w,
}
show(*pictures.products(shapes))

# %% [markdown]
# To go on as a product is right here, and dangerous in general: a layer of many gates grows with the *square* of what
# it sees, and a second layer with the fourth power. Our method therefore clips what its gates see to the range of
# training, and lets only the line go on beyond (`replicate/regional/networks.py`).
#
# **Try.** Replace the small network in `BesideLine` by one with your gated layer, `steps=400`:
#
# ```python
# class Gated(torch.nn.Module):
#     def __init__(self, controls, gates, vertices):
#         super().__init__()
#         self.U, self.V = (torch.nn.Parameter(torch.randn(controls, gates) / controls**0.5) for _ in range(2))
#         self.a, self.c = torch.nn.Parameter(torch.zeros(gates)), torch.nn.Parameter(torch.zeros(gates))
#         self.out = torch.nn.Linear(gates, 3 * vertices)
#         torch.nn.init.normal_(self.out.weight, std=1e-3)  # a small start: the model begins as the line
#         torch.nn.init.zeros_(self.out.bias)
#
#     def forward(self, x):
#         return self.out(gated(x, self.U, self.a, self.V, self.c)).reshape(len(x), -1, 3)
# ```
#
# It may well be no better: gates are slow to start. Try a learning rate four times as large (`rate=0.02` in `train`),
# and more steps.
#
# ## 6. Regions: what a network need not see
# One network for the whole head has to learn that an ear does *not* depend on the lips, from poses in which all
# of them move at once. A network for each region that sees only the controls which move that region can't get it
# wrong (§3.1 of the paper). We halve the tiny head across its longest side, and the halves again, until there are
# eight regions.

# %%
show(*pictures.regions(face))

# %% [markdown]
# What are these pieces worth on a real character? The [study of our method](../../notebooks/bench_regional.ipynb)
# changes the method on the teen, all with the same steps. The base is one network for all regions, with line and gates,
# on two hidden layers of 384. Our method doesn't give vertices one by one: it mixes the strongest shapes of a region,
# its *components*, by the PCA of lesson 2 in the metric that knows normals. *Positions alone* are those in plain mm.
# The table has the base's errors on *validation* poses multiplied by …

# %%
pictures.pieces()

# %% [markdown]
# Rows under *removed* take a piece away, or put a plainer one in its place; those under *added* put one in. Not every
# row changes one thing. A network for each region has hidden layers of 128 in place of 384, twice the learning rate,
# and more bytes. One region has more components (148), so that the bytes are as many. Keep that in mind before you
# credit a factor to the name of its row.
#
# **Look.** Which piece is worth most in millimetres, which in degrees? Which would you give up first? Each row is
# *one* training: how large would a factor have to be before you believed it?
# <details><summary>Answer</summary>
#
# Sort each column by how far its factors are from 1; they are ratios, so ×0.4 is farther than ×1.8, which is 1/0.56.
# In both columns regions come first: the controls that each of them sees in millimetres, many of them in place of one
# in degrees. Second is the kind of error that training minimises in millimetres, and the line in degrees. First to go
# is the row nearest to 1 in both.
# A factor has to be larger than what another seed does to the *same* method. The table has one training a row, so it
# can't say; a few percent are surely too little. Lesson 8 measures it.
# </details>
#
# ## Go further
# - Bailey, Omens, DiLorenzo, O'Brien: *Fast and Deep Facial Deformations*, SIGGRAPH 2020. §3 has Eq. 1 and the
#   segments.
# - Bailey, Otte, DiLorenzo, O'Brien: *Fast and Deep Deformation Approximations*, SIGGRAPH 2018. The same idea for
#   bodies: linear blend skinning takes the place of our line, and networks learn what it leaves.
# - He, Zhang, Ren, Sun: *Deep Residual Learning for Image Recognition*, CVPR 2016. To learn what is left, in
#   every layer.
# - Dauphin, Fan, Auli, Grangier: *Language Modeling with Gated Convolutional Networks*, ICML 2017. Where gates
#   beat ReLUs first.
# - Shazeer: *GLU Variants Improve Transformer*, arXiv 2020. Two pages on gates with silu and others.
# - Lewis, Anjyo, Rhee, Zhang, Pighin, Deng: *Practice and Theory of Blendshape Facial Models*, Eurographics STAR
#   2014. Correctives, and why artists need them.
#
# **Next.** You now have a network that goes from controls to a face, and torch gives you its derivatives for
# nothing. Lesson 7 turns it round: an animator drags a point of the face, and the derivatives find the controls.
