"""Stages on other machines: Dask, and Slurm through it."""
