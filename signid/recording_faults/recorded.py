"""Faults of recordings that nothing is fitted to, or whose fit cannot show them, as sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..estimation.excitation import ExcitationVerdict
from ..model import Model
from ..regression.session import Options, prepare
from ..types import Recording
from .examine import examine
from .result import REFUSE, WARN
from .samples import naming_faults

OF_A_FIT = ("too little data", "excitation")  # kinds of faults that matter only for a fit
NO_EXCITATION = ExcitationVerdict(np.ones(1), np.ones(1), (), (), (), (), ())  # not judged: nothing is fitted


def recording_flags(model: Model, recordings: Sequence[Recording], options: Options | None = None) -> tuple[str, ...]:
    """A sentence on each fault of recordings with signed torque, apart from those that matter only for a fit.

    Raises:
        InputError: a recording cannot be used, or moves other joints than the model; the sentence says which and why.
    """
    session = prepare(model.robot, recordings, recordings, options)
    with naming_faults(session):
        found = examine(model, session, NO_EXCITATION).findings
    severe = [fault for severity in (REFUSE, WARN) for fault in found if fault.severity == severity]
    return tuple(dict.fromkeys(fault.sentence for fault in severe if fault.kind not in OF_A_FIT))
