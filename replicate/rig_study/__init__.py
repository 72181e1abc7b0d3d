"""What rigs do: a tour of their layers, their health, how controls interact."""
