"""Speed and memory, measured against a peer in the same run; one module a `make bench-…`."""

from replicate.base.signals import end_with_make

end_with_make()  # here, since a benchmark imports torch before it does anything
