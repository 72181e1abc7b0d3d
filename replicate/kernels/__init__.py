"""Compiled twins of what training spends its time on."""
