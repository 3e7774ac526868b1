"""Estimators of base parameters, one per file: weighted least squares, and alternatives for noisy positions.

`ESTIMATORS["tls"].estimate` takes the inputs `Given` of one identification and returns an `Estimate`. To add an
estimator, write a file here and add its name below, or register it under the entry point `signid.estimators`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...recording import read_recording
from ...recording.sampling import survey
from ...registry import Registry
from ...regression.factors import Factors, Weigh
from ...regression.session import Options, Part, Session
from ...types import Array, BaseMap, Estimate, Frozen, Progress, Samples


@dataclass(frozen=True, eq=False)
class Given(Frozen):
    """Inputs of an estimator."""

    session: Session
    factors: Factors  # factors of the training recordings
    prior: Array  # (b,) [units of base] values of unidentifiable parameters
    whiten: bool = True  # whether noise is modelled as autoregressive
    weigh: Weigh | None = None  # robust weights of the rows
    progress: Progress | None = None

    @property
    def base(self) -> BaseMap:
        """Base map of the parameters to estimate."""
        return self.session.task.base

    def reduce(self, parts: Sequence[Part], purpose: str, instruments: bool = False) -> Factors:
        """Factors of other parts on the uniform grid; `instruments`: from their desired positions."""
        session = replace(self.session, task=replace(self.session.task, instruments=instruments))
        lags = len(self.factors.joints[0].grams) - 1
        return session.reduce(parts, weigh=self.weigh, progress=self.progress, purpose=purpose, lags=lags)


class Estimator(ABC):
    """Method that estimates base parameters from rows."""

    name: str
    title: str  # value of `Estimate.method`
    source: str

    def options(self, options: Options) -> Options:
        """Options with which recordings are turned into rows: those of the user, without recorded instruments."""
        return replace(options, instruments=False)

    @abstractmethod
    def estimate(self, given: Given) -> Estimate:
        """Estimate base parameters with their covariance.

        Raises:
            OptionError: the recordings lack what the estimator needs.
        """


def part_of(session: Session, piece: Samples) -> Part:
    """Recording in memory of uniform samples without gaps, without recorded derivatives."""
    columns = {"t": piece.t}
    for j, number in enumerate(session.robot.numbers):
        columns[f"q_{number}"] = piece.q[:, j]
        if not np.isnan(piece.tau[:, j]).all():
            columns[f"tau_{number}"] = piece.tau[:, j]
        if piece.q_des is not None:
            columns[f"q_des_{number}"] = piece.q_des[:, j]
    recording = read_recording(columns, session.robot)
    return recording, survey(recording, session.robot)


ESTIMATORS: Registry[Estimator] = Registry("estimators", __name__, "wls iv tls oe")
