"""How long one pose takes (§5.2): of the rig, of every method, and of the plain way to evaluate the same networks."""
