"""Performance capture (§5.3.2): tracked landmarks of an actor's face in, an animated character out."""
