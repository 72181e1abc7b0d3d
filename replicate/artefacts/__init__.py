"""What every method stands on: a module for each artefact, with its stage, how it is made, and its one loader."""
