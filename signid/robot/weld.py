"""A Pinocchio model in which joints that are held are welded: their bodies become one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..types import Array

if TYPE_CHECKING:
    import pinocchio as pin


def weld(model: pin.Model, held: Sequence[int], configuration: Array) -> pin.Model:
    """The bodies of held joints become part of those that carry them; what a model calls its links is lost.

    Args:
        model: is left as it is.
        held: numbers of the joints in the model.
        configuration: (nq,) where they are held [rad, m or 1].
    """
    import pinocchio as pin

    named = pin.Model(model)
    for i, frame in enumerate(named.frames):
        if frame.type == pin.FrameType.BODY:
            frame.name = f"body {i}"  # Pinocchio refuses a link that has the name of a joint
    return pin.buildReducedModel(named, list(held), configuration)
