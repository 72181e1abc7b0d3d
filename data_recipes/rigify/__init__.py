"""Blender's Rigify face rig on a head of ours: its joints, its binding, its animation and its samples."""
