"""Base class and inputs of estimators."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...regression.factors import Factors, Weigh
from ...regression.session import Options, Part, Session
from ...types import Array, BaseMap, Estimate, Frozen, Progress


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
        """Factors of other parts, reduced like the training recordings.

        Args:
            parts: recordings in memory, on the uniform grid.
            purpose: step that the progress bar shows.
            instruments: whether their desired positions give instruments.
        """
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
