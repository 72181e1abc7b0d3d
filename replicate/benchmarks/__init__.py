"""Speed and memory, measured against a peer in the same run; one module a `make bench-…`."""
