"""Stepwise search for the laws that drives lack, in one group of coupled joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...types import Array
from .closed_loop import ClosedLoop, Point
from .coordinates import BODY, Free, own_numbers
from .laws import HYPOTHESES, DriveLaw
from .refine import Attempt, Setting, reach, refine, setting_of

MOST = 3  # laws that are added to one group
PER_WINDOW = 10  # samples of a window that count as independent, at most. Heuristic
REFINED = 8  # hypotheses that are fitted in each step
THRESHOLD = 5.0  # log posterior odds that a law needs. Heuristic
CLUSTERED = 3.0  # [1] improvement over its standard error across windows that a law needs
FORMS = ("speed_limit", "duty_limit", "effort_limit", "dead_band", "profile_limit", "load_friction", "voltage_droop")
ROUNDS = 8  # iterations of fits with all numbers of a drive
SLACK = 1.0  # log odds that differences across windows always allow. Heuristic
LEAST_GAIN = 0.02  # [1] share of the squared residual that a law explains, at least
MOSTLY, FEW = 0.5, 1.5  # [1] share of a joint's squared residual, windows: what rare events such as limits explain
FLOOR = 1.15  # [1] mean square over that of noise, below which nothing is missing
SUSPECT = 0.03  # [1] of the largest excess of a joint over noise: joints with less are not searched. Heuristic
PAYLOAD = DriveLaw(
    effect="payload",
    numbers=BODY,
    meaning="a body hangs at the last link",
    variable="position",
    trials=lambda *_: [],
)


@dataclass(frozen=True, eq=False)
class Step:
    """A law that was added."""

    law: DriveLaw
    joint: int  # in the group
    before: Attempt
    after: Attempt
    log_odds: float
    probability: float
    rivals: tuple[tuple[DriveLaw, int, float], ...]  # law, joint, probability


@dataclass(frozen=True, eq=False)
class GroupSearch:
    """Laws that were added to a group, in their order."""

    setting: Setting
    base: Attempt  # the given simulation
    last: Attempt
    steps: tuple[Step, ...] = ()


@dataclass(frozen=True, eq=False)
class Offer:
    """A hypothesis with its fitted trial and log evidence."""

    law: DriveLaw
    joint: int
    trial: Attempt
    evidence: float = -np.inf  # log likelihood and prior
    prior: float = 0.0  # log prior probability, with that of its numbers


def search(loop: ClosedLoop, point: Point, floor: Array, skip: Sequence[str] = (), body: bool = True) -> GroupSearch:
    """Add laws one after another while the evidence asks for them; floor: (n,) noise of positions [rad or m]."""
    setting = setting_of(loop, point, floor)
    base = Attempt(point, [], setting.evaluate([point])[0])
    setting = setting.weighted(_sigma(setting, base, floor))
    base = last = replace(base, squares=setting.evaluate([point])[0])
    laws = [law for law in HYPOTHESES if law.effect not in skip]
    steps: list[Step] = []
    while len(steps) < MOST and not at_floor(setting, last, floor):
        offers = offered(setting, last, laws, floor, body and "payload" not in skip)
        step = choose(setting, last, offers, floor)
        if step is None:
            break
        steps.append(step)
        last = refine(setting, [step.after], 4)[0]
        setting = setting_of(loop, last.point, floor).weighted(_sigma(setting, last, floor))
        last = refine(setting, [replace(last, squares=setting.evaluate([last.point])[0])], 3)[0]
    if not steps and not at_floor(setting, last, floor):
        last, steps = refitted(setting, last, laws, floor)
    base = replace(base, squares=setting.evaluate([point])[0])
    return GroupSearch(setting, base, last, tuple(steps))


def refitted(setting: Setting, last: Attempt, laws: Sequence[DriveLaw], floor: Array) -> tuple[Attempt, list[Step]]:
    """A law of another form at the worst joint, with the drive's own numbers fitted again beside it.

    A simulation that was identified with the wrong law is at its optimum: no single number improves it.
    floor: (n,) [rad or m] noise of the positions.
    """
    mean = np.sum(last.squares, axis=0) / floor**2
    j = int(np.argmax(mean))
    own = own_numbers(last.point, j)
    start = refine(setting, [replace(last, frees=own)], ROUNDS)[0]
    forms = [law for law in laws if law.effect in FORMS]
    offers = offered(setting.weighted(_sigma(setting, start, floor)), start, forms, floor, body=False)
    offers = [offer for offer in offers if offer.joint == j]
    trials = refine(setting, [offer.trial for offer in offers], ROUNDS)
    offers = sorted(
        (_weighed(setting, start, replace(o, trial=t), floor) for o, t in zip(offers, trials, strict=True)),
        key=lambda o: -o.evidence,
    )
    step = choose(setting, start, offers, floor)
    return (last, []) if step is None else (step.after, [replace(step, before=last)])


def offered(setting: Setting, last: Attempt, laws: Sequence[DriveLaw], floor: Array, body: bool) -> list[Offer]:
    """The best trial of each law at each joint; the most promising ones fitted. floor: (n,) [rad or m]."""
    found: list[Offer] = []
    for law in laws:
        for j in suspects(setting, last, floor):
            for servo in law.trials(last.point.servos[j], reach(setting, last.point, j)):
                servos = list(last.point.servos)
                servos[j] = servo
                frees = [*last.frees, *(f for f in (Free(j, number) for number in law.numbers) if f not in last.frees)]
                if len(frees) > len(last.frees) or servo.law != last.point.servos[j].law:
                    found.append(Offer(law, j, Attempt(Point(tuple(servos), last.point.body), frees, np.empty(0))))
    if body and last.point.body is None:
        found += _bodies(setting, last)
    if not found:
        return []
    squares = setting.evaluate([offer.trial.point for offer in found])
    found = [
        Offer(o.law, o.joint, replace(o.trial, squares=s), -_half_log(s, floor, setting))
        for o, s in zip(found, squares, strict=True)
    ]
    best: dict[tuple[str, int], list[Offer]] = {}
    for offer in sorted(found, key=lambda o: -o.evidence):
        best.setdefault((offer.law.effect, offer.joint), []).append(offer)
    first = [offers[0] for offers in best.values()]
    polished = refine(setting, [o.trial for o in first if o.law is not PAYLOAD], 2)
    again = iter(polished)
    first = [replace(o, trial=o.trial if o.law is PAYLOAD else next(again)) for o in first]
    first = sorted((_weighed(setting, last, o, floor) for o in first), key=lambda o: -o.evidence)
    fitted = refine(setting, [offer.trial for offer in first[:REFINED]])
    return sorted(
        (_weighed(setting, last, replace(o, trial=t), floor) for o, t in zip(first[:REFINED], fitted, strict=True)),
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
    if not usable:
        return None
    best = usable[0]
    odds = best.evidence + _half_log(last.squares, floor, setting)
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
        last.point.servos[offer.joint], offer.trial.point.servos[offer.joint]
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


def tempered(setting: Setting, best: Offer, rival: Offer) -> float:
    """Log odds of the best over a rival, at most what the differences across windows allow (Vuong 1989)."""
    prior = best.prior - rival.prior
    odds = best.evidence - rival.evidence - prior
    difference = np.sum((rival.trial.squares - best.trial.squares) / setting.sigma**2, axis=1)
    error = float(np.std(difference)) * np.sqrt(len(difference)) + 1e-300
    z = max(float(np.sum(difference)) / error, 0.0)
    return float(max(prior + min(odds, 0.5 * z * z + SLACK), 0.0))


def _bodies(setting: Setting, last: Attempt) -> list[Offer]:
    j = setting.loop.leaf
    whole = sum(body.mass for body in list(setting.loop.robot.model.inertias)[1:])
    frees = [*last.frees, *(Free(-1, number) for number in BODY)]
    centre = np.array(setting.loop.robot.model.inertias[setting.loop.leaf_body].lever)
    masses = [x * whole for x in (0.02, 0.06, 0.15, 0.3)]
    points = [Point(last.point.servos, (m, *(m * centre).tolist())) for m in masses]
    return [Offer(PAYLOAD, j, Attempt(point, frees, np.empty(0))) for point in points]


def _sigma(setting: Setting, trial: Attempt, floor: Array) -> Array:
    rows = setting.loop.rows + 1
    return np.asarray(np.sqrt(np.mean(trial.squares, axis=0) / rows + floor**2))


def _half_log(squares: Array, floor: Array, setting: Setting) -> float:
    """Negative log likelihood: half the number of independent samples times the log of the mean square, all joints."""
    windows, rows = squares.shape[0], setting.loop.rows + 1
    mean = np.sum(squares, axis=0) / (windows * rows)
    return float(0.5 * windows * min(rows, PER_WINDOW) * np.sum(np.log(mean + 0.1 * floor**2)))


def _occam(setting: Setting, last: Attempt, trial: Attempt) -> float:
    """Log prior of the additional numbers (BIC)."""
    samples = setting.loop.windows * min(setting.loop.rows + 1, PER_WINDOW)
    return -0.5 * (len(trial.frees) - len(last.frees)) * float(np.log(samples))


def _weighed(setting: Setting, last: Attempt, offer: Offer, floor: Array) -> Offer:
    choices = len(HYPOTHESES) * len(last.point.servos)
    before, after = last.point.servos[offer.joint], offer.trial.point.servos[offer.joint]
    prior = float(np.log(offer.law.plausible(before, after) / choices)) + _occam(setting, last, offer.trial)
    return replace(offer, evidence=prior - _half_log(offer.trial.squares, floor, setting), prior=prior)
