"""Recordings whose torque lost its sign -> signs, and the recordings as if they had been measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import OptionError
from ..session import Options, Progress
from ..types import Recording, Robot
from .result import Signs

METHODS = ("exact", "tree")


@dataclass(frozen=True)
class Recovered:
    """Recordings with signed torque, and what is known about the signs that were found."""

    recordings: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    signs: Signs | None = None  # None where every torque had its sign

    @property
    def flags(self) -> tuple[str, ...]:
        """When not to trust the signs."""
        return () if self.signs is None else self.signs.flags

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done."""
        return () if self.signs is None else self.signs.notes


def recover(
    robot: Robot,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    *,
    method: str = "exact",
    options: Options | None = None,
    progress: Progress | None = None,
) -> Recovered:
    """The recordings with the signs of all torques."""
    if method not in METHODS:
        raise OptionError(f"signs {method!r} is none of {', '.join(METHODS)}")
    if all(r.signed.all() for r in (*recordings, *held_out)):
        return Recovered(tuple(recordings), tuple(held_out))
    unsigned = {j for r in (*recordings, *held_out) for j, s in zip(r.joints, r.signed, strict=True) if not s}
    raise OptionError(f"the torque of {', '.join(sorted(unsigned))} has no sign")
