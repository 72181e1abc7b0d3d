"""A page to pose a face in (§5.3.1): control points that are dragged, IK networks, and our method's face, in a browser."""
