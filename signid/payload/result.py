"""Load of the last link, with standard deviations, and the moments at which it was picked up and put down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..effects import EFFECTS
from ..errors import OptionError
from ..model import Model
from ..types import Array, Input, Law, Result, Robot
from .carried import with_payload
from .load import Load


class LoadMoment(NamedTuple):
    """When the load was picked up, or put down."""

    t: float  # [s] in the recording
    std: float  # [s]
    picked_up: bool


@dataclass(frozen=True, eq=False)
class Payload(Result):
    """Body that the last link carries. `flags` name unreliable results; empty if there are none."""

    robot: Robot
    link: str  # link that carries the load; the load is expressed in the frame of its joint
    inertial: Array  # (10,) in Pinocchio's order, about the joint's frame [kg, kg.m, kg.m2]; NaN: no load was found
    covariance: Array  # (10, 10) of the difference before it was made feasible [products of their units]
    unidentified: tuple[str, ...]  # unidentifiable ones of mass, centre and inertia
    moved: float  # [standard deviations] largest change of an identifiable number by feasibility
    misfit: float  # [1] variance of the residual of the difference over that of noise; above 1 it widens the intervals
    drifted: float  # [1] largest change of friction or offset, over its prior standard deviation
    inputs: tuple[Input, ...]
    cutoff: float  # [Hz]
    seed: int
    flags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    moments: tuple[LoadMoment, ...] = ()  # in one recording; empty for separate recordings
    bare: Model | None = None  # the given model

    @property
    def found(self) -> bool:
        """Whether there is a load."""
        return bool(np.isfinite(self.inertial[0]))

    @property
    def load(self) -> Load:
        """Load about the frame of the last joint."""
        return Load(self.inertial, self.covariance)

    @property
    def mass(self) -> tuple[float, float]:
        """Mass of the load, and its standard deviation [kg]."""
        return self.load.mass

    @property
    def centre(self) -> tuple[Array, Array]:
        """Centre of mass (3,) [m], and its standard deviation (3,) [m]."""
        return self.load.centre

    @property
    def inertia(self) -> tuple[Array, Array]:
        """Inertia (6,) about the centre of mass, xx, xy, yy, xz, yz, zz [kg.m2], and its standard deviation (6,)."""
        return self.load.inertia

    @property
    def law(self) -> Law:
        """Load as a law of a model.

        Raises:
            OptionError: no load was found.
        """
        if not self.found:
            raise OptionError("no load was found, so it is no law; see the flags of the result")
        effect = EFFECTS["payload"]
        values = dict(zip(effect.parameters, self.inertial.tolist(), strict=True))
        return Law(effect, (len(self.robot.joints) - 1,), values)

    @property
    def model(self) -> Model:
        """The given model with the load, beside what it carried before.

        Raises:
            OptionError: no load was found.
        """
        if not self.found or self.bare is None:
            raise OptionError("no load was found, so no model has it; see the flags of the result")
        return with_payload(self.bare, self.inertial, self.covariance)
