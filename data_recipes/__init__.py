"""Where ground truth comes from: rigs r(p), and the poses that drive them."""
