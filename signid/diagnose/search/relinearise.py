"""Relinearisation: columns about the simulation with the selected laws, which contain the interactions of laws."""

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

RELEVANT_CHI2 = 1.0  # squared change of torque by relinearisation [variances of the rows]: one standard deviation


def relinearise(dataset: Dataset, about: Dataset, selection: Selection) -> Dataset | None:
    """Recompute the columns about the simulation with the selected laws; None if the change is negligible.

    Laws interact: a payload increases load-dependent friction and is turned by a base tilt, friction is part of a
    delayed torque. Each cross term is attributed to the law that acts on the other's output. The residual stays
    that of the given simulation, as do the rows of `dataset`; `about` has the present columns. Also None if time is up,
    or if the bodies are infeasible.
    """
    if time_is_up(SEARCH):
        return None
    show_step(f"linearising about {len(selection.selected)} laws", 0.8)
    fit = selection.fit()
    value = {group: fit.value[fit.place(group)] for group in selection.selected}
    laws = [law for group in selection.selected for law in read_laws(group, value[group])]
    inertials, places = dataset.model.inertials, inertial_places(selection.data.refitted, fit)
    if len(places):
        inertials = inertials + fit.value[places].reshape(inertials.shape)
    robot = _loaded(dataset.model, laws, inertials)
    new = replace(dataset, pieces=tuple(p._replace(motion=_about(p.motion, robot, laws)) for p in dataset.pieces))
    if any(np.any(n.motion.inertia <= 0) for n in new.pieces) and all(
        np.all(o.motion.inertia > 0) for o in dataset.pieces
    ):
        return None  # infeasible inertias make the relinearisation meaningless
    off = np.zeros((dataset.table.joints, len(dataset.whiten({0: dataset.table.residual[:, :1]})[0])))
    for group in selection.selected:
        old, updated = about.columns(group.claim), new.columns(group.claim)
        for j, x in dataset.whiten({j: updated[j] - old[j] for j in updated}).items():
            off[j] += x @ value[group]
    if not np.sum(off**2, axis=1) @ (1 / selection.dispersion) > RELEVANT_CHI2:
        return None
    dry = dry_friction(dataset.model, dataset.pieces)
    try:
        return replace(new, table=rebuild_columns(dataset.table, dataset.task, dataset.model, new.pieces, dry))
    except OutOfTimeError:
        return None


def _loaded(model: Model, laws: Sequence[Law], inertials: Array) -> Robot:
    """The robot with other bodies and with the body laws; a base tilt is left out, since it has columns of its own."""
    changes = tuple(law for law in laws if isinstance(law.effect, BodyLaw))
    whole = bodies_without_rotors(Model(model.robot, inertials, (*model.laws, *changes)))
    whole.gravity = model.bodies().gravity
    return replace(model.robot, model=whole)


def _about(motion: Motion, robot: Robot, laws: Sequence[Law]) -> Motion:
    """Replace robot and predicted torque of a motion by those with the laws."""
    assert motion.predicted is not None, "a diagnosed motion carries predicted torque"
    predicted = motion.predicted.copy()
    for law in laws:
        if not isinstance(law.effect, RecordingLaw | ActuatorLaw):
            rows, torque = law_torque(law, motion)
            predicted[:, list(rows)] += torque
    return replace(motion, robot=robot, predicted=predicted)
