"""How meshes become pictures: scenes, light, heatmaps, panels, one style for all charts."""
