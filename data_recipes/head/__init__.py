"""A character's neutral head: shape, topology, placement, charts, paint and props."""
