"""What the tables compare: a module for each method."""
