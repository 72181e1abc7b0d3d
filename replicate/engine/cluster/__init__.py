"""Stages on other machines: through Dask, and through Dask on Slurm."""
