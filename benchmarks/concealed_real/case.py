"""A case: simulation, recordings, known change and expected answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from signid.model import Model
from signid.types import Recording

Joints = tuple[int, ...]


@dataclass(frozen=True)
class Truth:
    """Expected findings for the change."""

    effects: tuple[str, ...]  # effects that count as right
    joints: Joints | None  # None: any
    numbers: Mapping[str, float] = field(default_factory=dict)  # parameters to be added to the simulation
    totals: Mapping[str, float] = field(default_factory=dict)  # parameters including those of the simulation
    std: float = 0.0  # standard deviation of these parameters; 0 for an exact change
    fault: str = ""  # recording fault of an accepted flag or refusal: sign, swap, late, early or gain
    last: bool = False  # payload and link_inertia of the last joint are equivalent


@dataclass(frozen=True)
class Case:
    """A model and recordings with one known change."""

    kind: str
    what: str
    model: Model
    b: Recording
    c: Recording
    truth: Truth
    complete: Model | None = None  # for physics missing by nature: a model that includes it
    before: Recording | None = None  # the same rows without the change, if they differ from the control's
    other: bool = False  # B differs from the control's recording, so rows cannot be compared
