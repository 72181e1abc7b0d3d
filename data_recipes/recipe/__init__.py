"""A recipe: the TOML file that a character is built from, its keys, their ranges, and how it is read."""
