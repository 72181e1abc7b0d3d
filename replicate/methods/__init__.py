"""What the tables compare: a module for each method; `METHODS=path/to/mine.py` adds one from outside.

A module has a `METHOD` (see `method.Method`): name, label and footnote, its stages, and how to read their artefacts,
as a model that predicts offsets or as a function from rig parameters to vertices. `method_registry` lists them.
"""
