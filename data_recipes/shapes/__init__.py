"""Faces of summed shapes from files that nobody here made: a glTF with morph targets, or a folder with a mesh a shape."""
