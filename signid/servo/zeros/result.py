"""Sign and zero of a joint's recorded positions against its description."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class JointZero:
    """Position of the description = sign * recorded position + zero, of one joint."""

    joint: str
    sign: int  # 1 or -1
    sign_probability: float  # [1] 0.5 where gravity is the same with either sign
    zero: float | None  # [rad] None where it is not identifiable at all
    std: float | None  # [rad]
    identifiable: bool  # whether gravity shows sign and zero
    changed: bool  # whether it surely is not as the description says
    probability: float  # [1] that sign or zero are not as the description says
