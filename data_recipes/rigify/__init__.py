"""Blender's Rigify face rig on a head of ours: where its bones go, how it is bound, what it acts, its samples."""
