"""Amount of data: filtered rows and unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..regression.rows import consumed
from ..regression.session import Part, Session
from .result import REFUSE, RecordingFault

PER_UNKNOWN = 2.5  # smallest number of rows per unknown, for the joint with most unknowns, to estimate noise
BEYOND = 3.0  # [1] largest cut-off over the highest frequency of the motion
MOTION = 6.25  # [Hz] highest frequency of a motion; rows beyond it have no new information
SPARE = 1.05  # [1] recommended duration over the necessary one


class Amount(NamedTuple):
    """Amount of data."""

    rows: int  # filtered rows of all recordings with new information
    unknowns: int  # of the joint with most of them
    seconds: float  # [s] of training data
    needed: float  # [s] of training data needed for `PER_UNKNOWN`
    whole: float  # [s] of training data and held-out data of the same recordings

    @property
    def enough(self) -> bool:
        """Whether there are enough rows to distinguish noise from unknowns."""
        return self.rows >= PER_UNKNOWN * self.unknowns


def judge_amount(session: Session, parts: Sequence[Part]) -> Amount:
    """Number of filtered rows and of unknowns."""
    band, task = session.task.band, session.task
    reach = consumed(band, task.recorded_derivatives)
    lengths = [s.length(span) for _, s in parts for span in s.spans]
    density, lost = 2 * min(band.cutoff, max(MOTION, band.cutoff / BEYOND)), len(lengths) * reach / band.rate
    rows = sum(int(max(0, length - reach) / band.rate * density) for length in lengths)
    unknowns = max((len(task.seen(j)) for j in range(len(task.robot.joints))), default=0)
    seconds, wanted = sum(s.duration for _, s in parts), PER_UNKNOWN * unknowns
    rest = sum(s.duration for r, s in session.held_out if any(r is used and s is not own for used, own in parts))
    needed = max(wanted / density + lost, seconds * wanted / max(rows, 1))
    return Amount(rows, unknowns, seconds, needed, seconds + rest)


def amount_fault(amount: Amount, joints: int) -> RecordingFault:
    """Fault of too little data to distinguish noise from unknowns."""
    training = "" if amount.whole == amount.seconds else " of training data"
    fact = f"{amount.seconds:.3g} s{training} of {joints} joint{'s' if joints > 1 else ''} are too little"
    why = f"{amount.rows} filtered rows per joint for {amount.unknowns} unknowns are too few to estimate the noise"
    measures = {"rows": float(amount.rows), "unknowns": float(amount.unknowns), "needed": amount.needed}
    share = amount.whole / amount.seconds if amount.seconds else 1.0
    advice = f"record for {np.ceil(SPARE * share * amount.needed):.0f} s or more"
    return RecordingFault("too little data", (), REFUSE, measures, f"{fact}: {why}; {advice}")
