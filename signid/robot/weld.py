"""Weld held joints of a Pinocchio model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..types import Array

if TYPE_CHECKING:
    import pinocchio as pin


def weld(model: pin.Model, held: Sequence[int], configuration: Array) -> pin.Model:
    """Merge the bodies of held joints with their parents; the names of links are lost.

    Args:
        model: pin.Model, not modified.
        held: indices of the joints in the model.
        configuration: (nq,) configuration at which they are held [rad, m or 1].
    """
    import pinocchio as pin

    named = pin.Model(model)
    for i, frame in enumerate(named.frames):
        if frame.type == pin.FrameType.BODY:
            frame.name = f"body {i}"  # Pinocchio rejects links with the name of a joint
    return pin.buildReducedModel(named, list(held), configuration)
