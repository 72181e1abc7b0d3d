"""What the paper's networks are measured against: dense networks, regressions, skinning."""
