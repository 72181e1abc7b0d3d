"""Faces of glTF files (GLB, glTF with its buffers, VRM) with vertices in file order, shapes and joints."""
