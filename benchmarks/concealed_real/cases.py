"""The cases of a set: physics missing by nature, and laws, bodies and recordings with one known change each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

import signid
from signid.effects import EFFECTS
from signid.model import Model, load_model
from signid.robot.dynamics import own_body
from signid.types import Law, Recording

from .changes import (
    Array,
    Case,
    Change,
    Setup,
    Truth,
    carrying,
    load_of,
    plus,
    recorded,
    rms,
    scaled_law,
    shifted,
    swapped,
    tilted,
    times,
    with_body,
    without,
)
from .sets import RealSet, columns_of, data, read

KIND = "nature"
PAYLOAD = 2.805  # mass weighed by the authors [kg]
COUPLING = {"inertia": 0.00964, "viscous": 0.616, "coulomb": 1.95}  # published [kg.m2], [N.m.s/rad], [N.m]
DIRECTIONS = ("asymmetric_friction", "armature")
FRICTION = ("viscous_friction", "coulomb_friction", "asymmetric_friction", "stribeck_friction")


def concealed(one: RealSet, setup: Setup, a: list[Recording]) -> Iterator[Case]:
    """Yield the cases of a set; most sets have none."""
    if one.name in CASES:
        yield CASES[one.name](one, setup, a)


def _payload(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    b, c = (read(one, setup.model.robot, one.more[key]) for key in ("loaded", "loaded, held out"))
    truth = Truth(("payload",), (len(setup.model.robot.joints) - 1,), {"mass": PAYLOAD}, last=True)
    return Case(KIND, f"{PAYLOAD} kg payload", setup.model, b, c, truth, other=True)


def _coupling(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    law = Law(EFFECTS["joint_coupling"], (4, 5), COUPLING)
    complete = replace(setup.model, laws=(*setup.model.laws, law))
    return _same(setup, "wrist coupling", Truth(("joint_coupling",), (4, 5)), complete)


def _directions(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    complete = signid.identify(setup.model.robot, a, options=signid.Options(effects=DIRECTIONS)).model
    return _same(setup, "asymmetric friction", Truth(("asymmetric_friction",), (0,)), complete)


def _friction(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    published = load_model(data() / one.folder / one.urdf)
    case = _same(setup, "published inertials, no friction", Truth(FRICTION, None), setup.model)
    return replace(case, model=published)


def _same(setup: Setup, what: str, truth: Truth, complete: Model) -> Case:
    return Case(KIND, what, setup.model, setup.b, setup.c, truth, complete)


CASES: dict[str, Callable[[RealSet, Setup, list[Recording]], Case]] = {
    "ur10e": _payload,
    "tx40": _coupling,
    "emps": _directions,
    "panda": _friction,
}


LAWS = ("coulomb_friction", "viscous_friction", "armature", "torque_offset")
SMALLER, HEAVIER = 3.0, 1.2  # divisor of a friction level, factor on a link's inertials [1]
TILT = float(np.radians(3.0))  # base tilt [rad]
LATE, GAIN, OFFSET = 3, 1.15, 0.05  # delay [samples], torque gain [1], encoder offset [rad or m]


def all_cases(setup: Setup) -> Iterator[Case]:
    """Yield all cases: laws, bodies, recordings."""
    yield from laws(setup)
    yield from bodies(setup)
    yield from recordings(setup)


def laws(setup: Setup) -> Iterator[Case]:
    """Remove each kind of law at the joint with its largest share of torque; reduce one Coulomb level."""
    size = _torque(setup)
    for effect in LAWS:
        own = {law.joints[0]: law for law in setup.model.laws if law.effect.name == effect}
        if not own:
            continue
        changed = setup.ratios(without(setup.model, effect)) * rms(setup.residual) / size
        joint = max(own, key=lambda j: changed[j])
        numbers = dict(own[joint].parameters)
        truth = Truth((effect,), (joint,), numbers, numbers, setup.std.get((effect, joint), 0.0))
        yield _case(setup, "law removed", f"no {effect}", joint, without(setup.model, effect, joint), truth)
        if effect == "coulomb_friction":
            smaller = scaled_law(setup.model, effect, joint, 1 / SMALLER)
            lacking = {key: (1 - 1 / SMALLER) * x for key, x in numbers.items()}
            truth = replace(truth, numbers=lacking)
            yield _case(setup, "law of wrong size", f"{effect} / {SMALLER:g}", joint, smaller, truth)


def bodies(setup: Setup) -> Iterator[Case]:
    """Remove and add a payload, make a link of the model too heavy, tilt the base."""
    model, last = setup.model, len(setup.model.robot.joints) - 1
    load, body = load_of(model), own_body(model.robot, last)
    truth = Truth(("payload",), (last,), {"mass": -float(load[0])}, last=True)
    yield _case(setup, "payload gone", f"{-load[0]:.3g} kg", last, with_body(model, body, load), truth)
    truth = Truth(("payload",), (last,), {"mass": float(load[0])}, last=True)
    before, b, c = (carrying(x, model, y, setup.band) for x, y in ((setup.b, None), (setup.b, load), (setup.c, load)))
    yield Case("payload carried", _at(setup, f"{load[0]:.3g} kg", last), model, b, c, truth, before=before)
    middle = range(last + 1) if last < 2 else range(1, last)
    own = {j: model.inertials[own_body(model.robot, j)] for j in middle}
    heavier = {j: with_body(model, own_body(model.robot, j), (HEAVIER - 1) * x) for j, x in own.items()}
    joint = _largest(setup, heavier)
    truth = Truth(("link_inertia",), (joint,), {"mass": (1 - HEAVIER) * float(own[joint][0])}, last=joint == last)
    yield _case(setup, "link +20 %", "its link", joint, heavier[joint], truth)
    leaning = {axis: tilted(model, *(TILT * (k == axis) for k in (0, 1))) for axis in (0, 1)}
    axis = _largest(setup, leaning)
    truth = Truth(("base_tilt",), None, {key: -TILT * (k == axis) for k, key in enumerate("xy")})
    yield _case(setup, "base tilted", f"3 degrees about {'xy'[axis]}", None, leaning[axis], truth)


def recordings(setup: Setup) -> Iterator[Case]:
    """Apply delay, lead, gain, encoder offset, sign and channel swap to B and C."""
    n, step = len(setup.model.robot.joints), float(np.median(np.diff(columns_of(setup.b)["t"])))
    for samples, word in ((LATE, "late"), (-LATE, "early")):
        truth = Truth(("time_delay",), tuple(range(n)), {"delay": samples * step}, fault=word)
        what = f"{LATE} samples, {1e3 * LATE * step:.3g} ms"
        yield _logged(setup, f"torque {word}", what, None, truth, lambda x, k=samples: shifted(x, k))  # type: ignore[misc]
    order = np.argsort(-_torque(setup) / rms(setup.residual)).tolist()  # joints by signal over residual
    first, middle = order[0], order[n // 2]
    truth = Truth(("torque_gain",), (first,), {"error": GAIN - 1}, fault="gain")
    yield _logged(setup, "torque gain", f"x {GAIN:g}", first, truth, lambda x: times(x, first, GAIN))
    trials = [recorded(setup.b, setup.model, lambda x, j=j: plus(x, j, OFFSET)) for j in range(n)]  # type: ignore[misc]
    zero = int(np.argmax([np.max(setup.ratios(setup.model, b)) for b in trials]))
    truth = Truth(("encoder_offset",), (zero,), {"offset": OFFSET})
    yield _logged(setup, "encoder offset", f"+{OFFSET:g}", zero, truth, lambda x: plus(x, zero, OFFSET))
    truth = Truth(("torque_sign",), (middle,), fault="sign")
    yield _logged(setup, "torque sign", "negated", middle, truth, lambda x: times(x, middle, -1.0))
    if n > 1:
        pair = (middle, middle + 1) if middle + 1 < n else (middle - 1, middle)
        truth = Truth(("channel_swap",), pair, fault="swap")
        yield _logged(setup, "channels swapped", "with the next", pair[0], truth, lambda x: swapped(x, pair))


def _case(setup: Setup, kind: str, what: str, joint: int | None, model: Model, truth: Truth) -> Case:
    return Case(kind, _at(setup, what, joint), model, setup.b, setup.c, truth)


def _logged(setup: Setup, kind: str, what: str, joint: int | None, truth: Truth, change: Change) -> Case:
    b, c = (recorded(one, setup.model, change) for one in (setup.b, setup.c))
    return Case(kind, _at(setup, what, joint), setup.model, b, c, truth)


def _at(setup: Setup, what: str, joint: int | None) -> str:
    return what if joint is None else f"{what} at {setup.model.robot.joints[joint]}"


def _largest(setup: Setup, changed: Mapping[int, Model]) -> int:
    """Key of the model with the largest change."""
    sizes = {key: float(np.max(setup.ratios(model))) for key, model in changed.items()}
    return max(sizes, key=lambda key: sizes[key])


def _torque(setup: Setup) -> Array:
    """Rms of the recorded torque (n,) [N.m or N]."""
    return rms(columns_of(setup.b)["tau"])
