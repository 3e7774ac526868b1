"""What an estimator is, and what it is given."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...regression.factors import Factors, Weigh
from ...regression.session import Options, Part, Session
from ...types import Array, BaseMap, Estimate, Frozen, Progress


@dataclass(frozen=True, eq=False)
class Given(Frozen):
    """What one identification knows before base parameters are estimated."""

    session: Session
    factors: Factors  # of the recordings to learn from
    prior: Array  # (b,) [units of base] values kept where the recordings tell nothing
    whiten: bool = True
    weigh: Weigh | None = None  # robust weights of the rows
    progress: Progress | None = None

    @property
    def base(self) -> BaseMap:
        """Which base parameters are asked for."""
        return self.session.task.base

    def reduce(self, parts: Sequence[Part], purpose: str, instruments: bool = False) -> Factors:
        """Factors of parts that stand for the recordings.

        Args:
            parts: recordings in memory, on the uniform grid.
            purpose: what a person is told.
            instruments: whether their desired positions give instruments.
        """
        session = replace(self.session, task=replace(self.session.task, instruments=instruments))
        lags = len(self.factors.joints[0].grams) - 1
        return session.reduce(parts, weigh=self.weigh, progress=self.progress, purpose=purpose, lags=lags)


class Estimator(ABC):
    """One way from rows to base parameters."""

    name: str
    title: str  # what an estimate by it says of itself
    source: str

    def options(self, options: Options) -> Options:
        """How it wants recordings to be turned into rows: as asked for, without instruments of their own."""
        return replace(options, instruments=False)

    @abstractmethod
    def estimate(self, given: Given) -> Estimate:
        """Base parameters with their covariance.

        Raises:
            OptionError: the recordings lack what the estimator needs.
        """
