"""What is drawn: renders, heatmaps and the figures of the paper."""
