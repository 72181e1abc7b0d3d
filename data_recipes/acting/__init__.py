"""How a character moves: expressions, speech and clips, all as values of its controls over time."""
