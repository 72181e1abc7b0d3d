"""A page to pose a face in (§5.3.1): dragged control points, IK networks and our method's face, in a browser."""
