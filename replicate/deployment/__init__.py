"""Models that leave the suite: an approximation whole, in a form that other programs run."""
