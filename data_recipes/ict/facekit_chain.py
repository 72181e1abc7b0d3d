"""The chain of faces in ICT-FaceKit's format: their nodes, and the eyeballs that turn with their looks."""

from data_recipes.deformers.node_chain import Chain
from data_recipes.ict.facekit_eyeballs import pose
from data_recipes.ict.facekit_nodes import NODES

FACEKIT = Chain("ict", NODES, pose)
