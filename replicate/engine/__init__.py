"""How work is run and kept: stages, the store of their artefacts, worker processes. Nothing here is about faces."""
