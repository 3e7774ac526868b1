"""Columns about the simulation -> columns about the simulation with what was found: what laws do to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...deadline import OutOfTimeError, show_step, time_is_up
from ...effects.base import ActuatorLaw, BodyLaw, RecordingLaw
from ...effects.law import law_torque
from ...model import Model
from ...regression.motion import Motion
from ...types import Array, Law, Robot
from ..data.column_groups import dry_friction
from ..data.dataset import Setting
from ..data.motions import bodies_of
from ..data.rows import retabulated
from ..evidence.posterior_odds import Judge
from ..evidence.selection import Found
from ..extend.extend import inertial_places, read_laws
from .stepwise import SEARCH

MATTERS = 1.0  # squared standard deviations of the rows: a number may be off by one standard deviation


def linearised(setting: Setting, about: Setting, judge: Judge, found: Found) -> Setting | None:
    """The same rows with columns about the simulation with what was found; None where those at hand hardly differ.

    A payload adds to the load that friction grows with and that a tilted base turns, friction to the torque that is
    written down too late, and so on. Each of these products is counted once, as a column of the law that acts on what
    others bring about. The residual stays that of the simulation. None, too, where time is up.

    Args:
        setting: motions and rows, columns about the simulation.
        about: the same, with the columns at hand.
        judge: library and evidence of these.
        found: what is taken for true.
    """
    if time_is_up(SEARCH):
        return None
    show_step(f"linearising about {len(found.true)} laws", 0.8)
    fit = judge.evidence.fit(found.true, found.base, found.trust)
    value = {group: fit.value[fit.place(group)] for group in found.true}
    laws = [law for group in found.true for law in read_laws(group, value[group])]
    inertials, places = setting.model.inertials, inertial_places(judge.evidence.data.refitted, fit)
    if len(places):
        inertials = inertials + fit.value[places].reshape(inertials.shape)
    robot = _loaded(setting.model, laws, inertials)
    new = replace(setting, pieces=tuple(p._replace(motion=_about(p.motion, robot, laws)) for p in setting.pieces))
    if any(np.any(n.motion.inertia <= 0) for n in new.pieces) and all(
        np.all(o.motion.inertia > 0) for o in setting.pieces
    ):
        return None  # bodies that cannot be make nothing known of what they do to others
    off = np.zeros((setting.table.joints, len(setting.whiten({0: setting.table.residual[:, :1]})[0])))
    for group in found.true:
        was, is_ = about.columns(group.claim), new.columns(group.claim)
        for j, x in setting.whiten({j: is_[j] - was[j] for j in is_}).items():
            off[j] += x @ value[group]
    if not np.sum(off**2, axis=1) @ (1 / found.base) > MATTERS:
        return None
    dry = dry_friction(setting.model, setting.pieces)
    try:
        return replace(new, table=retabulated(setting.table, setting.task, setting.model, new.pieces, dry))
    except OutOfTimeError:
        return None


def _loaded(model: Model, laws: Sequence[Law], inertials: Array) -> Robot:
    """The robot with other bodies, and as some laws change them; what a tilt does to bodies is in its own columns."""
    changes = tuple(law for law in laws if isinstance(law.effect, BodyLaw))
    whole = bodies_of(Model(model.robot, inertials, (*model.laws, *changes)))
    whole.gravity = model.bodies().gravity
    return replace(model.robot, model=whole)


def _about(motion: Motion, robot: Robot, laws: Sequence[Law]) -> Motion:
    """A motion that the robot and the laws made."""
    assert motion.predicted is not None, "a diagnosed motion carries predicted torque"
    predicted = motion.predicted.copy()
    for law in laws:
        if not isinstance(law.effect, RecordingLaw | ActuatorLaw):
            rows, torque = law_torque(law, motion)
            predicted[:, list(rows)] += torque
    return replace(motion, robot=robot, predicted=predicted)
