"""Poses and clips as files for other programs: OBJ, GLB, and GLB with animated morph targets."""
