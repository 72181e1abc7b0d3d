"""A course of eight lessons on faces that move: sources in lessons/, what their checks ask in checks/."""
