"""A rig taken apart, layer by layer, for the notebook of that name."""
