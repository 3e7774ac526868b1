"""Recordings -> check: which parameters they identify, and what would help, before a model is fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .estimation.excitation import ExcitationVerdict, judge_excitation
from .estimation.least_squares import estimate
from .faults import RecordingFaults, described_evidence, examine, naming_faults, under_found_gravity
from .model import Model, ModelSource, stated_inertials, stated_laws
from .recording import Recordings, as_recordings, without_torque
from .recording.sampling import Sampling
from .regression.bandwidth import Band
from .regression.session import Options, advice_on_rows
from .robot import as_robot, audit
from .signs import Signs, prepare_and_recover
from .signs.torque_constants import UnknownConstants
from .typed import typed
from .types import Array, BaseMap, Progress, Recording, Result, Robot

WEAK_RATIO, UNKNOWN_RATIO = 0.3, 1.0  # [1] expected over prior standard deviation: weak from there on, unidentifiable


@dataclass(frozen=True, eq=False)
class Check(Result):
    """Verdicts `identifiable`, `weak` or `unidentifiable` per base parameter, with advice in sentences."""

    robot: Robot
    base: BaseMap
    band: Band
    recordings: tuple[Recording, ...]
    samplings: tuple[Sampling, ...]
    used: Array  # (n,) [1] share of a joint's rows that are free of velocity reversals
    std: Array  # (b,) [units of base] standard deviation to expect
    verdicts: tuple[str, ...]  # (b,)
    excitation: ExcitationVerdict
    faults: RecordingFaults
    advice: tuple[str, ...]
    notes: tuple[str, ...]
    suspects: tuple[str, ...] = ()  # sentences of the audit of the description
    signs: Signs | None = None  # where torque was recorded without them

    @property
    def flags(self) -> tuple[str, ...]:
        """Reasons why the recordings are insufficient; empty when they are good."""
        lost = self.signs.flags if self.signs else ()
        columns = [flag for recording in self.recordings for flag in recording.flags]
        return tuple(dict.fromkeys((*self.suspects, *columns, *lost, *self.excitation.sentences, *self.faults.flags)))


@typed
def check(
    robot: ModelSource, recordings: Recordings, *, options: Options | None = None, progress: Progress | None = None
) -> Check:
    """Check recordings, all of them together; signs of unsigned torque are recovered first.

    Recording faults are detected with the inertials that the description states. Where the recordings clearly show
    another gravity than the stated one, the check is made with it, and a flag says so.

    Raises:
        InputError: a recording or an option cannot be used; the sentence says which and why.
    """
    robot = (described := audit(as_robot(robot, "check"))).robot
    recordings, options = as_recordings(recordings, robot, "check"), options or Options()
    try:
        recovered = prepare_and_recover(robot, recordings, recordings, options=options, progress=progress)
    except UnknownConstants as error:
        rest = [without_torque(recording, error.joints) for recording in recordings]
        if not all(any(recording.columns["tau"]) for recording in rest) or all(any(r.columns["q_des"]) for r in rest):
            raise  # nothing is left, or drives: their audit needs no torque
        made = check(robot, rest, options=options, progress=progress)
        return replace(made, suspects=(str(error), *made.suspects))
    session = recovered.session_to_fit(robot)
    signed = np.all([recording.signed for recording in recordings], axis=0)
    evidence = described_evidence(session, signed)
    if mounted := under_found_gravity(robot, evidence):
        made = check(mounted.robot, recordings, options=options, progress=progress)
        faults = replace(made.faults, findings=(mounted.fault, *made.faults.findings))
        return replace(made, faults=faults, suspects=described.before())
    with naming_faults(session):
        factors = session.reduce(session.train, progress=progress)
    found = estimate(factors, session.task.base, whiten=options.whiten)
    found = recovered.widen(found, factors, session.task.base, options.whiten)
    excitation = judge_excitation(session.task, factors, found, options.seed)
    stated = Model(session.robot, stated_inertials(session.robot), stated_laws(session.robot))
    faults = examine(stated, session, excitation, signed, evidence)
    used = np.array([f.counts[0] / f.rows if f.rows else 0.0 for f in factors.joints])
    weak = {name for group in excitation.weak for name in group}
    verdicts = tuple(
        "unidentifiable" if s >= UNKNOWN_RATIO * p or e in weak else "weak" if s >= WEAK_RATIO * p else "identifiable"
        for s, p, e in zip(found.std, excitation.prior, session.task.base.expressions, strict=True)
    )
    return Check(
        session.robot,
        session.task.base,
        session.task.band,
        tuple(r for r, _ in session.train),
        tuple(s for _, s in session.train),
        used,
        found.std,
        verdicts,
        excitation,
        faults,
        advice_on_rows(session, factors, used),
        tuple(dict.fromkeys((*described.notes, *recovered.notes, *session.notes, *faults.notes))),
        described.before(),
        recovered.signs,
    )
