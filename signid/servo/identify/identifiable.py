"""Facts of the joints in recordings, the numbers of drives that they identify, and why not the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ...errors import decimals, shorten
from ...robot import configuration
from ...robot.dynamics import rigid_torque
from ...robot.joints import similar_joints
from ...servos import LOOP_UNITS, SERVO_UNITS, SUM_PARTS, Servo, ServoGrid
from ...types import Array, Recording, Robot
from ..fit import ServoFit
from ..given import Bounds, Prior
from ..plant import servo_grids
from ..plant.course import bodies_of, motion_of
from ..search.choice import ServoProblem
from ..search.data import ServoData, loop_error
from .result import ServoNumber

FULL_DUTY = 0.95  # duty from which a sample is left out of the slope
LINEAR_SHARE = 0.98  # share of the variance of the duty that the error explains
OFF_SPEED = 0.02  # [rad/s or m/s] rms speed from which friction of a free joint acts
MIN_DUTY_ROWS = 50  # least number of samples
SLIDING = 0.05  # [rad/s or m/s] over which friction turns
DAMPING_PARTS = 9  # of the damping of a drive
POWER_SHARE = 0.95  # share of the power of the commands below the frequency of the shortest period
MIN_KNOWN_LOAD = 0.15  # share of known load in the torque, below which the scale is not identifiable (MuJoCo so101)
UNIQUE = 0.05  # the same for load that armature, friction and offset of the joint cannot give; at least
LEAST_UNIQUE, UNIQUE_FACTOR = 0.01, 10.0  # this, and this multiple of the relative residual, where that is small
VAGUE = 0.5  # std over value of a positive number beyond which it is not identifiable
MAX_DELAY_SHARE = 0.1  # half a 95 % interval of the delay over the lag beyond which the two are one number
ONE_NUMBER = "kd and viscous friction are one number here"
IDLE = "without effect in these recordings, so not identifiable"
COMBINED = "identifiable only in combination"
VAGUELY = "not identifiable from this motion"
UNREACHED = "no sample saturates, so the effort limit is above"
RARE = 2e-3  # share of saturated samples below which the limit is not identifiable
TICK = 2e-5  # [s] std of when, within a tick of its loop, a drive uses a command and a speed: no log says it
RANK = 1e-9  # eigenvalue of the normalised information, relative to 1, below which a direction is not identifiable
MEMBER = 0.1  # component of a unit direction beyond which a number belongs to it
SCALED = ("kp", "kd", "viscous_friction", "damping", "coulomb_friction", "armature", "effort_limit", "torque_offset")
INVERSE_SCALED = ("droop",)
SIGNED = ("torque_offset", "delay", "lag")
TIME_NUMBERS, HALF_WIDTH = ("delay", "lag"), 0.1  # times; [s] of a 95 % interval beyond which a small one says nothing
LIMITS = ("effort_limit", "speed_limit", "profile_speed")
RATIOS = ("damping", "coulomb_friction", "torque_offset", "effort_limit", "armature")  # torques that are given over kp
RATIOS_KNOWN = "; known ratios: "
WAVE = "kp/armature"  # upside down: squared angular frequency of the unloaded joint
Name = tuple[str, str]  # joint, number


def facts_of(problem: ServoProblem, fit: ServoFit) -> dict[str, JointFacts]:
    """Facts of each servo joint in the rows of a fit."""
    data, assumed, fixed = problem.data, problem.assumptions, problem.assumptions.fixed
    robot, motions = bodies_of(problem.model, data.joints), [motion_of(grid) for grid in data.train]
    q, v, a = (np.vstack([getattr(motion, key) for motion in motions]) for key in "qva")
    loads = rigid_torque(robot, configuration(robot, q), v @ robot.drive.T, a @ robot.drive.T)
    bounds_of_fit, facts = list(zip(fit.names, fit.owners, fit.at_bound, strict=True)), dict[str, JointFacts]()
    for joint, servo in fit.servos.items():
        j = data.joints.index(joint)
        reached, damping = reached_torque(servo, data.train, [motion.v[:, j] for motion in motions], j)
        share, unique = known_load_share(loads[:, j], v[:, j], a[:, j], servo)
        by_masses = "kp" not in fixed.get(joint, {}) and (joint, "kp") not in assumed.priors
        facts[joint] = JointFacts(
            joint,
            prismatic=bool(robot.prismatic[j]),
            scale_known=assumed.scale != "nothing",
            known_load_share=share,
            unique_load_share=unique,
            masses_set_scale=by_masses,
            masses_error=assumed.masses_error * by_masses,
            saturated_share=float(np.nan_to_num(fit.saturated_share[j])),
            largest_torque=reached,
            drive_damping=damping,
            torque_off=moves_while_off(data, joint),
            command_speed=servo.kd_on == "error",
            command_timing=problem.command_timing.get(joint, 0.0),
            full_duty_error=problem.full_duty.get(joint, 0.0),
            stated=fixed.get(joint, {}),
            priors={name: prior for (owner, name), prior in assumed.priors.items() if owner == joint},
            bounds={name: bounds for (owner, name), bounds in assumed.bounds.items() if owner == joint},
            at_bound=frozenset(name for (_, name), owners, at_bound in bounds_of_fit if at_bound and joint in owners),
            unexplained=float(fit.residual_rms[j]) / max(loop_error(data, joint), 1e-12),
        )
    for members in similar_joints(tuple(facts)):  # a kp that is far too small makes the load of its joint look large
        for name in ("known_load_share", "unique_load_share"):
            usual = float(np.median([getattr(facts[joint], name) for joint in members]))
            facts |= {j: replace(facts[j], **{name: min(getattr(facts[j], name), usual)}) for j in members}
    return facts


def known_load_share(load: Array, v: Array, a: Array, servo: Servo) -> tuple[float, float]:
    """Share of a joint's rms torque [1] that its known masses give, and the share that only they can give.

    load: (N,) torque of the masses [N.m or N]; v: (N,) [rad/s or m/s]; a: (N,) [rad/s2 or m/s2]. Armature,
    friction and offset of the joint could produce
    the rest of the load as well, so it does not set the scale.
    """
    friction = np.tanh(v / SLIDING)
    own = np.column_stack([a, v, friction, np.ones_like(v)])
    unique = load - own @ np.linalg.lstsq(own, load, rcond=None)[0]
    total = load + servo.armature * a + servo.coulomb_friction * friction + servo.damping * v
    size = max(_rms(total), 1e-150)
    return float(min(_rms(load) / size, 1.0)), float(min(_rms(unique) / size, 1.0))


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def demand(servo: Servo, grid: ServoGrid, v: Array, joint: int, damping: float) -> Array:
    """Torque (N,) [N.m or N] that a recorded motion asks of a drive with some damping.

    v: (N,) measured speed [rad/s or m/s]; damping [N.m.s/rad or N.s/m].
    """
    held = np.floor(np.arange(len(grid)) - servo.delay * grid.rate + 1e-9).astype(int)
    error = grid.command[np.maximum(held, 0), joint] - grid.q[:, joint]
    error = np.sign(error) * np.maximum(np.abs(error) - servo.dead_band, 0)
    return np.asarray((grid.gain[joint] * servo.kp * error - damping * v) * grid.on[:, joint])


def reached_torque(
    servo: Servo, grids: Sequence[ServoGrid], speeds: Sequence[Array], joint: int
) -> tuple[float, float]:
    """Torque [N.m or N] that a drive gives at least in a share RARE of the samples, and the damping for which it holds.

    speeds: (N,) each, measured [rad/s or m/s]. The least torque of all parts of the damping: the part that acts inside
    the limit is unknown, and none does by the law `duty`. A limit that cuts fewer samples may remain unnoticed.
    """
    tried = list[tuple[float, float]]()
    for damping in np.linspace(0.0, servo.damping, DAMPING_PARTS).tolist():
        torque = np.concatenate([demand(servo, g, v, joint, damping) for g, v in zip(grids, speeds, strict=True)])
        tried.append((float(np.quantile(np.abs(torque), 1 - RARE)), damping))
    least, part = min(tried)
    return min(least, servo.effort_limit), part


def moves_while_off(data: ServoData, joint: str) -> bool:
    """Whether a joint moves in the training data while its drive is off."""
    for grid in data.train:
        j = grid.joints.index(joint)
        off = grid.on[:, j] < 0.5
        if off.sum() >= 5 and np.sqrt(np.mean(np.gradient(grid.q[:, j], grid.step)[off] ** 2)) > OFF_SPEED:
            return True
    return False


def shortest_period(grids: Sequence[ServoGrid], joint: str) -> float:
    """Period [s] below which 5 % of the power of a joint's commands lie; inf where it does not move."""
    power, frequency = np.zeros(0), np.zeros(0)
    for grid in grids:
        x = grid.command[:, grid.joints.index(joint)]
        own = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2
        power, frequency = np.append(power, own), np.append(frequency, np.fft.rfftfreq(len(x), grid.step))
    order = np.argsort(frequency, kind="stable")
    total = np.cumsum(power[order])
    if total[-1] < 1e-12:
        return np.inf
    return float(1.0 / max(frequency[order][np.searchsorted(total, POWER_SHARE * total[-1])], 1e-6))


def full_duty_errors(robot: Robot, recordings: Sequence[Recording]) -> dict[str, float]:
    """Error [rad or m] of full duty at the nominal gain, of each joint whose PWM is proportional to its error."""
    pairs: dict[str, list[tuple[Array, Array]]] = {}
    for recording in recordings:
        x = recording.read()
        pwm = None if x.servo is None else x.servo.pwm
        if pwm is None or x.q_des is None:
            continue
        gain = servo_grids(recording, robot)[0].gain
        for j, joint in enumerate(recording.joints):
            error = gain[j] * (x.q_des[:, j] - x.q[:, j])
            on = np.isfinite(error) & np.isfinite(pwm[:, j]) & (np.abs(pwm[:, j]) < FULL_DUTY)
            if x.servo is not None and x.servo.on is not None:
                on &= x.servo.on[:, j] > 0.5
            pairs.setdefault(joint, []).append((error[on], pwm[on, j]))
    found = {joint: _error_of_one(*map(np.concatenate, zip(*some, strict=True))) for joint, some in pairs.items()}
    return {joint: error for joint, error in found.items() if error > 0}


def exceeded(grids: Sequence[ServoGrid], joint: str, error: float) -> float:
    """Share of rows with the drive on in which its error exceeds one [rad or m at the nominal gain]."""
    j = grids[0].joints.index(joint)
    beyond = np.concatenate([(g.gain[j] * np.abs(g.command - g.q)[:, j] > error)[g.on[:, j] > 0.5] for g in grids])
    return float(beyond.mean()) if len(beyond) else 0.0


def _error_of_one(error: Array, duty: Array) -> float:
    """Error of full duty; 0 unless the duty is proportional to the error."""
    if len(error) < MIN_DUTY_ROWS or not np.any(error):
        return 0.0
    slope = float(error @ duty / (error @ error))
    left = np.median(np.abs(duty - slope * error)) / 0.675
    return 1.0 / slope if slope > 0 and left**2 < (1 - LINEAR_SHARE) * np.mean(duty**2) else 0.0


class Lost(NamedTuple):
    """A number that is not identifiable, and its bound where there is one."""

    name: str
    sentence: str
    below: float | None = None  # [unit of the number]
    above: float | None = None  # [unit of the number]


@dataclass(frozen=True)
class JointFacts:
    """Content of the recordings for one joint."""

    joint: str
    prismatic: bool = False
    scale_known: bool = True  # by masses or by a stated gain
    known_load_share: float = 1.0  # [1] of the rms torque
    unique_load_share: float = 1.0  # [1] that armature, friction and offset cannot give
    unexplained: float = 1.0  # residual over the error of the loop [1]
    masses_set_scale: bool = True  # no gain of the joint is stated
    masses_error: float = 0.0  # [1] standard deviation of these masses over them
    saturated_share: float = 0.0  # [1]
    largest_torque: float = 0.0  # [N.m or N] that the drive gives at least
    drive_damping: float = 0.0  # [N.m.s/rad or N.s/m] inside the limit, for which that holds
    command_timing: float = 0.0  # [s] by which the delay may be longer, as commands may change between rows
    held_out_torque: float = 0.0  # [N.m or N] that held-out rows ask for, where they do not confirm that torque
    held_out_limit: float = np.inf  # [N.m or N] effort limit that held-out rows show
    torque_off: bool = False  # whether the joint moves while the drive is off
    command_speed: bool = False  # whether the law contains a recorded speed of the command
    full_duty_error: float = 0.0  # [rad or m] at the nominal gain, where the recorded PWM shows it; else 0
    stated: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, Prior] = field(default_factory=dict)
    bounds: Mapping[str, Bounds] = field(default_factory=dict)
    at_bound: frozenset[str] = frozenset()  # numbers that stand at their bounds


def unit_of(name: str, prismatic: bool) -> str:
    """Unit of a number, N and m in place of N.m and rad at a prismatic joint."""
    ratios = {"damping/kp": "s", WAVE: "1/s2"} | dict.fromkeys((f"{x}/kp" for x in RATIOS[1:]), "rad")
    unit = {**ratios, **LOOP_UNITS, "damping": "N.m.s/rad", "lag": "s"}[name]
    if not prismatic:
        return unit
    return {
        "N.m/rad": "N/m",
        "N.m.s/rad": "N.s/m",
        "N.m": "N",
        "rad": "m",
        "rad/s": "m/s",
        "kg.m2": "kg",
        "1/N.m": "1/N",
    }.get(unit, unit)


def joint_numbers(
    servo: Servo, free: Sequence[str], covariance: Array, facts: JointFacts
) -> tuple[dict[str, ServoNumber], tuple[str, ...]]:
    """Numbers of a drive by name, and sentences on those that are not identifiable.

    free: names that were fitted; covariance: (k, k) of them [products of their units].
    """
    values = {name: getattr(servo, name) for name in SERVO_UNITS}
    covariance = np.nan_to_num(covariance, nan=np.inf, posinf=np.inf, neginf=-np.inf)
    std = dict(zip(free, np.sqrt(np.maximum(np.diag(covariance), 0.0)), strict=True))
    values.update(damping=servo.damping, lag=servo.lag)
    with np.errstate(invalid="ignore"):
        found = {}
        damping = np.array([float(name in ("kd", "viscous_friction")) for name in free])
        if damping.any():
            found["damping"] = float(np.sqrt(max(damping @ covariance @ damping, 0.0)))
        if servo.kp > 0 and (damping.any() or {"kp", "delay"} & set(free)):
            slope = {"delay": 1.0, "kp": -servo.damping / servo.kp**2}
            lag = damping / servo.kp + np.array([slope.get(name, 0.0) for name in free])
            found["lag"] = float(np.sqrt(max(lag @ covariance @ lag, 0.0)))
        std.update(found)
    if facts.full_duty_error > 0 and "kp" in std:
        std["effort_limit"] = facts.full_duty_error * std["kp"]
    ratios = _ratios(servo, free, covariance, facts)
    lost = {one.name: one for one in _lost(servo, free, values, std, facts)}
    if sentence := _scale_sentence(ratios, facts):
        lost |= {n: Lost(n, sentence) for n in (*SCALED, *INVERSE_SCALED) if n in std or n in free}
    for name, least in {"delay": TICK, "lag": TICK, "armature": TICK * servo.damping}.items():
        if name in std:
            timing = facts.command_timing / 1.96 if name != "armature" else 0.0
            std[name] = float(np.linalg.norm([std[name], least, timing]))
    for name in {*SCALED, *INVERSE_SCALED}.intersection(std).difference(facts.priors):
        std[name] = float(np.hypot(std[name], facts.masses_error * values[name]))
    numbers, at_bound = {}, set(facts.at_bound)
    if at_bound & {"kd", "viscous_friction"} and "damping" not in std:
        at_bound.add("damping")
    for name in ("kp", "damping", *[n for n in SERVO_UNITS if n != "kp"], "lag"):
        if name in lost or name in std or name in facts.stated or name in at_bound:
            stated = name in facts.stated and name not in std
            keep = name not in lost and np.isfinite(values[name])
            remark = "at its bound" if name in at_bound else _remark(name, servo, facts)
            why = lost.get(name, Lost(name, remark))
            numbers[name] = ServoNumber(
                name,
                unit_of(name, facts.prismatic),
                float(values[name]) if keep else None,
                float(std[name]) if keep and name in std else None,
                stated,
                sentence=why.sentence,
                below=why.below,
                above=why.above,
                prior=facts.priors.get(name),
                bounds=facts.bounds.get(name),
                at_bound=keep and name in at_bound,
            )
    if "kp" in lost:
        numbers |= ratios
    return numbers, tuple(dict.fromkeys(one.sentence for one in lost.values()))


def _ratios(servo: Servo, free: Sequence[str], covariance: Array, facts: JointFacts) -> dict[str, ServoNumber]:
    """Numbers over kp, which no common scale of torque and mass changes: their intervals are those at the fitted kp."""
    if "kp" not in free or not servo.kp > 0:
        return {}
    k, found = free.index("kp"), dict[str, ServoNumber]()
    given = covariance - np.outer(covariance[:, k], covariance[k]) / max(covariance[k, k], 1e-300)
    for name in RATIOS:
        parts = [i for i, n in enumerate(free) if n in SUM_PARTS.get(name, (name,))]
        value, key = getattr(servo, name) / servo.kp, WAVE if name == "armature" else f"{name}/kp"
        if not parts or not np.isfinite(value):
            continue
        slope = np.array([(i in parts) - value * (i == k) for i in range(len(free))])
        with np.errstate(invalid="ignore"):
            whole = np.nan_to_num(slope @ covariance @ slope, posinf=0.0)  # known masses make torques less than ratios
        std = float(np.sqrt(max(given[np.ix_(parts, parts)].sum(), whole, 0.0))) / servo.kp
        most, unit = value + 1.96 * std, unit_of(key, facts.prismatic)
        if name in SIGNED or std <= VAGUE * value:
            size = (1 / value, std / value**2) if name == "armature" else (value, std)
            found[key] = ServoNumber(key, unit, *size) if np.isfinite(std) else ServoNumber(key, unit, None)
        else:
            below = most if 0 < most < np.inf else None
            above = 1 / most if below and name == "armature" else None
            found[key] = ServoNumber(key, unit, None, below=None if above else below, above=above)
    return found


def _lost(
    servo: Servo, free: Sequence[str], values: Mapping[str, float], std: Mapping[str, float], facts: JointFacts
) -> Iterator[Lost]:
    """Numbers that are not identifiable; later ones replace earlier ones."""
    yield from _vague(free, values, std, facts)
    limited = servo.law != "duty" and facts.saturated_share >= RARE
    stated = {"kd", "viscous_friction"} & {*facts.stated, *facts.priors}
    if not (limited or facts.torque_off or facts.command_speed or stated):
        said = (
            f"{facts.joint}: {ONE_NUMBER}, the damping; torque off or at its limit while the joint "
            f"moves, or a recorded speed of the command, separates them"
        )
        yield from (Lost(name, said) for name in ("kd", "viscous_friction") if name not in facts.stated)
    lag = values["lag"] if "delay" in free and "lag" in std else np.inf
    if np.isfinite(lag) and max(MAX_DELAY_SHARE * abs(lag) / 1.96, 2.0 * std["lag"]) < std["delay"]:
        yield Lost(
            "delay",
            f"{facts.joint}: delay and damping/kp are one number here, the lag of {decimals(1e3 * values['lag'])} ms; "
            f"their split needs faster motion, near sqrt(kp/inertia)",
        )
    given = "effort_limit" in facts.stated or "effort_limit" in facts.priors
    if not (given or facts.full_duty_error) and facts.saturated_share < RARE:
        known = _scale_known(facts) and not facts.held_out_torque > 0
        yield Lost("effort_limit", _limit_sentence(facts), above=facts.largest_torque if known else None)


def _vague(
    free: Sequence[str], values: Mapping[str, float], std: Mapping[str, float], facts: JointFacts
) -> Iterator[Lost]:
    sizes = {"load_friction": 1.0, "coulomb_friction": facts.largest_torque}  # of friction: what moves the joint
    for name in (*free, "damping", "lag"):
        vague = name in std and name not in SIGNED and not std[name] <= VAGUE * abs(values[name])
        late = name in TIME_NUMBERS and name in std and 1.96 * std[name] > max(abs(values[name]), HALF_WIDTH)
        if vague or late or not np.isfinite(std.get(name, 0.0)):
            words, unit = name.replace("_", " "), unit_of(name, facts.prismatic)
            most = values[name] + 1.96 * std[name]
            largest = sizes.get(name) or np.inf
            useful = np.isfinite(most) and name not in (*LIMITS, *TIME_NUMBERS, "kp") and not most >= largest
            below = float(most) if useful else None
            limit = "" if below is None else f": it is below {decimals(below, 2)} {unit}".removesuffix(" 1")
            yield Lost(name, f"{facts.joint}: {words} is {VAGUELY}{limit}", below)


def _limit_sentence(facts: JointFacts) -> str:
    """Sentence on the limit of a drive that does not saturate in the training data."""
    unit, known = unit_of("effort_limit", facts.prismatic), _scale_known(facts)
    if facts.held_out_torque > 0:
        shown = "asks for more torque, and is predicted far worse"
        if facts.held_out_limit < np.inf:
            size = f" near {decimals(facts.held_out_limit, 2)} {unit}" if known else ""
            shown = f"is predicted better with an effort limit{size}"
        return (
            f"{facts.joint}: no sample of the training data saturates, so the effort limit is not identifiable, but "
            f"held-out motion {shown}; learn from such motion as well"
        )
    above = f"{decimals(facts.largest_torque, 2)} {unit}" if known else "all torques of the recordings"
    return f"{facts.joint}: {UNREACHED} {above}"


def _scale_known(facts: JointFacts) -> bool:
    unique = float(np.clip(UNIQUE_FACTOR * facts.unexplained, LEAST_UNIQUE, UNIQUE))
    light = facts.known_load_share < MIN_KNOWN_LOAD or facts.unique_load_share < unique
    return facts.scale_known and not (facts.masses_set_scale and light)


def _scale_sentence(ratios: Mapping[str, ServoNumber], facts: JointFacts) -> str:
    if _scale_known(facts):
        return ""
    sizes = list[str]()
    for name in (name for name in ("damping/kp", WAVE) if name in ratios):
        x = ratios[name]
        words = (("", x.value), ("at most ", x.below), ("at least ", x.above))
        sizes += [f"{name} {side}{decimals(size)} {x.unit}" for side, size in words if size is not None][:1]
    known = f"{RATIOS_KNOWN}{', '.join(sizes)}" if sizes else ""
    if not facts.scale_known:
        return (
            f"{facts.joint}: kp, friction and masses are identifiable only relative to each other; state one kp, or "
            f"use the masses of the description, or repeat with a known payload{known}"
        )
    if facts.known_load_share >= MIN_KNOWN_LOAD:
        return (
            f"{facts.joint}: the known load acts like armature and friction of the joint, except "
            f"{100 * facts.unique_load_share:.0f} % of its torque, so its scale is not identifiable; state its kp or "
            f"move it against gravity{known}"
        )
    return (
        f"{facts.joint}: only {100 * facts.known_load_share:.0f} % of the torque of this joint is known load, so its "
        f"scale is not identifiable; state its kp or add a known payload{known}"
    )


def _remark(name: str, servo: Servo, facts: JointFacts) -> str:
    if name == "delay" and facts.command_timing > 0:
        return (
            f"up to {decimals(1e3 * facts.command_timing)} ms longer if the command changes between the rows of the log"
        )
    if name == "damping":
        return "kd + viscous_friction + back_emf" if servo.law == "duty" else "kd + viscous_friction"
    if name == "torque_offset":
        return "includes kp times the zero error of the command"
    return "delay + damping/kp" if name == "lag" else ""


def dependent_numbers(information: Array, names: Sequence[Name]) -> tuple[tuple[Name, ...], ...]:
    """Sets of numbers that the recordings identify only in combination, one for each direction without information.

    information: (P, P) [any] of the numbers `names`; its scale and units do not matter. A number without any
    information stands alone in its set.
    """
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    alone = size <= RANK * max(float(size.max(initial=0.0)), 1e-300)
    found = [(names[k],) for k in np.flatnonzero(alone).tolist()]
    kept = np.flatnonzero(~alone)
    if len(kept):
        normal = information[np.ix_(kept, kept)] / np.outer(size[kept], size[kept])
        values, vectors = np.linalg.eigh((normal + normal.T) / 2)
        for vector in vectors.T[values < RANK * max(1.0, float(values[-1]))]:
            found.append(tuple(names[k] for k in kept[np.abs(vector) > MEMBER].tolist()))
    return tuple(found)


def dependence(sets: Sequence[Sequence[Name]]) -> tuple[str, ...]:
    """One sentence on the numbers that do not act, and one on the other sets of `dependent_numbers`."""
    idle: dict[str, list[str]] = {}  # joints by number
    combined = list[str]()
    for members in sets:
        if len(members) == 1:
            idle.setdefault(members[0][1].replace("_", " "), []).append(members[0][0])
        else:
            numbers: dict[str, list[str]] = {}  # by joint
            for joint, number in members:
                numbers.setdefault(joint, []).append(number.replace("_", " "))
            combined.append(", ".join(f"{', '.join(each)} of {joint}" for joint, each in numbers.items()))
    each = "; ".join(f"{number} of {shorten(joints)}" for number, joints in idle.items())
    said = (f"{IDLE}: {each}", f"{COMBINED}, of which one has to be stated: {'; '.join(combined)}")
    return tuple(sentence for sentence, some in zip(said, (idle, combined), strict=True) if some)
