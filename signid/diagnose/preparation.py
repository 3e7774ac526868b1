"""Preparation of a diagnosis: session, recording faults, and the rows of all hypotheses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..deadline import OutOfTimeError, steps_shown
from ..errors import RecordingError
from ..faults import REFUSE, SAMPLE_KINDS, RecordingFault, RecordingFaults, examine, is_sole, naming_faults
from ..model import Model, stated_inertials
from ..regression.session import Options, Session, longest_piece, rearrange
from ..robot import Audit, audit, with_gravity
from ..signs import Recovered
from ..types import Law, Progress
from .data.column_groups import build_groups, dry_friction
from .data.dataset import Dataset
from .data.hypotheses import GRAVITY, pooled, propose
from .data.motions import pieces, row_filter, subsample
from .data.noise import find_period, measure_noise, noise_of_misfit
from .data.rows import build_table
from .data.whitened_rows import Whitened, whitened
from .search.contact_window import NAME as CONTACT

CUTOFF = 8.0  # cut-off if encoder noise allows it [Hz]: laws differ most in fast torque; heuristic
NOISIEST_FACTOR = 1.5  # largest cut-off over the one that the noisiest encoder allows [1]; heuristic
WORTH_PREPARING = 0.95  # cut-off over the allowed one below which the recordings are prepared again [1]; heuristic
CLEAR_KINDS = ("torque sign", "torque order")  # recording faults that few rows show
CLEARLY_EXPLAINED = 0.9  # share of the torque's sum of squares that such a fault explains, at least [1]; heuristic
SHORT = "too little data"  # recording fault that priors compensate from LEAST_ROWS rows a joint on
LEAST_ROWS = 12  # rows of a joint, and of all joints held out; heuristic


def audited(model: Model) -> tuple[Model, Audit]:
    """Simulation with the recognised units of its description corrected, and the audit.

    An identified model, whose bodies are not those of the description, is unchanged.
    """
    if not np.array_equal(model.inertials, stated_inertials(model.robot)):
        return model, Audit(model.robot)
    found = audit(model.robot)
    return replace(model, robot=found.robot, inertials=stated_inertials(found.robot)), found


def prepare_session(
    model: Model, given: Recovered, options: Options, show: Progress
) -> tuple[Session, RecordingFaults]:
    """Session and recording faults; raises if the faults rule out a diagnosis.

    The band is as wide as encoder noise allows, since laws differ most in fast torque; a given cut-off is kept.

    Raises:
        RecordingError: a recording fault rules out a diagnosis.
    """
    with naming_faults(given.session):
        session = rearrange(model.robot, given.session, options)
        band = session.task.band
        allowed = min(CUTOFF, float(np.median(band.per_joint)), NOISIEST_FACTOR * float(np.min(band.per_joint)))
        if options.cutoff is None and band.filtered and band.cutoff < WORTH_PREPARING * allowed:
            session = rearrange(model.robot, session, replace(options, cutoff=allowed))
    session = subsample(session)
    show("looking for recording faults", 0.1)
    faults = examine(model, session)
    if broken := [one for one in faults.findings if one.kind in SAMPLE_KINDS and one.severity == REFUSE]:
        raise RecordingError(broken[0].sentence)
    if any(one.kind == SHORT and one.measures["rows"] >= LEAST_ROWS for one in faults.findings):
        faults = replace(faults, findings=tuple(one for one in faults.findings if one.kind == SHORT or _is_clear(one)))
    elif faults.refusal:
        raise RecordingError(faults.refusal)
    return _with_held_out(model, session), faults


class Mounting(NamedTuple):
    """Simulation and session under one gravity, and the finding if it is not the simulation's own."""

    model: Model
    session: Session
    faults: RecordingFaults
    given: Model  # the simulation as it was given
    gravity: RecordingFault | None = None


def mount(model: Model, session: Session, faults: RecordingFaults, skip: Sequence[str]) -> Mounting:
    """Put simulation and session under the gravity that the recordings clearly show, else that of the simulation."""
    given, shown = model, next((fault for fault in faults.findings if fault.kind == GRAVITY), None)
    if shown is not None and (GRAVITY in skip or not is_sole(shown)):
        shown = None
    if shown is not None:
        faults = replace(faults, findings=tuple(fault for fault in faults.findings if fault is not shown))
        model = replace(model, robot=with_gravity(model.robot, [shown.measures[key] for key in "xyz"]))
    task = replace(session.task, robot=with_gravity(session.robot, model.robot.model.gravity.linear))
    return Mounting(model, replace(session, task=task), faults, given, shown)


def _is_clear(fault: RecordingFault) -> bool:
    """Whether few rows suffice for a recording fault: a sign or an order of torques that all parts agree on."""
    measured = fault.measures
    return fault.kind in CLEAR_KINDS and measured["agreement"] == 1 and measured["explained_after"] > CLEARLY_EXPLAINED


def _with_held_out(model: Model, session: Session) -> Session:
    """Session with held-out rows; where recordings are too short, the training rows take their place, with a note."""
    thin = row_filter(session.task)
    if sum(len(thin.at(p.motion.t)) for p in pieces(session.task, model, session.held_out)) >= LEAST_ROWS:
        return session
    note = (
        "too short to hold rows out: held-out figures are those of the training rows, so optimistic; record for longer"
    )
    return replace(session, held_out=session.train, notes=(*session.notes, note))


def build_in_time(
    model: Model, session: Session, skip: Sequence[str], progress: Progress, free: Sequence[Law] = ()
) -> tuple[Dataset, Whitened]:
    """Build motions and rows of all hypotheses, or of none if time is up before."""
    try:
        with steps_shown(progress, 0.2, 0.4):
            return build(model, session, skip, progress, free)
    except OutOfTimeError:
        return build(model, session, None, progress, free)


def build(
    model: Model, session: Session, skip: Sequence[str] | None, show: Progress, free: Sequence[Law] = ()
) -> tuple[Dataset, Whitened]:
    """Build motions and rows; if `skip` is None, of the simulation's own numbers alone; laws `free` have flat priors.

    Raises:
        RecordingError: no stretch of the recordings is as long as the filter.
    """
    show("building hypotheses", 0.2)
    task, parts = session.task, session.train
    made = tuple(pieces(task, model, parts))
    if not made:
        raise RecordingError(
            f"no stretch of the recordings is as long as the filter for {task.band.cutoff:.3g} Hz; record for longer, "
            f"or raise the cut-off"
        )
    motion = pooled([p.motion for p in made])
    hypotheses = [] if skip is None else propose(model, motion, (*skip, CONTACT, GRAVITY))
    dry = dry_friction(model, made)
    table = build_table(task, model, build_groups(model, made[0].motion, hypotheses, dry, free), made, dry)
    periods = tuple(find_period(longest_piece(part).q, 1 / part[1].period) for part in parts)
    noise = measure_noise(table, periods, task.band.rate / task.band.factor).white()
    noise = noise if model.misfit is None else noise_of_misfit(noise, model.misfit, task.band)
    return Dataset(task, model, made, periods, table, noise), whitened(table, noise)
