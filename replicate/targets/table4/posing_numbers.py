"""The settings of Table 4's stage."""

from dataclasses import dataclass

from replicate.inverse.ik_config import InverseConfig
from replicate.methods.measurement import MeasurementNumbers


@dataclass(frozen=True)
class Source:
    """What IK networks are trained through: a method's name and "module:function" of its model; "" for the rig."""

    name: str
    model: str


@dataclass(frozen=True)
class PosingNumbers:
    """Whose table it is, what is measured, and through what inverse kinematics sees the rig.

    own_gradients: whether the paper's protocol feeds each method by networks trained through itself.
    """

    character: str
    profile: str
    seed: int
    section: InverseConfig
    methods: tuple[MeasurementNumbers, ...]
    sources: tuple[Source, ...]
    own_gradients: bool
