"""What one identification works on: its options, and its recordings ready to be reduced."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from .effects import EFFECT_NAMES
from .errors import RecordingError
from .factors import LAGS, Factors, Weigh, add, reduce_rows
from .rows import Rows, Task, read_rows
from .sampling import Sampling
from .types import Frozen, Recording, Robot

Progress = Callable[[str, float], None]  # what is being done, share of it that is done
Part = tuple[Recording, Sampling]


@dataclass(frozen=True, eq=False)
class Options(Frozen):
    """How recordings are turned into rows. Every default is what the data themselves suggest."""

    effects: tuple[str, ...] = EFFECT_NAMES
    cutoff: float | None = None  # [Hz]; None: from the encoder noise; inf: no filter
    derivatives: str = "auto"  # "auto", "computed" from q, "recorded" dq and ddq
    instruments: bool = True  # use q_des where every joint has it
    whiten: bool = True  # autoregressive noise; False: white noise per joint
    robust: bool = False  # Huber weights against outliers
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Session(Frozen):
    """One robot's recordings, ready to be reduced."""

    task: Task
    train: tuple[Part, ...]
    held_out: tuple[Part, ...]
    notes: tuple[str, ...]

    @property
    def robot(self) -> Robot:
        """With the joints held that the recordings do not move."""
        return self.task.robot

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
        factors = add(
            reduce_rows(self.task, _told(self.task, part, progress, purpose), lags=lags, weigh=weigh) for part in parts
        )
        if factors.rows == 0:
            band = self.task.band
            raise RecordingError(
                f"no stretch of the recordings is as long as the filter for {band.cutoff:.3g} Hz "
                f"({len(band.taps) / band.rate:.2g} s); record for longer, or raise the cut-off"
            )
        return factors


def _told(task: Task, part: Part, progress: Progress | None, purpose: str) -> Iterator[Rows]:
    recording, sampling = part
    total = max(1, sum(sampling.length(span) for span in sampling.spans) // task.band.factor)
    done = 0
    for rows in read_rows(task, recording, sampling):
        yield rows
        done += len(rows.t)
        if progress is not None:
            progress(f"{purpose} {recording.path or 'recording'}", min(1.0, done / total))
