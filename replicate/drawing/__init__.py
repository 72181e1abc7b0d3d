"""How meshes become pictures: scenes, renderers, heatmaps, panels, one style for all charts."""
