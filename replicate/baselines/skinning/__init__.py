"""Linear blend skinning as a baseline: SSDR (Le and Deng 2012)."""
