"""Which parameters a robot's structure makes identifiable, and which its recordings identify, before a fit."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from .effects import EFFECT_NAMES, EFFECTS
from .errors import InputError, RecordingError
from .estimation.excitation import ExcitationVerdict, judge_excitation
from .estimation.least_squares import estimate
from .faults import (
    RecordingFaults,
    ServoAudit,
    UnusableRecordings,
    described_evidence,
    examine,
    naming_faults,
    under_found_gravity,
)
from .model import Model, ModelSource, stated_inertials, stated_laws
from .recording import Recordings, as_recordings
from .recording.mapping import ColumnMap, read_map
from .recording.sampling import Sampling
from .recording.source import Source, open_source
from .regression.bandwidth import Band
from .regression.base_parameters import build_base
from .regression.session import Options, advice_on_rows
from .robot import Audit, Suspect, as_robot, audit
from .signs import Signs, prepare_and_recover
from .signs.torque_constants import UnknownConstants
from .typed import typed
from .types import Array, BaseMap, Input, Law, Progress, Recording, Result, Robot

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
        columns = [flag for recording in self.recordings for flag in recording.flags]
        signs = self.signs.flags if self.signs else ()
        return tuple(dict.fromkeys((*self.suspects, *columns, *signs, *self.excitation.sentences, *self.faults.flags)))


@typed
def check(
    robot: ModelSource, recordings: Recordings, *, options: Options | None = None, progress: Progress | None = None
) -> Check | ServoAudit | UnusableRecordings:
    """Check recordings, all of them together; signs of unsigned torque are recovered first.

    >>> signid.check("3r", "robots/3r/recording.parquet").excitation.sufficient
    True

    Recording faults are detected with the inertials that the description states. Where the recordings clearly show
    another gravity than the stated one, the check is made with it, and a flag says so. Recordings with commanded
    positions and without usable torque are audited. Those that can be opened and not be checked are returned as such,
    with the reason as their flag; currents whose torque constants are unknown are left out, flagged.

    Raises:
        InputError: a recording cannot be opened, or an option cannot be used; the sentence says which and why.
    """
    described = audit(as_robot(robot, "check"))
    try:
        recordings = as_recordings(recordings, described.robot, "check")
        return _checked(described, recordings, options or Options(), progress)
    except (RecordingError, np.linalg.LinAlgError, ArithmeticError) as error:
        several = isinstance(recordings, Sequence) and not isinstance(recordings, str)
        return unusable(recordings if several else [recordings], error)  # type: ignore[arg-type]


def unusable(
    recordings: Sequence[Recording | Source], error: Exception, columns: ColumnMap | None = None
) -> UnusableRecordings:
    """Recordings that cannot be checked, and why.

    Raises:
        RecordingError: one cannot be opened.
    """
    numbers = f"numbers lead to no result ({error}); check their units"
    reason, files, rows = str(error) if isinstance(error, RecordingError) else numbers, list[Input](), list[int]()
    for given in recordings:
        read = given if isinstance(given, Recording) else open_source(given, (), read_map(columns).heading)
        files.append(Input(read.path, read.sha256, "recording"))
        rows.append(read.table.rows)
    return UnusableRecordings(tuple(files), tuple(rows), (reason,))


def _checked(
    described: Audit, recordings: Sequence[Recording], options: Options, progress: Progress | None
) -> Check | ServoAudit:
    """Check of torque, or audit of drives; currents whose constants are unknown are left out, and named."""
    from .faults.commands import audit_servos

    kinds = zip(described.robot.joints, described.robot.prismatic, strict=True)
    units = {joint: "m" if slides else "rad" for joint, slides in kinds}
    if recordings and not any(any(recording.columns["tau"]) for recording in recordings):
        return audit_servos(recordings, units)
    try:
        return _judged(described, recordings, options, progress)
    except InputError as error:
        if any(r.scaled is not None for r in recordings) and all(any(r.columns.get("q_des", ())) for r in recordings):
            note = f"position drives are checked from q_des_J instead of torque: {error}"
            with suppress(InputError):
                found = audit_servos(recordings, units)
                return replace(found, notes=(note, *found.notes))
        if not isinstance(error, UnknownConstants):
            raise
        try:
            made = _checked(described, error.left_out(recordings), options, progress)
        except UnknownConstants:
            raise RecordingError(str(error)) from None
        return replace(made, suspects=(str(error), *made.suspects)) if isinstance(made, Check) else made


def _judged(described: Audit, recordings: Sequence[Recording], options: Options, progress: Progress | None) -> Check:
    robot = described.robot
    recovered = prepare_and_recover(robot, recordings, recordings, options=options, progress=progress)
    session = recovered.session_to_fit(robot)
    signed = np.all([recording.signed for recording in recordings], axis=0)
    evidence = described_evidence(session, signed)
    if mounted := under_found_gravity(robot, evidence):
        made = _judged(replace(described, robot=mounted.robot), recordings, options, progress)
        return replace(made, faults=replace(made.faults, findings=(mounted.fault, *made.faults.findings)))
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


@dataclass(frozen=True, eq=False)
class Inspection(Result):
    """Base parameters of a robot, from its structure alone, and numbers of its description that are probably wrong."""

    robot: Robot
    base: BaseMap
    suspect: tuple[Suspect, ...] = ()
    flags: tuple[str, ...] = ()  # sentences on the suspects, each once

    @property
    def invisible(self) -> tuple[str, ...]:
        """Standard parameters without influence on the torque of any motion."""
        return tuple(label.name for label in self.base.invisible)

    @property
    def combined(self) -> tuple[str, ...]:
        """Standard parameters that are identifiable only in combination with others."""
        count = (self.base.combination != 0).sum(1)
        alone = {int(k) for k, n in zip(self.base.independent, count, strict=True) if n == 1}
        seen = (self.base.combination != 0).any(0)
        return tuple(label.name for k, label in enumerate(self.base.labels) if seen[k] and k not in alone)


@typed
def inspect(robot: ModelSource, effects: Sequence[str] = EFFECT_NAMES, seed: int = 0) -> Inspection:
    """Determine the base parameters of a robot with the given effects at every joint.

    >>> signid.inspect("3r").base.rank
    25

    Raises:
        OptionError: unknown effect.
    """
    robot = as_robot(robot, "inspect")
    laws = [Law(EFFECTS[name], (j,)) for name in effects for j in range(len(robot.joints))]
    audited = audit(robot)
    return Inspection(robot, build_base(robot, laws, seed), audited.suspects, (*audited.before(), *audited.notes))
