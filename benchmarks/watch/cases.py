"""Arms with identified models, random motions, and what happens to them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import signid
from signid.model import Model
from signid.simulation.excite.families import rest_to_rest_motion
from signid.watch import Contact, Event, LastingChange

from ..arms import ARMS, Arm, load
from ..plants.bodies import Body
from ..plants.control import Table, draw_motion
from .plant import Alteration, Push, record

Array = NDArray[np.float64]
LEARNT = 30.0  # [s] of the recording that gives the model
BEGIN = 25.0  # [s] of the change
REACTED = 0.3  # [s] after a push within which it counts as detected
SETTLING = 1.0  # [s] after a push in which its end may be seen again


class Detection(NamedTuple):
    """Pushes of one stream."""

    arm: str
    pushes: int
    times: tuple[float, ...]  # [s] from the beginning of the push to the event
    links: int  # detected pushes whose furthest loaded link is that of the push
    false: int  # contacts at other times, and changes
    seconds: float  # watched without a push


class Naming(NamedTuple):
    """One change."""

    arm: str
    change: str
    named: str  # first law that was named, "" if none
    right: bool
    after: float  # [s] from its beginning, or from its end if it grows
    error: float  # [1] of the last number named, over the true one
    contacts: int  # before it was named, and after


@cache
def learnt(name: str) -> tuple[Arm, Body, Model]:
    """Arm, its plant, and the model identified from a recording in MuJoCo."""
    arm = next(arm for arm in ARMS if arm.robot == name)
    robot = load(arm)
    body = Body(robot.document, robot.joints)
    columns = record(body, arm.drives, draw_motion(arm.centre, 1), LEARNT, (), 1)
    return arm, body, signid.identify(robot, [columns]).model


def stream(name: str, seconds: float, events: Sequence[Push | Alteration], seed: int) -> dict[str, Array]:
    """Columns at 1 kHz of an arm that moves at random from rest to rest."""
    arm, body, model = learnt(name)
    asked = rest_to_rest_motion(model.robot, seconds, 0.01, seed)
    return record(body, arm.drives, Table(asked.t, asked.q, asked.v, asked.a), seconds, events, seed)


def pushes(name: str, count: int, seed: int) -> Detection:
    """Random pushes of 0.3 s, 3 s apart, of 10 to 40 N at the outer half of the links."""
    _, body, model = learnt(name)
    rng, n = np.random.default_rng(seed), len(body.joints)
    planned = []
    for k in range(count):
        force = rng.standard_normal(3)
        force *= rng.uniform(10.0, 40.0) / np.linalg.norm(force)
        x, y, z = (float(f) for f in force)
        planned.append(Push(20.0 + 3.0 * k, 0.3, int(rng.integers(n // 2, n)), (x, y, z)))
    seconds = 20.0 + 3.0 * count
    found = list(signid.watch(model, stream(name, seconds, planned, seed)))
    return _detection(name, model, planned, found, seconds)


def _detection(name: str, model: Model, planned: Sequence[Push], found: Sequence[Event], seconds: float) -> Detection:
    begun = [e for e in found if isinstance(e, Contact) and e.end is None]
    times, links, hits = list[float](), 0, 0
    for push in planned:
        own = [e for e in begun if 0 <= e.t - push.start < REACTED + SETTLING]
        hits += len(own)
        if own and own[0].t - push.start < REACTED:
            times.append(own[0].t - push.start)
            links += own[0].link == model.robot.links[push.joint]
    changes = sum(isinstance(e, LastingChange) for e in found)
    rest = seconds - (REACTED + SETTLING) * len(planned)
    return Detection(name, len(planned), tuple(times), links, len(begun) - hits + changes, rest)


def quiet(name: str, seconds: float, seed: int) -> Detection:
    """False alarms of a stream in which nothing happens."""
    _, _, model = learnt(name)
    found = list(signid.watch(model, stream(name, seconds, (), seed)))
    return _detection(name, model, (), found, seconds)


def changed(name: str, change: Alteration, seed: int, seconds: float = 60.0) -> Naming:
    """Whether the first change that is named is the planted one."""
    _, _, model = learnt(name)
    found = list(signid.watch(model, stream(name, seconds, [change], seed)))
    named = [e for e in found if isinstance(e, LastingChange)]
    contacts = sum(isinstance(e, Contact) and e.end is None for e in found)
    where = model.robot.joints[change.joint]
    label = f"{change.effect} of {where}: {change.size:+.3g}" + (f" over {change.ramp:g} s" if change.ramp else "")
    if not named:
        return Naming(name, label, "", False, float("nan"), float("nan"), contacts)
    first = named[0]
    same = [e for e in named if e.law == change.effect and e.joint == where]
    right = bool(same) and same[0] is first
    number = next(iter(same[-1].parameters.values())) if same else float("nan")
    return Naming(
        name, label, f"{first.law} of {first.joint}", right, first.t - BEGIN, number / change.size - 1, contacts
    )


CHANGES = (
    ("panda", Alteration(BEGIN, "payload", 6, 0.5)),
    ("panda", Alteration(BEGIN, "viscous_friction", 3, 0.5)),
    ("panda", Alteration(BEGIN, "coulomb_friction", 1, 0.5, 10.0)),
    ("panda", Alteration(BEGIN, "torque_gain", 3, 0.06)),
    ("panda", Alteration(BEGIN, "torque_offset", 4, 0.2)),
    ("panda", Alteration(BEGIN, "payload", 6, 1.5)),
    ("ur10", Alteration(BEGIN, "payload", 5, 1.0)),
    ("ur10", Alteration(BEGIN, "viscous_friction", 2, 3.0)),
    ("ur10", Alteration(BEGIN, "coulomb_friction", 3, 1.0, 10.0)),
    ("ur10", Alteration(BEGIN, "torque_gain", 1, 0.06)),
    ("ur10", Alteration(BEGIN, "torque_offset", 4, 0.8)),
    ("3r", Alteration(BEGIN, "payload", 2, 0.3)),
    ("3r", Alteration(BEGIN, "viscous_friction", 1, 0.2)),
    ("3r", Alteration(BEGIN, "coulomb_friction", 0, 0.3)),
    ("3r", Alteration(BEGIN, "torque_gain", 1, 0.06)),
)
