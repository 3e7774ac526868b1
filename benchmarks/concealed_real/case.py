"""What a case is: a simulation and recordings, what was changed, and what the answer should be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from signid.model import Model
from signid.types import Recording

Joints = tuple[int, ...]


@dataclass(frozen=True)
class Truth:
    """What the simulation lacks, or the recording has."""

    effects: tuple[str, ...]  # any of which is right
    joints: Joints | None  # None: any
    numbers: Mapping[str, float] = field(default_factory=dict)  # what is to be added to the simulation
    wholes: Mapping[str, float] = field(default_factory=dict)  # with what it states already
    fault: str = ""  # the gross fault that a flag or a refusal may name: sign, swap, late, early or gain
    last: bool = False  # payload and link_inertia of the last joint count alike, with their numbers


@dataclass(frozen=True)
class Case:
    """One thing to diagnose."""

    kind: str
    what: str
    model: Model
    b: Recording
    c: Recording
    truth: Truth
    knowing: Model | None = None  # of what nature concealed: a model that has it
    before: Recording | None = None  # the rows of B without the change, where the control's are others
    other: bool = False  # its recording is another one, so that rows cannot be compared
