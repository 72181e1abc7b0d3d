"""The same trained models, evaluated in other ways: one pose at a time as fast as a processor can (§5.2)."""
