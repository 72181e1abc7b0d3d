"""A page to pose a face in (§5.3.1): dragged control points, IK networks and an approximation's face, in a browser."""
