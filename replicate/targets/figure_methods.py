"""Which methods Figures 1 and 9 show beside the truth, in their order."""

FIGURE01 = ("refined", "regional", "lbs32")
FIGURE09 = ("refined", "regional", "lbs32", "coarse", "floor_refined")
