"""Faces of summed shapes from anybody's files: a glTF with morph targets, or a folder with a mesh for each shape."""
