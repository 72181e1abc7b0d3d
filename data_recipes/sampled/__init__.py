"""Rigs that are known by their samples alone: a folder with a mesh, a list of controls, and poses with vertices."""
