"""What is broken in a pose: folded skin, teeth through lips, eyes that lids do not cover."""
