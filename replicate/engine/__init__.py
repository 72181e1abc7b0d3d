"""How work is run and kept: stages, the store of their artefacts, worker processes. It knows nothing of faces."""
