"""The chain of our own faces: the deformers of `face.py`, and the props that ride along."""

from data_recipes.deformers.face import NODES
from data_recipes.deformers.node_chain import Chain
from data_recipes.deformers.posed_props import pose

FACE = Chain("face", NODES, pose)
