"""Stepwise search for the laws that drives lack, in one group of coupled joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np

from ...diagnose.evidence.bayes_factors import StackedPriors, log_bayes_factor
from ...effects.drive import Reach
from ...types import TWO_SIDED, Array
from ..fit.coordinates import BODY, Coordinates, Slot
from ..fit.fit import damped
from ..fit.normal import Normal, StateSlopes, covariance, derivatives, nearby, reduced, state_slopes
from .closed_loop import ClosedLoop
from .hypotheses import HYPOTHESES, DriveHypothesis

MAX_GROUP_LAWS = 3  # laws that are added to one group
POLISHED, REFINED = 24, 8  # hypotheses that get a second iteration, and that are fitted, in each step
THRESHOLD = 5.0  # log posterior odds that a law needs. Heuristic
TWIN_LOG_ODDS = 0.5  # log odds, within which the law that is listed first stands for its twins
CLUSTERED = 3.0  # [1] improvement over its standard error across windows that a law needs
FORMS = ("speed_limit", "duty_limit", "effort_limit", "dead_band", "profile_limit", "load_friction", "voltage_droop")
ROUNDS = 8  # iterations of fits with all numbers of a drive
LEAST_GAIN = 0.02  # [1] share of the squared residual that a law explains, at least
RARE_SHARE, RARE_WINDOWS = 0.5, 1.5  # [1] of a joint's squared residual; windows: what rare events like limits explain
FLOOR = 1.15  # [1] mean square over that of noise, below which nothing is missing
SUSPECT = 0.03  # [1] of the largest excess of a joint over noise: joints with less are not searched. Heuristic
PAYLOAD = DriveHypothesis(
    effect="payload", numbers=BODY, meaning="a body hangs at the last link", variable="position", trials=lambda *_: []
)
LISTED = [*(law.effect for law in HYPOTHESES), PAYLOAD.effect]
DAMPINGS = (1e-9, 0.3, 3.0, 30.0)  # [1] of Levenberg and Marquardt, tried together
DIFFERENCE_FACTOR = 2.0  # differences over those of an identification: the cost is rougher far from the optimum
PER_WINDOW = 10  # samples of a window that count as independent, at most. Heuristic
BATCH = 32  # points that are simulated together: more take memory
ALLOWED_LOG_ODDS = 1.0  # log odds that differences across windows always allow. Heuristic


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
    while len(steps) < MAX_GROUP_LAWS and not at_floor(setting, last, floor):
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
        best = min((o for o in usable if o.evidence > top - TWIN_LOG_ODDS), key=lambda o: LISTED.index(o.law.effect))
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
    count = float(np.sum(np.abs(own)) ** 2 / (np.sum(own**2) + 1e-300))  # effective windows with an improvement
    return bool((gain.sum() > CLUSTERED * error and share > LEAST_GAIN) or (most > RARE_SHARE and count > RARE_WINDOWS))


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


@dataclass(frozen=True, eq=False)
class Attempt:
    """A hypothesis at some values: W windows, n joints of the group."""

    where: Coordinates  # at the values
    squares: Array  # (W, n) sums of squares without the initial states [rad2 or m2]

    def cost(self, sigma: Array) -> float:
        """Weighted sum of squares. sigma: (n,) [rad or m]."""
        return float(np.sum(self.squares / sigma**2)) + self.where.prior_cost(self.where.values)


@dataclass(frozen=True, eq=False)
class Setting:
    """Windows, initial states and weights that the fits share."""

    loop: ClosedLoop
    states: Array  # (2n, W, T, n) [1]
    sigma: Array  # (n,) [rad or m]

    @cached_property
    def slopes(self) -> StateSlopes:
        """Influence of the initial states."""
        return state_slopes(self.states, self.sigma)

    def evaluate(self, points: Sequence[Coordinates]) -> Array:
        """Sums of squares (C, W, n) after the best initial states."""
        batches = (points[k : k + BATCH] for k in range(0, len(points), BATCH))
        return np.concatenate([np.sum(self.remaining(batch) ** 2, axis=2) for batch in batches])

    def remaining(self, points: Sequence[Coordinates]) -> Array:
        """Residuals (C, W, T, n) after the best initial states."""
        return self.slopes.leave(self.loop.residuals(points) / self.sigma) * self.sigma

    def weighted(self, sigma: Array) -> Setting:
        """The same with other weights. sigma: (n,) [rad or m]."""
        return replace(self, sigma=sigma)

    def slot(self, joint: int, number: str) -> Slot:
        """A free number of a joint of the group, or of the body at the last link (joint -1)."""
        if joint < 0:
            whole = sum(body.mass for body in list(self.loop.robot.model.inertias)[1:])
            return Slot(joint, number, 0.1 * whole * (1.0 if number == "mass" else 0.1))
        return Slot(joint, number, self.loop.sizes[joint].get(number, 1.0))

    def reach(self, point: Coordinates, j: int) -> Reach:
        """Sizes at a joint."""
        loop, servo = self.loop, point.servos[j]
        v, a = loop.motion.v[:, j], loop.motion.a[:, j]
        torque = loop.torque[:, j] + servo.armature * a + servo.damping * v
        effort = float(np.max(np.abs(torque)) + servo.coulomb_friction)
        column = loop.joints[j]
        error = max(float(np.max(np.abs(g.command[:, column] - g.q[:, column]))) for g in loop.grids)
        travel = float(np.ptp(loop.motion.q[:, j]))
        return Reach(effort, float(np.max(np.abs(v))), error, float(np.sqrt(np.mean(a**2))), travel)


def setting_of(loop: ClosedLoop, point: Coordinates, floor: Array) -> Setting:
    """Setting of windows with the initial states at a point. floor: (n,) [rad or m]."""
    return Setting(loop, loop.state_columns(point), floor * 2.0)


def refine(setting: Setting, trials: Sequence[Attempt], iterations: int = 6, tolerance: float = 1e-4) -> list[Attempt]:
    """Fit each hypothesis from its values."""
    trials, active = list(trials), list(range(len(trials)))
    for _ in range(iterations):
        if not active:
            break
        before = [trials[k] for k in active]
        points = [
            trial.where.at(damped(trial.where, at, trial.where.values, damping))
            for trial, at in zip(before, _normals(setting, [trial.where for trial in before]), strict=True)
            for damping in DAMPINGS
        ]
        tried, count = map(Attempt, points, setting.evaluate(points)), len(DAMPINGS)
        moved = [  # the best of the dampings, or the values before
            min([trial, *islice(tried, count)], key=lambda t: t.cost(setting.sigma)) for trial in before
        ]
        gains = [
            1 - new.cost(setting.sigma) / trials[k].cost(setting.sigma) for k, new in zip(active, moved, strict=True)
        ]
        for k, new in zip(active, moved, strict=True):
            trials[k] = new
        active = [k for k, gain in zip(active, gains, strict=True) if gain > tolerance]
    return trials


def information(setting: Setting, where: Coordinates) -> Array:
    """Information (P, P) [inverse products of SERVO_UNITS] of the free numbers, without the initial states."""
    return _normals(setting, [where])[0].information


def spread(setting: Setting, trial: Attempt) -> Array:
    """Covariance (P, P) [products of SERVO_UNITS] of the free numbers."""
    where = trial.where
    (at,) = _normals(setting, [where])
    weight = where.prior(where.values)[0] / where.slope(where.values) ** 2
    return covariance(at.information + np.diag(weight), at.scores)


def _normals(setting: Setting, wheres: Sequence[Coordinates]) -> list[Normal]:
    """Normal equations of several hypotheses."""
    out = list[Normal]()
    for where in wheres:
        near = nearby(where, where.values, DIFFERENCE_FACTOR, central=True)
        left = setting.loop.residuals([where.at(values) for values in near.values]) / setting.sigma
        out.append(reduced(derivatives(left, where, near), left[0], setting.slopes))
    return out


@dataclass(frozen=True, eq=False)
class Offer:
    """A hypothesis with its fitted trial and log evidence."""

    law: DriveHypothesis
    joint: int
    trial: Attempt
    evidence: float = -np.inf  # log likelihood and prior
    prior: float = 0.0  # log prior probability, with that of its numbers


def rejected(last: Attempt, offers: Sequence[Offer]) -> list[tuple[str, int, float]]:
    """Laws of offers, their joints, and the share of the squared residual there that each explains [1]."""
    before = np.sum(last.squares, axis=0)
    return [(o.law.effect, o.joint, float(1 - o.trial.squares[:, o.joint].sum() / before[o.joint])) for o in offers]


def tempered(setting: Setting, best: Offer, rival: Offer) -> float:
    """Log odds of the best over a rival, at most what the differences across windows allow (Vuong 1989)."""
    prior = best.prior - rival.prior
    difference = np.sum((rival.trial.squares - best.trial.squares) / setting.sigma**2, axis=1)
    return limited(best.evidence - rival.evidence - prior, prior, difference)


def limited(odds: float, prior: float, difference: Array) -> float:
    """Log odds of likelihood and prior, at most what the differences of the windows allow.

    difference: (W,) [1] of the weighted squares of each window.
    """
    error = float(np.std(difference)) * np.sqrt(len(difference)) + 1e-300
    z = max(float(np.sum(difference)) / error, 0.0)
    return float(max(prior + min(odds, 0.5 * z * z + ALLOWED_LOG_ODDS), 0.0))


def mean_sigma(setting: Setting, trial: Attempt, floor: Array) -> Array:
    """Weights of the joints: rms of the residual and noise, (n,) [rad or m]. floor: (n,) [rad or m]."""
    rows = setting.loop.rows + 1
    return np.asarray(np.sqrt(np.mean(trial.squares, axis=0) / rows + floor**2))


def half_log(squares: Array, floor: Array, setting: Setting) -> float:
    """Negative log likelihood: half the number of independent samples times the log of the mean square, all joints.

    squares: (W, n) [rad2 or m2]; floor: (n,) [rad or m].
    """
    rows = setting.loop.rows + 1
    return half_log_of(squares / rows, floor, rows)


def half_log_of(mean: Array, floor: Array, rows: int) -> float:
    """The same by mean squares of windows of some rows.

    mean: (W, n) [rad2 or m2]; floor: (n,) [rad or m].
    """
    whole = np.log(np.mean(mean, axis=0) + 0.1 * floor**2)
    return float(0.5 * len(mean) * min(rows, PER_WINDOW) * np.sum(whole))


def price(setting: Setting, last: Attempt, trial: Attempt) -> float:
    """Log prior of the additional numbers, as in a diagnosis of torque: typical sizes times each effect size."""
    new = [k for k, slot in enumerate(trial.where.slots) if slot not in last.where.slots]
    if not new:
        return 0.0
    sizes = [trial.where.slots[k].typical for k in new]
    return price_of(information(setting, trial.where), new, sizes, setting.loop.rows + 1)


def price_of(whole: Array, new: Sequence[int], sizes: Sequence[float], rows: int) -> float:
    """The same by the information of all numbers, in windows of some rows, and typical sizes of the new ones.

    whole: (P, P) [inverse products of SERVO_UNITS].
    """
    whole = whole * min(rows, PER_WINDOW) / rows
    old = [k for k in range(len(whole)) if k not in new]
    across = whole[np.ix_(old, new)]
    own = whole[np.ix_(new, new)] - across.T @ np.linalg.pinv(whole[np.ix_(old, old)], hermitian=True) @ across
    nothing = np.zeros((1, len(new)))
    return float(
        log_bayes_factor(StackedPriors(np.diag(sizes)[None], nothing, nothing * np.nan), own[None], nothing)[0]
    )


def weighed(setting: Setting, last: Attempt, offer: Offer, floor: Array) -> Offer:
    """The offer with its log evidence and its log prior. floor: (n,) [rad or m]."""
    choices = len(HYPOTHESES) * len(last.where.servos)
    before, after = last.where.servos[offer.joint], offer.trial.where.servos[offer.joint]
    prior = float(np.log(offer.law.plausible(before, after) / choices)) + price(setting, last, offer.trial)
    return replace(offer, evidence=prior - half_log(offer.trial.squares, floor, setting), prior=prior)
