"""*Fast and Deep Facial Deformations*, replicated.

Start with examples/train_one.py: one page from a rig through its networks to their errors and a picture.

With the paper open, this is where its ideas stand:

Fig. 2   maps I_k and their sampling g            approximation/deformation_map.py
Fig. 3   the network that makes a map             approximation/cnn.py
§3.1     segments and what each network sees      approximation/segments.py
§3.1     which control moves which vertex         approximation/influence.py
Eq. 1    the loss                                 approximation/losses.py
§3.2     the refinement networks                  approximation/refinement.py
Eq. 2    where a refinement is needed             approximation/refinement.py
Eq. 3    the best rigid motion                    geometry/alignment.py
Eq. 3    which segments are rigid                 approximation/rigid.py
Eq. 4    the vertices that carry them             approximation/rigid.py
Eq. 5    poses beyond the animation               approximation/sampling.py
§3.5     balanced draws                           approximation/sampling.py
§3.5     the samples on disk                      approximation/samples.py
§3.5     the training loop                        approximation/training.py
Eq. 6    minimised by iteration                   inverse/solver.py
Eq. 7    the IK networks                          inverse/ik_network.py
§4.1     control points, region by region         inverse/control_points.py
Eq. 8–10 their losses, §4.2 their training        inverse/ik_network.py
§5.1     the dense baseline                       baselines/dense.py
§5.1     linear blend skinning (SSDR)             baselines/skinning/ssdr.py
§5.1     errors over all unique test poses        approximation/metrics.py
Eq. 11   the normal error                         approximation/metrics.py
§5.2     the time of single poses                 timing/single_poses.py
§5.3.1   posing in a browser                      poser/pack.py
§5.3.2   landmarks become control points          capture/landmark_motion.py
§5.3.2   what landmarks drive, as an animation    capture/capture_files.py
Table 1  model sizes                              targets/table1/
Table 2  approximation errors                     targets/table2/
Table 3  milliseconds a pose                      targets/table3/
Table 4  errors in poses of inverse kinematics    targets/table4/
Fig. 1   the rig beside approximations            targets/figure01.py
Fig. 5   training poses                           targets/figure05.py
Fig. 7   mesh segments                            targets/figure07.py
Fig. 8   refinement segments                      targets/figure08.py
Fig. 9   forehead wrinkles                        targets/figure09/
Fig. 10  heatmaps of normal errors                targets/figure10.py
Fig. 11  faces that inverse kinematics poses      targets/figure11.py
Fig. 12  performance capture, scored              targets/figure12/
Fig. 13  the networks on another mesh             targets/figure13/

Which of the paper's claims our numbers bear out is judged in targets/claims/, a rule each.

A row of a table is a module of methods/, what methods share stands in methods/artefacts.py, what `make` makes is a
module or folder of targets/, listed in targets/targets.toml; engine/ runs and keeps the work.
"""

TYPE_CHECKING = False  # for type checkers, which take it for true; importing typing would take longer than all else

if TYPE_CHECKING:
    import pandas


def results(run: str = "reference") -> "pandas.DataFrame":
    """Return all results of a run as one tidy DataFrame, a number a row, with the columns of results/README.md.

    run: a profile, "quick", "laptop" or "paper", for your run with it; "bench" for your benchmarks; "reference" for the
    results that the project comes with, "reference_paper_profile" for those of them with the profile `paper`,
    "reference_clips" for those whose test poses are of whole clips, "reference_gpu" for Table 3 by a machine with a
    GPU; "published" for the paper's own. Raises InputError for another name, with the `make` target that writes them
    for results that aren't there, and with file and line for a file of anything else.
    """
    from replicate.report.results import read_run  # not before it is asked for: it loads pandas

    return read_run(run)
