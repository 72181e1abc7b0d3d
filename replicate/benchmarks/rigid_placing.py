"""What places the rigid segments of a method that is timed: its attachments, or nothing."""

from replicate.approximation.rigid import Attachments
from replicate.methods.method import Method


def placing_attachments(method: Method, attachments: Attachments) -> Attachments:
    """Return the attachments by which a method places rigid segments (§3.4); of one without that step, no segment's."""
    if method.rigid_step:
        return attachments
    return Attachments(**{name: array[:0] for name, array in vars(attachments).items()})
