"""The deformers, one per module: each prepares its constants once (numpy) and deforms batches of poses (JAX).

Inside the rig, positions are *planes* (b, 3, n): x, y, z of every vertex each contiguous, which lets the compiler
use whole vector registers and turns an operator on vertices into one matrix product. `face.py` stacks the deformers.
"""
