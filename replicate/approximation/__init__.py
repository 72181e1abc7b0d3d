"""The approximation of a rig by networks (§3), and the baselines that it is compared with."""
