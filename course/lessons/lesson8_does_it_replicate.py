# %% [markdown]
# # Lesson 8: Does it replicate?
# **75 minutes. You need** lessons 4 and 6, and what a standard deviation is.
# **Afterwards you can** judge a claim by a rule that was fixed before the numbers; find training poses that leak
# into a test; plan an ablation that somebody else can run, and whose answer you would have to accept.
#
# **When is one number of a table really smaller than another?** Below are normal errors of four methods on our
# four characters. Each stroke is a fit with its own seed: other poses, and for networks (refined, dense) other first
# weights and batches, too. Each panel has its own range of degrees, so that strokes of one method come apart.

# %%
from course import lesson8
from replicate.report.notebooks import show

show(*lesson8.seeds_chart())

# %% [markdown]
# **Look.** Which pairs of methods could you order after a *single* seed of each? For which would you rather see
# all three?
# <details><summary>Answer</summary>
#
# Those whose strokes lie farther apart than either method's own strokes do. Where they mix, a second seed could turn
# the order. Even then one question is left, and section 1 answers it: do two methods change places *within* a seed, or
# is a hard seed hard for both?
# </details>
#
# ## 1. A rule before the numbers
# "Our method is better" is not a claim until somebody says how much smaller which number has to be, on what. For
# each claim of the paper the suite has a rule in code that knows no numbers: a training that comes out otherwise
# may turn a verdict, but not the rule. This is the one of claim C2, the paper's main result:

# %%
from replicate.report.notebooks import show_text
from replicate.targets.claims.verdicts import claim_named

show_text(f"> **C2. {claim_named('C2').text}.** {claim_named('C2').rule}")

# %% [markdown]
# (Our teen stands for the paper's Hiccup, woman for Valka, dragon for Toothless, toon for Ray. The characters
# ict and rigify stand for none of them.)
#
# And what is *smaller*? A seed decides the poses, too, so a seed that is hard for one method is hard for the
# other. So compare seed by seed: with $d_s=\text{other}_s-\text{ours}_s$ for each seed $s$,
#
# $$\bar d > 2\,\mathrm{sd}(d),$$
#
# where $\mathrm{sd}$ is the standard deviation over the seeds, with $n-1$ in the denominator. With one seed there is no
# spread to be known, and $\bar d>0$ has to do. This is a rule of thumb. [The suite's own](../../notebooks/claims.ipynb)
# asks for more: a 95 % interval of the *ratio* (Student's, which is wider the fewer seeds there are), and at least half
# of the paper's effect, with *undecided* and *direction only* between *holds* and *fails*; of a single seed alone it
# decides nothing.
#
# **Exercise 1: the claim** (15 minutes). `clearance` says how far above 0 a difference stays when twice its spread is
# taken off (above 0 the comparison holds); `judge_c2` applies the
# rule of thumb. The paper's six methods are in `lesson8.PAPERS`; the best one should be *refined*, on the dragon
# *dense*. Also return the **effect**: the mean error of that
# best one, over seeds, divided by the smallest mean among the other five.

# %%
import numpy as np


# %% exercise="claim"
def clearance(ours, other):
    """Return the mean of other − ours over the seeds, minus twice the standard deviation of that difference.

    ours, other: dictionaries seed → error, with the same seeds. Positive: ours is clearly smaller.
    """
    ### BEGIN SOLUTION
    differences = [other[seed] - ours[seed] for seed in ours]
    spread = 2 * np.std(differences, ddof=1) if len(differences) > 1 else 0.0
    return np.mean(differences) - spread
    ### END SOLUTION


def judge_c2(errors, character):
    """Return (whether C2 holds, its effect). errors: method → seed → normal error in degrees."""
    ### BEGIN SOLUTION
    best = "dense" if character == "dragon" else "refined"
    others = [errors[method] for method in lesson8.PAPERS if method != best]
    holds = all(clearance(errors[best], other) > 0 for other in others)
    best_mean, *means = (np.mean([*each.values()]) for each in (errors[best], *others))
    return holds, best_mean / min(means)
    ### END SOLUTION


# %% check="claim" points=3
from course.checks.lesson8 import check_claim

check_claim(clearance, judge_c2)

# %% [markdown]
# Your verdicts, from the committed results as they are today:

# %%
import pandas

errors = {character: each for character, each in lesson8.normal_errors().items() if "@" not in character}
verdicts = {character: judge_c2(each, character) for character, each in errors.items()}
table = pandas.DataFrame(verdicts, index=["C2", "effect"]).T
table.assign(C2=table["C2"].map({True: "holds", False: "fails"}), effect=table["effect"].map("{:.2f}".format))

# %% [markdown]
# The numbers will change when somebody trains again, and then this table does. The rule stays. That is what it is
# for.
#
# ## 2. A verdict is not an effect
# Seed by seed, tiny differences can be certain. Here is another claim of the paper, with its ratios: ours as
# dots, the paper's as rings. Left of 1 is what the claim wants. Bars are 95 % intervals, here shorter than the dots.

# %%
from replicate.targets.claims import claim_chart, open_claims

run = open_claims("reference")
show(*claim_chart(run.ours, run.paper, "C1"))

# %% [markdown]
# **Look.** On which characters would an animator see the difference between coarse and refined?
# <details><summary>Answer</summary>
#
# On ict alone: its face is one chart, whose pixels are too few, and refinement takes off a third and more. On all the
# others it is a few percent at most, which nobody sees.
# </details>
#
# So always say both: whether (the verdict, with its spread), and how much (the effect).
#
# **And beside what?** A ratio of two networks hides whether either is any good. In this table the face at
# rest learns nothing, the straight line is a ridge regression, no network, and the last column is what refined *maps*
# can hold, fitted in mm (lesson 5). In degrees it is a good guide, no strict bound, and for refined alone: dense has no
# maps.

# %%
lesson8.limits_table()

# %% [markdown]
# **Look.** On which characters does a straight line beat a network of the paper? How much of the way from rest to
# its floor does refined go? Where the line beats both networks, what does it tell you that one of them beats the
# other?
# <details><summary>Answer</summary>
#
# Read the first from the table; it changes with each training. For the second take (neutral − refined) / (neutral −
# floor): most of the way, and the rest is what wrinkles are made of. For the third: little. Both networks are then
# behind what needs no training, and the question is no longer which is the better network but what both have not
# learnt.
# </details>
#
# ## 3. Leaks
# A test tells how a method does on poses that it has *not* learnt. An animation has 24 frames a second, and the
# next frame is nearly the same pose:

# %%
show(*lesson8.splits_chart({"frames": "a third of the frames, by chance", "clips": "a whole clip of three"}))

# %% [markdown]
# Training poses are made from the animation by the paper's Eq. 5, $\mathbf p'=\mathbf u\circ\mathbf p$. The circle
# multiplies entry by entry, $p'_i=u_i\,p_i$, with a random factor $u_i$ from 0.25 to 3 for each control. A
# control that rests, $p_i=0$, rests in the copy. So there are two ways
# to leak: the test has a **neighbour** of a training pose, or training has a **scaled copy** of a test pose, as
# when somebody augments first and splits afterwards.
#
# **Exercise 2: two detectors** (12 minutes). Poses are rows of controls, each divided by its largest value.


# %% exercise="detectors"
def nearest(pose, training):
    """Return how far the nearest training pose is: its Euclidean distance to the pose, over the pose's length.

    pose: (m,), not at rest. training: (a, m).
    """
    ### BEGIN SOLUTION
    return np.linalg.norm(training - pose, axis=1).min() / np.linalg.norm(pose)
    ### END SOLUTION


def has_copy(pose, training):
    """Return whether a training pose could be u ∘ pose: 0 where the pose is 0, elsewhere 0.25 to 3 times its value.

    Allow the factors 0.01 % more either way, for rounding. pose: (m,), not at rest. training: (a, m).
    """
    ### BEGIN SOLUTION
    moves = pose != 0
    alike = training[((training != 0) == moves).all(axis=1)]
    factors = alike[:, moves] / pose[moves]
    return bool(((factors >= 0.25 * 0.9999) & (factors <= 3 * 1.0001)).all(axis=1).any())
    ### END SOLUTION


# %% check="detectors" points=3
from course.checks.lesson8 import check_detectors

check_detectors(nearest, has_copy)

# %% [markdown]
# Five colleagues have split the same animation, and each says "the test poses were held out". Your detectors on
# their splits:

# %%
lines = {}
for name, split in lesson8.splits().items():
    distances = np.array([nearest(pose, split.training) for pose in split.test])
    copies = np.mean([has_copy(pose, split.training) for pose in split.test])
    lines[name] = [f"{np.median(distances):.2f}", f"{np.mean(distances < 0.1):.0%}", f"{copies:.0%}"]
pandas.DataFrame.from_dict(lines, "index", columns=["median distance", "nearer than 0.1", "with a scaled copy"])

# %% [markdown]
# **Exercise 3: who leaks?** (8 minutes.) Say of each split what it has: `"none"`, `"neighbours"` or `"scaled
# copies"`. A neighbour is a copy with factors near 1, so where a split has both signs, the neighbours explain the
# copies. Which leak would the first detector miss if it were alone?


# %% exercise="splits"
def leaks():
    """Return a dictionary: the name of a split, "A" to "E" → "none", "neighbours" or "scaled copies"."""
    ### BEGIN SOLUTION
    return {"A": "neighbours", "B": "none", "C": "scaled copies", "D": "none", "E": "neighbours"}
    ### END SOLUTION


# %% check="splits" points=2
from course.checks.lesson8 import check_splits

check_splits(leaks)

# %% [markdown]
# The paper splits its animation "randomly", 90 % to 10 %. We read that as frames, and Table 2 follows it, so that
# its numbers can be compared with the paper's. Our [study of clips](../../notebooks/table2_clips.ipynb) asks what
# that flatters. Each arrow goes from frames to whole clips:

# %%
from replicate.targets.table2.charts import clips_chart

show(*clips_chart("reference"))

# %% [markdown]
# **Look.** Which error suffers more, distances or normals? Do all methods suffer alike? Does the *order* of two
# methods change? (A leak that flatters all alike is a wrong number; one that flatters some is a wrong
# conclusion.)
# <details><summary>Answer</summary>
#
# Mostly normals. Not alike: what is fitted to the very pose that is tested (LBS) hardly suffers, the CNN does by a
# fifth, our method by three tenths, dense networks by a third: they have learnt more of the frames by heart. The order
# of these stays, but the lead of dense networks over the CNN shrinks. (Leave the line out: its two ends are of two
# versions.)
# </details>

# %% [markdown] think="stopping"
# **Think.** After three seeds your method is better in the mean, but not by twice the spread. A colleague says:
# "Train more seeds until it is." What is wrong with that, and what would be right?
#
# <details><summary>Answer</summary>
#
# A rule that stops when you like the answer is another rule than the one you wrote down. How much it matters
# depends on the rule. Take differences that are normal with the mean 0: no method is better. "The mean exceeds twice
# its *standard error*" holds in 9 % of all cases after three seeds; if you may look after 3, 4, 5, … 20 seeds and
# stop when you like it, in 19 %. Each new seed is another chance to cross the line, and nobody stops the other way.
# It is the same as choosing the best of five learning rates for your method, and none for the baseline.
#
# *Our* rule wants the mean to exceed twice the standard *deviation*, which doesn't shrink with more seeds. So it
# holds by chance in 3.7 % of cases at three seeds, and in 4.1 % with looking up to twenty. But it asks another
# question: will nearly every single training be better? If the true mean is as large as the standard deviation, it
# holds in 25 % of cases at three seeds and in 4 % at ten: more seeds then tell you that the answer is no.
#
# Right: decide how many seeds *before* the first one, from the spread that the baseline has and the effect you
# care about. If three turn out too few, say "not decided by three seeds", write a new plan with, say, ten *new*
# ones, and report both.
# </details>

# %% [markdown]
# ## 4. Plan an ablation
# A method of yours is one file, and `make table2 METHODS="standard mine.py"` adds its row to Table 2
# ([how](../../REPRODUCING.md#a-method-of-your-own)). An ablation is a method with *one* thing changed. Choose one
# that you would like to know: the line beside a network (lesson 6), wider layers, another α, squares instead of
# absolute values, half of the training poses (then you expect an error that is *larger* by at least so much), …
#
# **Exercise 4: a plan** (15 minutes). Fill in a `Plan`; what each entry means, with a command as an
# example, is in `help(lesson8.Plan)`. The check reads it as a referee would. It then prints a seal, twelve
# characters that any change of the plan would
# change: put it on the board *before* you run anything, and nobody can say that you moved the posts.


# %% exercise="plan"
def plan():
    """Return a lesson8.Plan for an ablation of your own."""
    ### BEGIN SOLUTION
    return lesson8.Plan(
        hypothesis="Beside a line a dense network has smaller normal errors because it need not learn the line",
        base="dense",
        changes=("the network adds to ridge regression, whose weights stay fixed",),
        metric="normal_error_mean",
        least_effect=0.9,
        characters=("teen", "toon"),
        seeds=(0, 1, 2),
        chosen_on="validation",
        beside=("linear", "neutral"),
        command='make table2 METHODS="dense linear neutral mine.py" CHARACTERS="teen toon" SEED="0 1 2"',
    )
    ### END SOLUTION


# %% check="plan" points=3
from course.checks.lesson8 import check_plan

check_plan(plan)

# %% [markdown]
# **Try.** Run it. With `PROFILE=quick CHARACTERS=tiny` it is minutes, and good for finding mistakes in `mine.py`,
# but no answer to your question. And swap plans with somebody: what would you still be able to argue about after
# their numbers are in?
#
# ## Go further
# - Henderson, Islam, Bachman, Pineau, Precup, Meger: *Deep Reinforcement Learning That Matters*, AAAI 2018. Two
#   halves of the same ten seeds, "significantly" different.
# - Bouthillier et al.: *Accounting for Variance in Machine Learning Benchmarks*, MLSys 2021. Which sources of
#   variance count, and how many seeds one needs.
# - Kapoor, Narayanan: *Leakage and the Reproducibility Crisis in Machine-Learning-Based Science*, Patterns 2023.
#   Eight kinds of leaks, and the papers that have them.
# - Ferrari Dacrema, Cremonesi, Jannach: *Are We Really Making Much Progress?*, RecSys 2019. Simple baselines,
#   tuned, against deep networks.
# - Nosek, Ebersole, DeHaven, Mellor: *The Preregistration Revolution*, PNAS 2018. Why plans are sealed.
# - Lipton, Steinhardt: *Troubling Trends in Machine Learning Scholarship*, ACM Queue 2019. Explanations that
#   nobody has tested.
#
# **Next.** That was the last lesson. You have opened a rig, skinned it, measured it, taught a network its
# creases, turned it round, and judged it. What is left is a question of your own: write `mine.py`, seal a plan,
# and tell us what you find, above all if the answer is no.
