"""What every method builds on: a module for each artefact, with its stage, its function and its one loader."""
