"""Stepwise search for the laws that drives lack, in one group of coupled joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...types import TWO_SIDED, Array
from ..fit.coordinates import BODY, Coordinates, Slot
from .closed_loop import ClosedLoop
from .evidence import Offer, half_log, mean_sigma, rejected, tempered, weighed
from .hypotheses import HYPOTHESES, DriveHypothesis
from .refine import Attempt, Setting, refine, setting_of, spread

MOST = 3  # laws that are added to one group
POLISHED, REFINED = 24, 8  # hypotheses that get a second iteration, and that are fitted, in each step
THRESHOLD = 5.0  # log posterior odds that a law needs. Heuristic
EQUAL = 0.5  # log odds, within which the law that is listed first stands for its twins
CLUSTERED = 3.0  # [1] improvement over its standard error across windows that a law needs
FORMS = ("speed_limit", "duty_limit", "effort_limit", "dead_band", "profile_limit", "load_friction", "voltage_droop")
ROUNDS = 8  # iterations of fits with all numbers of a drive
LEAST_GAIN = 0.02  # [1] share of the squared residual that a law explains, at least
MOSTLY, FEW = 0.5, 1.5  # [1] share of a joint's squared residual, windows: what rare events such as limits explain
FLOOR = 1.15  # [1] mean square over that of noise, below which nothing is missing
SUSPECT = 0.03  # [1] of the largest excess of a joint over noise: joints with less are not searched. Heuristic
PAYLOAD = DriveHypothesis(
    effect="payload",
    numbers=BODY,
    meaning="a body hangs at the last link",
    variable="position",
    trials=lambda *_: [],
)
LISTED = [*(law.effect for law in HYPOTHESES), PAYLOAD.effect]


@dataclass(frozen=True, eq=False)
class Step:
    """A law that was added."""

    law: DriveHypothesis
    joint: int  # in the group
    before: Attempt
    after: Attempt
    log_odds: float
    probability: float
    rivals: tuple[tuple[DriveHypothesis, int, float], ...]  # law, joint, probability


@dataclass(frozen=True, eq=False)
class GroupSearch:
    """Laws that were added to a group, in their order."""

    setting: Setting
    base: Attempt  # the given simulation
    last: Attempt
    covariance: Array  # (P, P) [products of SERVO_UNITS] of the free numbers of `last`
    steps: tuple[Step, ...] = ()
    tried: tuple[tuple[str, int, float], ...] = ()  # not added: law, joint, share of its squared residual explained [1]


def search(loop: ClosedLoop, point: Coordinates, floor: Array, skip: Sequence[str] = ()) -> GroupSearch:
    """Add laws one after another while the evidence asks for them; floor: (n,) noise of positions [rad or m]."""
    setting = setting_of(loop, point, floor)
    base = Attempt(point, setting.evaluate([point])[0])
    setting = setting.weighted(mean_sigma(setting, base, floor))
    base = last = replace(base, squares=setting.evaluate([point])[0])
    laws = [law for law in HYPOTHESES if law.effect not in skip]
    steps, tried = list[Step](), list[tuple[str, int, float]]()
    while len(steps) < MOST and not at_floor(setting, last, floor):
        offers = offered(setting, last, laws, floor, "payload" not in skip)
        step = choose(setting, last, offers, floor)
        tried = rejected(last, offers) if step is None else []
        if step is None:
            break
        steps.append(step)
        last = refine(setting, [step.after], 4)[0]
        setting = setting_of(loop, last.where, floor).weighted(mean_sigma(setting, last, floor))
        last = refine(setting, [replace(last, squares=setting.evaluate([last.where])[0])], 3)[0]
    if not steps and not at_floor(setting, last, floor):
        last, steps, more = refitted(setting, last, laws, floor)
        tried = [] if steps else [*tried, *more]
    base = replace(base, squares=setting.evaluate([point])[0])
    return GroupSearch(setting, base, last, spread(setting, last), tuple(steps), tuple(tried))


def refitted(
    setting: Setting, last: Attempt, laws: Sequence[DriveHypothesis], floor: Array
) -> tuple[Attempt, list[Step], list[tuple[str, int, float]]]:
    """A law of another form at the worst joint, with the drive's own numbers fitted again beside it.

    A simulation that was identified with the wrong law is at its optimum: no single number improves it.
    floor: (n,) [rad or m] noise of the positions.
    """
    mean = np.sum(last.squares, axis=0) / floor**2
    j = int(np.argmax(mean))
    own = replace(last.where, slots=own_numbers(setting, last.where, j))
    start = refine(setting, [replace(last, where=own)], ROUNDS)[0]
    forms = [law for law in laws if law.effect in FORMS]
    offers = offered(setting.weighted(mean_sigma(setting, start, floor)), start, forms, floor, False, [j])
    trials = refine(setting, [offer.trial for offer in offers], ROUNDS)
    offers = sorted(
        (weighed(setting, start, replace(o, trial=t), floor) for o, t in zip(offers, trials, strict=True)),
        key=lambda o: -o.evidence,
    )
    step = choose(setting, start, offers, floor)
    if step is None:
        return last, [], rejected(last, offers)
    return step.after, [replace(step, before=last)], []


def offered(
    setting: Setting,
    last: Attempt,
    laws: Sequence[DriveHypothesis],
    floor: Array,
    body: bool,
    joints: Sequence[int] | None = None,
) -> list[Offer]:
    """The best trial of each law at each joint, or at each suspect; the most promising ones fitted.

    floor: (n,) [rad or m].
    """
    found: list[Offer] = []
    for law in laws:
        for j in suspects(setting, last, floor) if joints is None else joints:
            for servo in law.trials(last.where.servos[j], setting.reach(last.where, j)):
                servos = list(last.where.servos)
                servos[j] = servo
                mine = (setting.slot(j, number) for number in law.numbers)
                slots = (*last.where.slots, *(slot for slot in mine if slot not in last.where.slots))
                if len(slots) > len(last.where.slots) or servo.law != last.where.servos[j].law:
                    where = replace(last.where, servos=tuple(servos), slots=slots)
                    found.append(Offer(law, j, Attempt(where, np.empty(0))))
    if body and last.where.body is None:
        found += _bodies(setting, last)
    if not found:
        return []
    squares = setting.evaluate([offer.trial.where for offer in found])
    found = [
        Offer(o.law, o.joint, replace(o.trial, squares=s), -half_log(s, floor, setting))
        for o, s in zip(found, squares, strict=True)
    ]
    best: dict[tuple[str, int, tuple[float, ...]], list[Offer]] = {}
    for offer in sorted(found, key=lambda o: -o.evidence):
        shape = tuple(getattr(offer.trial.where.servos[offer.joint], number) for number in offer.law.shape)
        best.setdefault((offer.law.effect, offer.joint, shape), []).append(offer)
    first = [offers[0] for offers in best.values()]
    for kept in (POLISHED, REFINED):
        polished = iter(refine(setting, [o.trial for o in first if o.law is not PAYLOAD], 1))
        first = [replace(o, trial=o.trial if o.law is PAYLOAD else next(polished)) for o in first]
        first = sorted((weighed(setting, last, o, floor) for o in first), key=lambda o: -o.evidence)[:kept]
    fitted = refine(setting, [offer.trial for offer in first])
    return sorted(
        (weighed(setting, last, replace(o, trial=t), floor) for o, t in zip(first, fitted, strict=True)),
        key=lambda o: -o.evidence,
    )


def suspects(setting: Setting, trial: Attempt, floor: Array) -> list[int]:
    """Joints whose residual exceeds noise, beside that of the worst joint. floor: (n,) [rad or m]."""
    mean = np.sum(trial.squares, axis=0) / (setting.loop.windows * (setting.loop.rows + 1))
    excess = np.maximum(mean - floor**2, 0.0)
    return [int(j) for j in np.flatnonzero(excess >= SUSPECT * np.max(excess))]


def at_floor(setting: Setting, trial: Attempt, floor: Array) -> bool:
    """Whether no joint has more than the noise of its positions. floor: (n,) [rad or m]."""
    mean = np.sum(trial.squares, axis=0) / (setting.loop.windows * (setting.loop.rows + 1))
    return bool(np.all(mean < FLOOR * floor**2))


def choose(setting: Setting, last: Attempt, offers: Sequence[Offer], floor: Array) -> Step | None:
    """The most probable law, if the evidence for it suffices. floor: (n,) [rad or m]."""
    usable = [o for o in offers if significant(setting, last, o, floor)]
    while usable:
        top = usable[0].evidence
        best = min((o for o in usable if o.evidence > top - EQUAL), key=lambda o: LISTED.index(o.law.effect))
        if beyond_interval(setting, last, best):
            break
        usable = [o for o in usable if o is not best]
    else:
        return None
    odds = best.evidence + half_log(last.squares, floor, setting)
    if odds < THRESHOLD:
        return None
    weights = [1.0 if o is best else float(np.exp(-tempered(setting, best, o))) for o in usable]
    whole = sum(weights) + float(np.exp(-odds))
    rivals = tuple((o.law, o.joint, w / whole) for o, w in zip(usable, weights, strict=True) if o is not best)
    return Step(best.law, best.joint, last, best.trial, odds, 1.0 / whole, rivals)


def significant(setting: Setting, last: Attempt, offer: Offer, floor: Array) -> bool:
    """Whether a law changes a number beyond its tolerance and improves windows beyond chance.

    floor: (n,) [rad or m].
    """
    if offer.law is not PAYLOAD and offer.law.stated_exactly(
        last.where.servos[offer.joint], offer.trial.where.servos[offer.joint]
    ):
        return False
    change = last.squares - offer.trial.squares  # (W, n)
    gain = np.sum(change / setting.sigma**2, axis=1)
    error = float(np.std(gain)) * np.sqrt(len(gain)) + 1e-300
    share = np.sum(gain) / np.sum(last.squares / setting.sigma**2)
    worst = int(np.argmax(np.sum(change, axis=0) / floor**2))
    own = change[:, worst]
    most = float(np.sum(own) / np.sum(last.squares[:, worst]))
    windows = float(np.sum(np.abs(own)) ** 2 / (np.sum(own**2) + 1e-300))  # effective number with an improvement
    return bool(np.sum(gain) > CLUSTERED * error and share > LEAST_GAIN) or bool(most > MOSTLY and windows > FEW)


def beyond_interval(setting: Setting, last: Attempt, offer: Offer) -> bool:
    """Whether the 95 % interval of the main number of a law leaves out the value before."""
    joint, number = (-1, BODY[0]) if offer.law is PAYLOAD else (offer.joint, offer.law.numbers[0])
    where = offer.trial.where
    k = where.slots.index(setting.slot(joint, number))
    old = 0.0 if offer.law is PAYLOAD else float(getattr(last.where.servos[joint], number))
    std = float(np.sqrt(spread(setting, offer.trial)[k, k]))
    return not (np.isfinite(old) and np.isfinite(std)) or abs(where.values[k] - old) > TWO_SIDED * std


def _bodies(setting: Setting, last: Attempt) -> list[Offer]:
    j = setting.loop.leaf
    whole = sum(body.mass for body in list(setting.loop.robot.model.inertias)[1:])
    slots = (*last.where.slots, *(setting.slot(-1, number) for number in BODY))
    centre = np.array(setting.loop.robot.model.inertias[setting.loop.leaf_body].lever)
    points = []
    for mass in (0.02 * whole, 0.06 * whole, 0.15 * whole, 0.3 * whole):
        x, y, z = (mass * centre).tolist()
        points.append(replace(last.where, slots=slots, body=(mass, x, y, z)))
    return [Offer(PAYLOAD, j, Attempt(point, np.empty(0))) for point in points]


def own_numbers(setting: Setting, point: Coordinates, j: int) -> tuple[Slot, ...]:
    """Numbers that a drive has, without those that its law leaves out."""
    servo = point.servos[j]
    names = ["kp", "kd" if servo.kd > 0 else "viscous_friction", "coulomb_friction", "armature", "delay"]
    names += [name for name in ("effort_limit", "speed_limit") if np.isfinite(getattr(servo, name))]
    names += [name for name in ("load_friction", "dead_band", "droop") if getattr(servo, name) > 0]
    return tuple(setting.slot(j, name) for name in names)
