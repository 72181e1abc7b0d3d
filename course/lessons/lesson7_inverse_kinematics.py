# %% [markdown]
# # Lesson 7: Inverse kinematics
#
# **75 minutes. You need** lesson 6, least squares, and what a Jacobian is. **Afterwards you can**
#
# - differentiate a face in two ways, and say when they disagree;
# - pull points of a face to where you want them, by damped Gauss–Newton steps that keep every slider within its
#   limits;
# - say what networks that have learned the same gain, and what they lose.
#
# **The question.** You drag a few points of a face. Which of its sliders shall move, and by how much?
#
# On the left is the teen at rest. The red balls are where its 22 control points are wanted: mouth corners out and up,
# inner brows up, all others where they are. On the right is one answer, by the suite. By the end of the hour you have
# your own. (The first time the rig is built, which takes 15 s to 2 min.)

# %%
from course.lesson7 import by_descent, faces, networks, teen
from replicate.report.notebooks import Words, show

# %%
rig, net = teen(), networks()
up = {"mouth_corner_left": (7, 7), "mouth_corner_right": (-7, 7)}
target = net.targets(**up, brow_left_01=(0, 5), brow_right_01=(0, 5))
poses = {"at rest": net.default, "an answer": by_descent(net, target)}
about = Words("The teen at rest and smiling; balls mark where points are wanted.", "Before and after.")
show(faces(rig, net, poses, target), about)

# %% [markdown]
# ## What you may use
#
# In a studio the rig is a closed program: controls in, vertices out, no derivative. So §4 of the paper works on an
# *approximation* of it, $\tilde r$, a network of lesson 6 that needs no more than the vertices $C$ of the control
# points. `net` is such a network for the teen, trained before, from `results/trained`. (It is our regional one; the
# paper's CNN comes later.) You get two functions and two limits:
#
# - `net.places(p)`: controls (b, m) to places (b, k), mm: $x$ and $y$ of point 1, of point 2, … as a camera in front
#   sees them (§5.3.1);
# - `net.slopes(p)`: the Jacobian at one pose, once you have seen that it is right;
# - `net.lower`, `net.upper`: the limits of the controls, (m,).
#
# The rig itself stays what it is good for: to draw faces, and to judge at the end.

# %%
import numpy as np

m, k = len(net.default), len(target)
print(f"{m} controls, {len(net.points)} points, so {k} numbers to reach")
print(f"{(net.default == net.lower).sum()} controls rest at their lower limit")

# %% [markdown]
# ## A Jacobian you can trust
#
# $J_{ij} = \partial \tilde r{}_i / \partial p_j$ says by how many mm the place $i$ moves when control $j$ moves by one
# unit. You can estimate it for any closed function that you may ask twice for each control:
#
# $$J_{\cdot j} \approx \frac{\tilde r(p + h\,e_j) - \tilde r(p - h\,e_j)}{2h}.$$
#
# (Some controls rest on a limit, so one of the two poses is outside. You may ask there: a network takes any numbers.)


# %% exercise="jacobian"
def jacobian(places, controls, step):
    """Return J, (k, m), by central differences.

    places: takes controls (b, m), as many poses as you like at once, and returns (b, k).
    controls: (m,), the pose where the derivative is wanted; leave it as it is.
    step: h above, in units of a control.
    """
    ### BEGIN SOLUTION
    moves = step * np.eye(len(controls))
    return (places(controls + moves) - places(controls - moves)).T / (2 * step)
    ### END SOLUTION


# %%
from course.checks.lesson7 import check_jacobian, check_limits, check_step

# %% check="jacobian" points=2
check_jacobian(jacobian)

# %% [markdown]
# Networks can do better: reverse differentiation gives all of $J$ exactly, in one pass for each of the $k$ numbers.
# Does it agree with you? Below is how far apart the two are in a half smile, for steps from a millionth to one; and,
# for the paper's CNN, the same.

# %%
from course.lesson7 import mean_distance, slope_chart

half, steps = poses["an answer"] / 2, np.logspace(-6, 0, 13)
curves = {}
for name, each in {"regional network": net, "the paper's CNN": networks("coarse")}.items():
    exact = each.slopes(half)
    apart = [np.linalg.norm(jacobian(each.places, half, h) - exact) for h in steps]
    curves[name] = np.array(apart) / np.linalg.norm(exact)
about = Words("Difference of two Jacobians over the step, for two networks.", "Differences and reverse mode.")
show(slope_chart(steps, curves), about)

# %% [markdown]
# **Look.** On the left rounding rules: float32 has seven digits, and you divide what is left of them by $h$. On the
# right the function bends within a step. In between there should be a valley. How deep is it for each of the
# networks? One hint: a network of leaky ReLUs, like the paper's CNN, is made of flat pieces, and its exact derivative
# knows only the piece that it stands on. Our regional network is made of smooth products, with kinks only where it
# cuts what is out of range.
# <details><summary>One answer</summary>
#
# The CNN's valley is shallower, and at smaller steps: soon a step crosses into other pieces. So at the step that you
# mean to take, its exact slope is not quite the slope that you will meet.
# </details>
#
# ## A step, and what damping does
#
# Let $r = \overline v - \tilde r(p)$ be what is still missing. A straight-line model of the face says $\tilde r(p +
# \delta) \approx \tilde r(p) + J\delta$. Gauss and Newton would take the $\delta$ with $J\delta = r$. But there are
# many more controls than numbers, so many $\delta$ do that; and some directions of $J$ are so weak that 1 mm takes
# controls far from where the straight line holds. Levenberg's remedy asks for a small step besides:
#
# $$\min_\delta\; \lVert J\delta - r\rVert^2 + \mu\lVert\delta\rVert^2,
# \qquad\text{so}\qquad (J^{\mathsf T}J + \mu I)\,\delta = J^{\mathsf T} r.$$
#
# (The paper's Eq. 6 sums lengths rather than their squares, and Eq. 8 punishes the controls rather than the step.
# With squares each step is one linear system.)


# %% exercise="step"
def damped_step(J, residual, damping):
    """Return the step δ of the controls, (m,).

    J: (k, m), mm per unit of a control. residual: (k,), mm, where the points are wanted minus
    where they are. damping: μ > 0, mm² per unit², as JᵀJ.
    """
    ### BEGIN SOLUTION
    return np.linalg.solve(J.T @ J + damping * np.eye(J.shape[1]), J.T @ residual)
    ### END SOLUTION


# %% check="step" points=2
check_step(damped_step)

# %% [markdown]
# Your step, six rounds of it on a hard pull, with four dampings. On the left, what $\mu$ makes of each direction of
# $J$: how far controls go for 1 mm; dots are at $\sigma = \sqrt\mu$. On the right, how far the points are from where
# they are wanted: solid lines by the network, which your steps ask, dashed ones on the rig.

# %%
from course.lesson7 import damping_chart, on_rig

hard = net.targets(mouth_corner_left=(20, 10), chin=(0, -15), brow_right_03=(0, 12))
runs = {}
for damping in (0.01, 1, 30, 1000):
    p, runs[damping] = net.default, []
    for _ in range(7):
        seen = net.places(p[None])[0]
        runs[damping].append([mean_distance(hard, seen), mean_distance(hard, on_rig(rig, net, p))])
        p = p + damped_step(net.slopes(p), hard - seen, damping)
about = Words("Gain of each direction, and distance by round, for four dampings.", "What damping does.")
show(damping_chart(net.slopes(net.default), runs), about)

# %% [markdown]
# **Look.** In $\sigma/(\sigma^2+\mu)$, the gain of a direction with the singular value $\sigma$, what happens on either
# side of the dot? What is the price of a large $\mu$? And which $\mu$ would you take by the solid lines, which by the
# dashed ones? (A line may rise at first: a step makes the sum of *squares* smaller, and for it many points give way a
# little.)
# <details><summary>One answer</summary>
#
# Stronger directions keep nearly all of $1/\sigma$, weaker ones are switched off. The price is rounds. By the network
# the least damping is nearest from the second round on: nothing yet speaks for more. The rig does: there the nearest is
# not the least damped, since the weak directions carry controls far off for the last bits of a millimetre. Keep both
# lines in mind until the table at the end.
# </details>
#
# ## Limits
#
# Nothing so far kept a slider between its ends, and dozens of them rest on one: a blink can't be less than open. The
# quick way is to cut whatever sticks out, $p \leftarrow \operatorname{clip}(p+\delta)$. But then nobody does the work
# of the controls that were cut. Better, and hardly longer:
#
# 1. At first all controls are free, and $\delta = 0$.
# 2. The free controls take the damped step towards what is left, $r - J_{\text{held}}\,\delta_{\text{held}}$, by
#    their own columns of $J$.
# 3. Every free control that would pass a limit goes exactly to that limit, and is held from now on.
# 4. Repeat from 2, until no free control would pass one.


# %% exercise="limits"
def step_within(J, residual, damping, controls, lower, upper):
    """Return the step δ, (m,), after which all controls are within their limits.

    J, residual, damping: as for damped_step, which you may call. controls: (m,), the pose, within
    its limits. lower, upper: (m,). Leave all of them as they are.
    """
    ### BEGIN SOLUTION
    step, free = np.zeros(len(controls)), np.ones(len(controls), bool)
    while True:
        left = residual - J[:, ~free] @ step[~free]
        step[free] = damped_step(J[:, free], left, damping)
        beyond = free & ((controls + step < lower) | (controls + step > upper))
        if not beyond.any():
            return step
        step[beyond] = (np.clip(controls + step, lower, upper) - controls)[beyond]
        free = free & ~beyond
    ### END SOLUTION


# %% check="limits" points=4
check_limits(step_within)

# %% [markdown]
# Now put it together: a few rounds, each with the Jacobian of where you are.


# %%
def clipped(J, residual, damping, controls, lower, upper):
    return np.clip(controls + damped_step(J, residual, damping), lower, upper) - controls


def unlimited(J, residual, damping, *_):
    return damped_step(J, residual, damping)


def follow(target, take=step_within, damping=1.0, rounds=6, start=net.default):
    p = start
    for _ in range(rounds):
        missing = target - net.places(p[None])[0]
        p = p + take(net.slopes(p), missing, damping, p, net.lower, net.upper)
    return p


# %%
poses = {}
for name, take in {"no limits": unlimited, "cut": clipped, "yours": step_within}.items():
    p = follow(hard, take)
    by_net, by_rig = (mean_distance(hard, each) for each in (net.places(p[None])[0], on_rig(rig, net, p)))
    poses[f"{name}: {by_net:.2f} mm, rig {by_rig:.2f} mm"] = p
about = Words("A hard pull by three kinds of steps.", "The same pull, with and without limits.")
show(faces(rig, net, poses, hard), about)

# %% [markdown]
# **Look.** The first number is what is left by the network, the second what is left by the rig, whose face you see.
# Which of these faces would an animator accept? And which number would you have reported?
# <details><summary>One answer</summary>
#
# Probably none. Yours brings the points nearest within limits, also on the rig, and its jaw is swollen all the same: 22
# points say nothing about the skin between them, and many sliders at their ends are cheap for them. A distance of
# points isn't a face. So report the rig's number, and show the picture beside it.
# </details>

# %% [markdown] think="factor"
# **Think.** A third way keeps the direction of the step: shorten all of $\delta$ by one factor, the largest that lets
# no control pass its limit. It sounds gentle. What does it do on the first step from rest?
# <details><summary>Answer</summary>
#
# Nothing at all. Dozens of controls rest on their lower limit, and some of those want to go further down. The largest
# factor that lets none of them pass is 0, and the face never moves. One slider at its end would stop all others for
# good. So each control has to meet its own limit, and the rest of the work has to be shared out again.
# </details>

# %% [markdown]
# **Try.** In a running notebook, pull at the face yourself. When does it stop following? (Titles say how far the
# corners and the brows are pulled up, and what is left on the rig.)

# %%
from course.sliders import move


def pulled(corners_up_mm, brows_up_mm):
    up = {f"mouth_corner_{side}": (0, corners_up_mm) for side in ("left", "right")}
    up |= {f"brow_{side}_01": (0, brows_up_mm) for side in ("left", "right")}
    wanted = net.targets(**up)
    p = follow(wanted)
    title = f"{corners_up_mm:+g}, {brows_up_mm:+g} mm: rig {mean_distance(wanted, on_rig(rig, net, p)):.2f} mm off"
    return faces(rig, net, {title: p}, wanted)


stills = [{"corners_up_mm": c, "brows_up_mm": b} for c, b in ((-8, 6), (8, -5), (14, 10))]
sliders = {"corners_up_mm": (-15, 15, 6), "brows_up_mm": (-10, 12, 0)}
move(pulled, sliders, stills, Words("Three faces, posed by their points.", "Your solver holds the strings."))

# %% [markdown]
# ## Networks that have learned it
#
# The paper finds such rounds too slow for dragging, and trains networks instead: points in, controls out, one for
# each region of the face, $p = f_{IK}(\overline V{}_C)$ (Eq. 7). They never see a right answer. The loss sends their
# controls through the frozen approximation and compares *points*, plus $\lambda$ times the size of the controls (Eq.
# 8):
#
# $$\mathcal L = \frac1{|C|}\sum_{i\in C} \lVert \tilde r{}_i(f_{IK}(\overline V{}_C)) - \overline v{}_i\rVert_1
# + \lambda\,\lVert (p - p^0)\odot s\rVert_1, \qquad p = f_{IK}(\overline V{}_C).$$
#
# $p^0$ are the controls at rest, and $s$ weighs each by one over its range, so that $\lambda$ is in mm (the suite's
# descent has 0.02 mm). The gradient of the first term is $J^{\mathsf T}$ of this lesson times the signs of what is
# missing, at training time. When somebody drags, no $J$ is needed. Table 4's 25 configurations of dragged points, by
# doing nothing, by you, and by them:

# %%
from course.lesson7 import by_networks, drags

ways = {"nothing": lambda wanted: net.default}
for damping in (0.01, 1, 10, 100):
    ways[f"your rounds, μ = {damping:g}"] = lambda wanted, damping=damping: follow(wanted, damping=damping)
ways |= {
    "IK networks": lambda wanted: by_networks(net, wanted),
    "IK networks, cut to limits": lambda wanted: np.clip(by_networks(net, wanted), net.lower, net.upper),
}

# %%
import pandas as pd


def judged(wanted, p):
    seen, true = net.places(p[None])[0], on_rig(rig, net, p)
    outside = ((p < net.lower - 1e-6) | (p > net.upper + 1e-6)).sum()
    distances = [mean_distance(*pair) for pair in ((wanted, seen), (wanted, true), (seen, true))]
    return [*distances, outside]


columns = ["left by the network, mm", "left on the rig, mm", "network off the rig, mm", "controls outside"]
means = {name: np.mean([judged(w, way(w)) for w in drags(net)], axis=0) for name, way in ways.items()}
pd.DataFrame(means, index=columns).T.round(2)

# %% [markdown]
# **Look.** The first column is what your rounds make small. The second is what the user gets. Which way wins in each,
# and which is worse than doing nothing?
# The third says how far the approximation is from the rig *at the controls that were found*. Compare it with this
# network's error on poses of the animation:

# %%
from course.lesson7 import animation_error_mm

print(f"{animation_error_mm():.2f} mm on held-out poses of the animation")

# %% [markdown] think="faults"
# **Think.** Go down your four rows. Each step tries to make the first column small. Why, then, can *less* damping leave
# more even there? And beyond that: why can more damping help the second column while it costs the first?
# <details><summary>Answer</summary>
#
# Two faults are mixed. *A step that is too long.* With little damping weak directions send dozens of controls to their
# limits in one step, by a straight line that holds no longer there. The next round starts from such a corner. So even
# the network sees worse faces: this is what damping is needed for. *A step that trusts too much.* The network is good
# near the animation. Your rounds go wherever it *says* that the points arrive, many sliders at their ends at once,
# where no training pose was, and of all places they pick those whose faults help most: the third column. An optimiser
# is a machine for finding the faults of what it optimises. Much damping and few rounds stop early, near rest: they
# leave more by the network, and their reports are nearer to the truth.
#
# Stopping early is not the same as a price on the controls, Eq. 8's $\lambda$: with enough rounds, damped steps get as
# far as others. Nor does that price alone make a way safe: read the third and fourth columns of the IK networks.
# </details>

# %% [markdown]
# And the time, in milliseconds for one drag of the teen. First yours, on this machine; then the suite's committed
# measurements: `ik` are the IK networks, `update` is them and the new face, and `solver` is the suite's own descent on
# the same network, as in the first picture.

# %%
from time import perf_counter

began = perf_counter()
for wanted in drags(net)[:5]:
    follow(wanted)
print(f"yours      {(perf_counter() - began) / 5 * 1000:8.0f} ms")

# %%
from replicate.report.notebooks import rows_if_there

for row in rows_if_there("reference", "bench_ik.csv"):
    if (row.character, row.method) == ("teen", "regional") and row.unit == "ms":
        print(f"{row.metric:10} {row.value:8.2f} ms")

# %% [markdown]
# ## Go further
#
# - S. Bailey, D. Omens, P. DiLorenzo, J. O'Brien, *Fast and Deep Facial Deformations*, SIGGRAPH 2020, §4: where this
#   comes from; Table 4 and Figure 11 ask the third column's question.
# - S. Buss, *Introduction to Inverse Kinematics with Jacobian Transpose, Pseudoinverse and Damped Least Squares
#   Methods*, 2004: the classic notes, with robot arms.
# - P. Baerlocher, R. Boulic, *An Inverse Kinematics Architecture Enforcing an Arbitrary Number of Strict Priority
#   Levels*, The Visual Computer 2004: your loop for limits, inside a larger one.
# - J. P. Lewis, K. Anjyo, *Direct Manipulation Blendshapes*, IEEE Computer Graphics and Applications 2010: for a
#   linear face one step is all.
# - D. Holden, J. Saito, T. Komura, *Learning an Inverse Rig Mapping for Character Animation*, SCA 2015: another way
#   to learn it, from poses of the rig.
#
# You have now built a table whose columns need not agree on the winner. Which of them you print is a decision, and
# you could have taken it after you saw the numbers. Lesson 8 is about taking it before.
