"""Our own method: a basis and a network a region of the face."""
