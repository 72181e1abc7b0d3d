"""Compiled inner loops; each has a clear twin in plain torch or numpy, which it is tested against."""
