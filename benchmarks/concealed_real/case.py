"""A case: a simulation, recordings, the change that was made, and the expected answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from signid.model import Model
from signid.types import Recording

Joints = tuple[int, ...]


@dataclass(frozen=True)
class Truth:
    """The change, as a diagnosis should name it."""

    effects: tuple[str, ...]  # any of which is right
    joints: Joints | None  # None: any
    numbers: Mapping[str, float] = field(default_factory=dict)  # to be added to the simulation
    totals: Mapping[str, float] = field(default_factory=dict)  # together with what the simulation states
    std: float = 0.0  # of these numbers; 0 where the change is exact
    fault: str = ""  # recording fault that a flag or a refusal may name: sign, swap, late, early or gain
    last: bool = False  # payload and link_inertia of the last joint are the same, with their numbers


@dataclass(frozen=True)
class Case:
    """A model and recordings with one known change."""

    kind: str
    what: str
    model: Model
    b: Recording
    c: Recording
    truth: Truth
    complete: Model | None = None  # for physics that nature concealed: a model that includes it
    before: Recording | None = None  # the same rows without the change, where they are not those of the control
    other: bool = False  # B is another recording than the control's, rows cannot be compared
