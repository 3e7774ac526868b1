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
from ..data.dataset import Dataset
from ..data.motions import bodies_without_rotors
from ..data.rows import rebuild_columns
from ..evidence.selection import Selection
from ..extend.extend import inertial_places, read_laws
from .stepwise import SEARCH

MATTERS = 1.0  # squared standard deviations of the rows: a number may be off by one standard deviation


def linearised(dataset: Dataset, about: Dataset, found: Selection) -> Dataset | None:
    """The same rows with columns about the simulation with what was found; None where those at hand hardly differ.

    A payload adds to the load that friction grows with and that a tilted base turns, friction to the torque that is
    written down too late, and so on. Each of these products is counted once, as a column of the law that acts on what
    others bring about. The residual stays that of the simulation. None, too, where time is up.

    Args:
        dataset: motions and rows, columns about the simulation.
        about: the same, with the columns at hand.
        found: the selected laws.
    """
    if time_is_up(SEARCH):
        return None
    show_step(f"linearising about {len(found.selected)} laws", 0.8)
    fit = found.fit()
    value = {group: fit.value[fit.place(group)] for group in found.selected}
    laws = [law for group in found.selected for law in read_laws(group, value[group])]
    inertials, places = dataset.model.inertials, inertial_places(found.data.refitted, fit)
    if len(places):
        inertials = inertials + fit.value[places].reshape(inertials.shape)
    robot = _loaded(dataset.model, laws, inertials)
    new = replace(dataset, pieces=tuple(p._replace(motion=_about(p.motion, robot, laws)) for p in dataset.pieces))
    if any(np.any(n.motion.inertia <= 0) for n in new.pieces) and all(
        np.all(o.motion.inertia > 0) for o in dataset.pieces
    ):
        return None  # bodies that cannot be make nothing known of what they do to others
    off = np.zeros((dataset.table.joints, len(dataset.whiten({0: dataset.table.residual[:, :1]})[0])))
    for group in found.selected:
        was, is_ = about.columns(group.claim), new.columns(group.claim)
        for j, x in dataset.whiten({j: is_[j] - was[j] for j in is_}).items():
            off[j] += x @ value[group]
    if not np.sum(off**2, axis=1) @ (1 / found.dispersion) > MATTERS:
        return None
    dry = dry_friction(dataset.model, dataset.pieces)
    try:
        return replace(new, table=rebuild_columns(dataset.table, dataset.task, dataset.model, new.pieces, dry))
    except OutOfTimeError:
        return None


def _loaded(model: Model, laws: Sequence[Law], inertials: Array) -> Robot:
    """The robot with other bodies, and as some laws change them; what a tilt does to bodies is in its own columns."""
    changes = tuple(law for law in laws if isinstance(law.effect, BodyLaw))
    whole = bodies_without_rotors(Model(model.robot, inertials, (*model.laws, *changes)))
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
