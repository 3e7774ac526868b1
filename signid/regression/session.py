"""Session: a robot's recordings, surveyed and split, with the options that their rows are made with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from ..effects import EFFECT_NAMES
from ..errors import OptionError, RecordingError
from ..recording.sampling import Sampling, samples
from ..types import Frozen, Input, Progress, Recording, Robot, Samples
from .factors import LAGS, Factors, Weigh, reduce_rows
from .rows import Rows, Task, read_rows

Part = tuple[Recording, Sampling]

TRAINING_SHARE = 0.7  # of a single recording
LEARNED, HELD_OUT, REFERENCE = "learned from", "held out", "of the healthy robot"
SHARED = f"learned from, except the last {1 - TRAINING_SHARE:.0%}, which is held out"
PIECE = 2**17  # samples of a recording from which the cut-off is chosen
SAME_RATE = 0.01  # relative difference that sampling rates of recordings may have


@dataclass(frozen=True, eq=False)
class Options(Frozen):
    """Options of the way from recordings to rows. Defaults come from the data."""

    effects: tuple[str, ...] = EFFECT_NAMES
    cutoff: float | None = None  # [Hz]; None: from the encoder noise; inf: no filter
    derivatives: str = "auto"  # "auto", "computed" from q, "recorded" dq and ddq
    instruments: bool = True  # use q_des where every joint has it
    whiten: bool = True  # autoregressive noise; False: white noise per joint
    robust: bool = False  # Huber weights against outliers
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Session(Frozen):
    """One robot's recordings, surveyed and split, and what their rows are made for."""

    task: Task
    train: tuple[Part, ...]
    held_out: tuple[Part, ...]  # the same object as `train` where nothing is held out
    notes: tuple[str, ...]
    given: tuple[tuple[Part, ...], tuple[Part, ...]] = ((), ())  # whole recordings: to learn from, and to hold out
    options: Options = Options()

    @property
    def robot(self) -> Robot:
        """The robot with the joints held that the recordings do not move."""
        return self.task.robot

    @property
    def whole(self) -> tuple[Part, ...]:
        """Every recording once, not split, in the order in which it was given."""
        return tuple(dict((*self.given[0], *self.given[1])).items())

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """Every recording once, in the order in which it was given."""
        return tuple(recording for recording, _ in self.whole)

    @property
    def signed(self) -> bool:
        """Whether every torque has its sign."""
        return all(recording.signed.all() for recording in self.recordings)

    @property
    def learned(self) -> tuple[Part, ...]:
        """The recordings of which at least a part is learned from, not split."""
        train = {recording for recording, _ in self.train}
        return tuple(part for part in self.whole if part[0] in train)

    def exchange(self, new: Mapping[Recording, Recording]) -> Session:
        """The same with other recordings of the same rows in the place of some."""
        train, held_out, *given = (
            tuple((new.get(recording, recording), sampling) for recording, sampling in parts)
            for parts in (self.train, self.held_out, *self.given)
        )
        held_out = train if self.judges_itself else held_out
        return replace(self, train=train, held_out=held_out, given=(given[0], given[1]))

    @property
    def judges_itself(self) -> bool:
        """Whether nothing is held out: the training data serve for evaluation as well."""
        return bool(self.train) and self.held_out is self.train

    def reduce(
        self,
        parts: Sequence[Part],
        weigh: Weigh | None = None,
        progress: Progress | None = None,
        purpose: str = "learning from",
        lags: int = LAGS,
    ) -> Factors:
        """Factors of some of its recordings, in one pass.

        Raises:
            RecordingError: every stretch of the recordings is shorter than the filter.
        """
        rows = chain.from_iterable(_rows(self.task, part, progress, purpose) for part in parts)
        factors = reduce_rows(self.task, rows, lags=lags, weigh=weigh)
        if factors.rows == 0:
            band, these = self.task.band, "what is held out" if parts is self.held_out else "the recordings"
            raise RecordingError(
                f"no stretch of {these} is as long as the filter for {band.cutoff:.3g} Hz "
                f"({len(band.taps) / band.rate:.2g} s); record for longer, or raise the cut-off"
            )
        return factors


def longest_piece(part: Part, most: int = PIECE) -> Samples:
    """The longest stretch of a recording without a gap, or its beginning where that is very long."""
    recording, sampling = part
    span = max(sampling.spans, key=sampling.length)
    return samples(recording, sampling, span, 0, min(sampling.length(span), most))


def common_rate(parts: Sequence[Part], advice: str) -> float:
    """The sampling rate of all recordings [Hz].

    Raises:
        RecordingError: they differ; the sentence ends with the advice.
    """
    rates = np.array([1 / sampling.period for _, sampling in parts])
    if np.ptp(rates) > SAME_RATE * rates.min():
        listed = ", ".join(f"{rate:.6g} Hz" for rate in rates)
        raise RecordingError(f"the recordings are sampled at different rates ({listed}); {advice}")
    return float(rates[0])


def recordings_used(
    recordings: Sequence[Recording], held_out: Sequence[Recording], reference: Sequence[Recording] = ()
) -> tuple[Input, ...]:
    """Recordings with their roles, as a session splits them; reference recordings are of the healthy robot."""
    parts = [(LEARNED, recordings[:-1]), (HELD_OUT, recordings[-1:])] if len(recordings) > 1 else [(SHARED, recordings)]
    parts = [(LEARNED, recordings), (HELD_OUT, held_out)] if held_out else parts
    roles = {(r.path, r.sha256): role for role, some in [*parts, (REFERENCE, reference)] for r in some}
    return tuple(Input(path, digest, f"recording, {role}") for (path, digest), role in roles.items())


def only_once(recordings: Sequence[Recording]) -> None:
    """Check that each recording was given once.

    Raises:
        OptionError: one was given twice, perhaps under two names.
    """
    seen: dict[str, str] = {}
    for recording in recordings:
        if recording.sha256 in seen:
            one, other = recording.path or "one recording", seen[recording.sha256] or "another"
            raise OptionError(
                f"{one} holds the same samples as {other}; give each recording once, to learn from or as held out"
            )
        seen[recording.sha256] = recording.path


def _rows(task: Task, part: Part, progress: Progress | None, purpose: str) -> Iterator[Rows]:
    recording, sampling = part
    total = max(1, sum(sampling.length(span) for span in sampling.spans) // task.band.factor)
    done = 0
    for rows in read_rows(task, recording, sampling):
        yield rows
        done += len(rows.t)
        if progress is not None:
            progress(f"{purpose} {recording.path or 'recording'}", min(1.0, done / total))
