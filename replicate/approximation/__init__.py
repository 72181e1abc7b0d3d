"""The approximation of a rig by networks (§3), and how its errors are measured (§5)."""
