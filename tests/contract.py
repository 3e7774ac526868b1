"""Contract of all effects; `faults` checks one effect and lists its violations."""

from __future__ import annotations

import re
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
from arm import smooth_motion, turned
from printed import known, printed
from scipy.integrate import solve_ivp

from signid.effects.base import FUNCTIONS, ActuatorLaw, BodyLaw, Effect, RecordingLaw, TorqueLaw, TransmissionLaw, Trial
from signid.effects.law import law_columns, law_torque
from signid.regression.motion import Motion
from signid.robot.dynamics import own_body, own_row
from signid.types import Array, Law

KINDS = (TorqueLaw, BodyLaw, TransmissionLaw, RecordingLaw, ActuatorLaw)
PLACE = {"joint": (1,), "link": (1,), "tip": (2,), "pair": (1, 2), "robot": (0, 1, 2), "any": (0, 1, 2)}
SMALL = 1e-3  # share of a parameter at which laws are linear in it
MEMORY = 2e-2  # of the equation, where samples are connected; else rounding errors
SETTLED = 2000  # samples before which a link need not swing as `hold` says
SCALES = {"N": 3.0, "m": 5.0, "s": 7.0, "rad": 1.0, "1": 1.0, "kg": 3.0 * 7.0**2 / 5.0}


def faults(effect: Effect) -> Iterator[str]:
    """One sentence for each law of the contract that an effect breaks."""
    try:
        yield from _faults(effect)
    except NameError as error:
        allowed = f"its parameters, signals such as q, v, a and load, norm, {', '.join(FUNCTIONS)}"
        yield f"its equation uses {error.name!r}; it may use {allowed}"


def _faults(effect: Effect) -> Iterator[str]:
    if sum(isinstance(effect, kind) for kind in KINDS) != 1:
        yield "it is of no kind, or of two"
        return
    if not (effect.name and effect.equation and effect.source and effect.typical and type(effect).__doc__):
        yield "its card is incomplete"
    if set(effect.example) != set(effect.parameters):
        yield "its example does not give every parameter"
        return
    back = effect.physical(effect.coefficients(effect.example), effect.shape(effect.example))
    if set(back) != set(effect.example) or any(abs(back[k] - effect.example[k]) > 1e-9 for k in back):
        yield "coefficients and physical are no inverses"
    yield from _units(effect)
    for middle in ("revolute", "prismatic"):
        found = list(_columns(effect, smooth_motion(middle)))
        yield from found
        if found:
            return
    yield from _leading(effect, smooth_motion())


def on_all_joints(law: Law, motion: Motion) -> Array:
    """Torque (N, n) of a law [N.m or N], zero at joints where it does not act."""
    rows, torque = law_torque(law, motion)
    out = np.zeros_like(motion.q)
    out[:, list(rows)] = torque
    return out


def law_of(effect: Effect, share: float = 1.0) -> Law:
    """The effect at its joints in the contract, with a share of its usual parameters."""
    shape = effect.shape(effect.example)
    return Law(effect, PLACE[effect.scope], {k: x if k in shape else share * x for k, x in effect.example.items()})


def _columns(effect: Effect, motion: Motion) -> Iterator[str]:
    law = law_of(effect)
    rows, columns = law_columns(law, motion)
    wide = effect.scope in ("link", "tip")
    wanted = (len(motion), motion.q.shape[1] if wide else len(law.joints), len(effect.coefficients(effect.example)))
    if columns.shape != wanted or len(rows) != wanted[1] or not np.isfinite(columns).all():
        yield "its columns have another shape, or are not finite"
        return
    torque = law_torque(law, motion)[1]
    power = (torque * motion.v[:, list(rows)]).sum(1)
    if effect.dissipative and (power < -1e-12 * np.abs(power).max()).any():
        yield "it does not dissipate"
    if effect.reverses == np.array_equal(columns, law_columns(law, turned(motion))[1]):
        yield "its columns jump with the direction of motion, and `reverses` denies it, or the other way round"
    yield from _equation(effect, motion, torque)
    if isinstance(effect, BodyLaw):
        yield from _bodies(effect, motion)
    if isinstance(effect, TransmissionLaw):
        yield from _deflection(effect, motion)
    if isinstance(effect, RecordingLaw):
        yield from _record(effect, motion)
    if isinstance(effect, ActuatorLaw):
        x = motion.at(law.joints)
        acting = effect.applied_torque(Trial(x.q, x.v, t=x.t, torque=x.recorded), **effect.shape(effect.example))
        if np.abs(torque - (x.recorded - acting)).max() > 1e-9:
            yield "its columns are not what the record has more than the torque that acts"


def _equation(effect: Effect, motion: Motion, torque: Array) -> Iterator[str]:
    """Compare the code with the printed equation, sample by sample."""
    x, p = motion.at(PLACE[effect.scope]), effect.example
    if isinstance(effect, TransmissionLaw):
        here = Trial(0.03 * np.sin(x.q * 9), x.v, inertia=x.inertia)
        names = known(effect) | {"q": here.q, "v": here.v, "inertia": here.inertia}
        stated, code = eval(effect.equation, names), effect.hold(here, **p)
    else:
        (every, stated), code = printed(effect, motion, PLACE[effect.scope]), torque
        if isinstance(effect, RecordingLaw):
            moved = effect.recorded_q(x, **p)
            code = moved if np.any(moved != x.q) else effect.recorded_torque(x, **p)
        if isinstance(effect, ActuatorLaw):
            code = effect.applied_torque(x, **p)
        code = code[::every]
    connected = "dz/dt" in effect.equation or "torque_at" in effect.equation
    off = np.sqrt(np.mean((stated - code) ** 2)) / np.sqrt(np.mean(stated**2))
    if not off < (MEMORY if connected else 1e-5):
        yield "its equation and its code differ"


def _bodies(effect: BodyLaw, motion: Motion) -> Iterator[str]:
    """Compare the columns with Pinocchio's inverse dynamics of the changed bodies."""
    law = law_of(effect, SMALL)
    rows, torque = law_torque(law, motion)
    model, joint = motion.robot.model.copy(), law.joints[0]
    effect.reshape(model, own_row(motion.robot, joint), own_body(motion.robot, joint) + 1, **law.parameters)
    data = model.createData()
    states = zip(motion.configuration, *motion.rates, strict=True)
    change = np.array([pin.rnea(model, data, *state) for state in states]) - motion.load
    if np.abs(torque - change[:, list(rows)]).max() > 2 * SMALL * np.abs(torque).max():
        yield "its columns and the reshaped bodies differ"


def _deflection(effect: TransmissionLaw, motion: Motion) -> Iterator[str]:
    """Compare the deflection with `hold`, integrated in fine steps."""
    law, j = law_of(effect), PLACE["link"][0]
    x = motion.at(law.joints)
    pull, drag, t = motion.sensitivity.position[:, j, j], motion.sensitivity.velocity[:, j, j], motion.t
    signals = np.column_stack([x.load[:, 0], x.inertia[:, 0], pull, drag])
    (z,) = effect.deflection(x, **effect.shape(effect.example))
    t, signals, late = t[SETTLED:], signals[SETTLED:], z[SETTLED:, 0]

    def rate(now: float, state: Array) -> list[float]:
        load, mass, k, d = (np.interp(now, t, signal) for signal in signals.T)
        hold = effect.hold(Trial(state[:1], state[1:], inertia=mass), **effect.example)[0]
        return [state[1], -(load + hold + k * state[0] + d * state[1]) / mass]

    begin = [float(late[0]), float((-3 * late[0] + 4 * late[1] - late[2]) / (2 * motion.dt))]
    fine = solve_ivp(rate, (t[0], t[-1]), begin, "LSODA", t, rtol=1e-6, atol=1e-9, max_step=motion.dt).y[0]
    if not np.sqrt(np.mean((late - fine) ** 2)) < MEMORY * np.sqrt(np.mean(fine**2)):
        yield "its deflection is not what `hold` balances"
    (column,) = effect.columns(x, **effect.shape(effect.example))
    if np.abs(column - motion.shift(j, z[:, 0])).max() > 1e-9 * np.abs(column).max():
        yield "its columns are not the torque of its deflection"


def _record(effect: RecordingLaw, motion: Motion) -> Iterator[str]:
    """Compare the columns with the recording for small parameters."""
    law = law_of(effect, SMALL if effect.linear() else 1.0)
    x, joint = motion.at(law.joints), law.joints[0]
    columns = law_torque(law, motion)[1]
    moved = effect.recorded_q(x, **law.parameters) - x.q
    if moved.any():  # the true position is the recorded one without it
        q = motion.q.copy()
        q[:, joint] -= moved[:, 0]
        change = Motion(motion.robot, motion.t, q, motion.v, motion.a).load - motion.load
    else:
        change = effect.recorded_torque(x, **law.parameters) - x.torque
    if not np.abs(columns - change).max() < 0.02 * np.abs(change).max():
        yield "its columns are not the change of the recording"


def _leading(effect: Effect, motion: Motion) -> Iterator[str]:
    """Trials in front of the joints' axis make no difference."""
    if not isinstance(effect, TorqueLaw):
        return
    x, jacobian, shape = motion.at(PLACE[effect.scope]), motion.jacobian[:600], effect.shape(effect.example)
    flat = {key: getattr(x, key)[:600] for key in ("q", "v", "a", "load", "direction", "t")}
    deep = {key: signal.reshape(4, 150, -1) for key, signal in flat.items()}
    wholes = SimpleNamespace(jacobian=jacobian), SimpleNamespace(jacobian=jacobian.reshape(4, 150, 3, -1))
    one, other = (Trial(**s, dt=x.dt, joints=x.joints, whole=w) for s, w in zip((flat, deep), wholes, strict=True))
    given = [[effect.advance(np.full_like(y.q, 0.3), y, **shape)] if effect.memory else [] for y in (one, other)]
    pairs = zip(effect.columns(one, *given[0], **shape), effect.columns(other, *given[1], **shape), strict=True)
    for a, b in pairs:
        if np.broadcast_to(b, other.q.shape).reshape(one.q.shape).tolist() != np.broadcast_to(a, one.q.shape).tolist():
            yield "it looks at the leading axis"
            return


def _units(effect: Effect) -> Iterator[str]:
    """Parameters counted in other units give the same torque, at either kind of joint."""
    rate = effect.equation.partition("; dz/dt = ")[2]
    plain = isinstance(effect, TorqueLaw | BodyLaw) and effect.scope == "joint"
    if not plain or re.search(r"\d\.\d", effect.equation):
        return  # numbers of their own units stand in the text
    for prismatic in (False, True) if effect.name != "counterbalance" else (False,):  # a sine of metres has no unit
        q, torque = (SCALES["m"], SCALES["N"]) if prismatic else (1.0, SCALES["N"] * SCALES["m"])
        s = SCALES["s"]
        scales = {"q": q, "v": q / s, "a": q / s**2, "load": torque, "t": s, "z": 1.0}
        scales |= {key: scale_of(p.unit_at(prismatic)) for key, p in effect.parameters.items()}
        values = {"q": 0.37, "v": 0.4, "a": -0.7, "load": 5.0, "t": 2.0, "z": 0.1} | dict(effect.example)
        for text, wanted in ((effect.equation.partition(";")[0], torque), (rate, 1 / s)):
            here, there = (
                eval(text or "1 + 0 * z", known(effect) | {k: x * scales[k] ** power for k, x in values.items()})
                for power in (0, 1)
            )
            if text and abs(there - wanted * here) > 1e-9 * abs(there):
                yield f"its units do not fit its equation at a {'prismatic' if prismatic else 'revolute'} joint"


def scale_of(unit: str) -> float:
    """Conversion factor of this unit when every base unit becomes smaller."""
    above, *below = unit.split("/")
    total = 1.0
    for sign, part in [(1, above), *((-1, part) for part in below)]:
        for factor in part.split("."):
            name, power = re.fullmatch(r"([A-Za-z]+|1)(\d*)", factor).groups()  # type: ignore[union-attr]
            total *= SCALES[name] ** (sign * int(power or 1))
    return total
