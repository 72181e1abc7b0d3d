"""The approximations of a rig: coarse and refined CNNs, dense networks and linear blend skinning (§3, §5.1)."""
