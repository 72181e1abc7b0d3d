"""The command line: its targets and options, and how a target makes its graph."""
