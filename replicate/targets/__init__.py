"""What `make` makes: a folder or a module for each table, figure and command."""
