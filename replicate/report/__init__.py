"""Results as people read them: tidy tables, text, notebooks, manifests, and their publication."""
