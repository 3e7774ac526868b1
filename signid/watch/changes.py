"""Frames -> lasting changes of the robot: noticed in windows with forgetting, named from the frames that follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..effects import EFFECTS
from ..effects.bodies import point_inertia
from ..model import Model
from ..types import Array
from .frames import JOINT_COLUMNS, LINK_COLUMNS, PAYLOAD_COLUMNS, Frames
from .intake import LastingChange
from .quiet import QuietNoise
from .windows import FRICTION_PAIR, TIP_JOINT, Sums, Suspect, Window, effect, gain, products

WINDOW_DURATIONS = (4.0, 60.0)  # [s] of the windows: sudden changes, and slow ones
TEST_INTERVAL = 0.5  # [s] between tests
NOTICED_CHI2 = {1: 45.0, 2: 50.0, 4: 60.0}  # [1] by number of coefficients: chi-squared, once in 1e9 tests of noise
MIN_NAMING_TIME, MAX_NAMING_TIME = 3.0, 20.0  # [s] of frames that name a change
CHANGED_THRESHOLD_RATIO = 1.25  # [1] after a change of a joint: its friction, say, depends on the load
REFINEMENT_TIME = 6.0  # [s] of further frames that make its numbers more certain
GIVE_UP_TIME = 8.0  # [s] after which a change that is not there any more is dropped
NAMED_LAW_PROBABILITY = 0.95  # [1] probability of a law that is named
MIN_EXPLAINED_SHARE = 0.6  # [1] share of the excess that a named law explains
SETTLED_DEVIATIONS = 5.0  # [standard deviations] of the main number
PIECE_DURATION = 1.0  # [s] of the pieces of the frames after a change
MIN_EXCESS_PIECES_SHARE = 0.6  # [1] share of pieces with excess with the residual of a law that make it a lasting one
ACTING_CHI2 = 9.0  # [1] squared torque of a law in a piece, over the noise, from which it acts there
MIN_ACTING_PIECES = 3  # pieces that a law acts in
MIN_LISTED_PROBABILITY = 1e-3  # [1] smallest probability of an alternative
UNKNOWN_CHANGE_RATIO = 2.0  # [1] squared residual of a piece with an unknown change, over that of noise and model
MIN_UNKNOWN_PIECES_SHARE = 0.8  # [1] share of such pieces that make the unknown change a lasting one


class Changes:
    """State of the windows, and the coefficients that are known already."""

    def __init__(self, model: Model, noise: QuietNoise) -> None:
        self.model, self.robot, self.noise = model, model.robot, noise
        n = len(model.robot.joints)
        self.base, self.first = noise.base.copy(), noise.base
        self.raised = np.ones(n)  # [1] of the thresholds, by unknown changes
        self.load = np.zeros(LINK_COLUMNS)  # payload that was found last
        self.carried = np.zeros(LINK_COLUMNS)  # all of it
        self.known: list[Suspect] = []
        self.first_named: tuple[Suspect, LastingChange] | None = None  # whose numbers more frames will correct
        self.windows = [Window(n, memory) for memory in WINDOW_DURATIONS]
        self.after: Window | None = None  # frames since a change was noticed
        self.pieces: list[Array] = []  # sums of each second since then
        self.usual: list[Array] = []  # (n,) their squared residual without a change
        self.piece = Window(n)
        self.restarts, self.noticed = 0, -np.inf  # [s] when a change was noticed
        self.since = self.in_piece = self.untested = 0.0

    def restart_after(self) -> None:
        """A contact ended: what was noticed may have been the contact, once."""
        if self.after is not None and not self.restarts and self.first_named is None:
            self._begin()
            self.restarts = 1

    def add(self, frames: Frames, step: float) -> list[LastingChange]:
        """Changes that frames of `step` [s] show."""
        sums = products(frames, self.base, self.noise)
        seconds = step * len(frames.t)
        for window in self.windows:
            window.add(sums, seconds)
        if self.after is not None:
            self._follow(sums, seconds)
        self.untested += seconds
        if self.untested < TEST_INTERVAL:
            return []
        self.untested = 0.0
        if self.first_named is not None:
            return self._correct(float(frames.t[-1]))
        if self.after is not None:
            return self._name(float(frames.t[-1]))
        if any(_noticed(one) for window in self.windows for one in window.candidates(self.noise)):
            self._begin()
            self.restarts, self.noticed = 0, float(frames.t[-1])
        return []

    def _begin(self) -> None:
        n = len(self.noise.frame)
        self.after, self.piece = Window(n), Window(n)
        self.pieces, self.usual = [], []
        self.since = self.in_piece = 0.0

    def _follow(self, sums: Sums, seconds: float) -> None:
        assert self.after is not None, "a change was noticed"
        self.after.add(sums, seconds)
        self.piece.add(sums, seconds)
        self.since += seconds
        self.in_piece += seconds
        if self.in_piece >= PIECE_DURATION:
            self.pieces.append(self.piece.sums.copy())
            self.usual.append(np.maximum(self.piece.count + self.piece.model, 1.0))
            self.piece.restart()
            self.in_piece = 0.0

    def _name(self, t: float) -> list[LastingChange]:
        """The change that the frames since it was noticed show, if the evidence suffices."""
        assert self.after is not None, "a change was noticed"
        if self.since < MIN_NAMING_TIME:
            return []
        found = self.after.candidates(self.noise)
        shares = _probabilities(found)
        for k, best in enumerate(found[:2]):
            if _noticed(best) and self._clear(best, _share(best, found, shares)) and self._lasts(best):
                events = self._named(t, k, found, shares)
                self._add(best)
                self._begin()
                self.first_named = best, events[0]
                return events
        if self.since >= GIVE_UP_TIME and not any(map(_noticed, found)):
            self._forget()
        elif self.since >= MAX_NAMING_TIME:
            return self._unknown(t, found, shares)
        return []

    def _clear(self, best: Suspect, share: float) -> bool:
        """Whether a law is sure, its main number settled, and most of the excess explained."""
        assert self.after is not None, "a change was noticed"
        settled = bool(abs(best.value[0]) > SETTLED_DEVIATIONS * best.std[0]) or len(best.columns) == len(FRICTION_PAIR)
        return settled and share >= NAMED_LAW_PROBABILITY and best.raw >= MIN_EXPLAINED_SHARE * self.after.excess

    def _lasts(self, best: Suspect) -> bool:
        """Whether the law explains the residual in most pieces that it acts in, not in a single one."""
        sums = [piece.sum(axis=0) if best.joint == TIP_JOINT else piece[best.joint] for piece in self.pieces]
        acting = [gain(x, best) > 0 for x in sums if effect(x, best) > ACTING_CHI2]
        return len(acting) >= MIN_ACTING_PIECES and float(np.mean(acting)) >= MIN_EXCESS_PIECES_SHARE

    def _add(self, best: Suspect) -> None:
        """Add a change to the coefficients that are known."""
        self.known.append(best)
        if best.joint == TIP_JOINT:
            self._loaded(best.value)
            self.raised = np.maximum(self.raised, CHANGED_THRESHOLD_RATIO)
        else:
            self.base[best.joint, list(best.columns)] += best.value
            self.raised[best.joint] = max(self.raised[best.joint], CHANGED_THRESHOLD_RATIO)

    def _loaded(self, more: Array) -> None:
        self.load = np.zeros(LINK_COLUMNS)
        self.load[: len(more)] = more
        self.carried += self.load

    def _correct(self, t: float) -> list[LastingChange]:
        """The change that was named, with numbers that further frames make more certain."""
        assert self.after is not None and self.first_named is not None, "a change was named"
        best, event = self.first_named
        if self.since < REFINEMENT_TIME:
            return []
        more, covariance = self.after.narrowed(best, self.noise)
        value = best.value.copy()
        value[: len(more)] += more
        if best.joint == TIP_JOINT and value[0] > 0 and len(value) == LINK_COLUMNS:
            value[len(more) :] = point_inertia(float(value[0]), value[1 : len(more)].tolist())
        self.known[-1] = better = best._replace(value=value, covariance=covariance)
        self._forget()
        beside = dict(event.alternatives)
        if best.joint == TIP_JOINT:
            self._loaded(value - best.value)
            return [replace(self._payload(t, better, event.probability, beside), corrects=event.t)]
        self.base[best.joint, list(best.columns)] -= best.value
        k = next(i for i, column in enumerate(best.columns) if JOINT_COLUMNS[column] == event.law)
        corrected = self._local(t, better, k, event.probability, beside)
        self.base[best.joint, list(best.columns)] += value
        return [replace(corrected, corrects=event.t)]

    def std(self, frames: Frames) -> Array:
        """Standard deviation (n,) of the torque of the changes that are known, at the last frame [N.m or N]."""
        variance = np.zeros(len(self.noise.frame))
        for one in self.known:
            c = list(one.columns[: len(one.covariance)])
            at = slice(None) if one.joint == TIP_JOINT else slice(one.joint, one.joint + 1)
            columns = frames.columns[-1, at][:, c]
            variance[at] += np.einsum("nk,kl,nl->n", columns, one.covariance, columns)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def _forget(self) -> None:
        self.after = self.first_named = None
        for window in self.windows:
            window.restart()

    def _unknown(self, t: float, found: list[Suspect], shares: list[float]) -> list[LastingChange]:
        """A lasting excess that no law explains; it becomes part of what is known and of the noise."""
        assert self.after is not None, "a change was noticed"
        power = np.array([piece[:, -1, -1] for piece in self.pieces])
        lasting = np.mean(power > UNKNOWN_CHANGE_RATIO * np.array(self.usual), axis=0) >= MIN_UNKNOWN_PIECES_SHARE
        if not lasting.any():
            self._forget()
            return []
        mean = self.after.sums[:, -1, -1] / np.maximum(self.after.count, 1.0)
        j = int(np.argmax(np.where(lasting, mean, -np.inf)))
        name, rms = self.robot.joints[j], float(self.noise.frame[j] * np.sqrt(mean[j]))
        raised = np.where(lasting, np.sqrt(np.maximum(mean, 1.0)), 1.0)
        for part in (self.noise.frame, self.raised):
            part *= raised
        self._forget()
        sentence = f"unknown change at {name}: residual of {rms:.3g} {self._unit(j)}"
        alternatives = self._alternatives(found, shares)
        return [
            LastingChange(t, "unknown", name, {"rms": rms}, {}, 1.0 - max(shares, default=0.0), sentence, alternatives)
        ]

    def _named(self, t: float, k: int, found: list[Suspect], shares: list[float]) -> list[LastingChange]:
        """Events of the k-th candidate; of two laws of friction, those that are settled."""
        best, share = found[k], _share(found[k], found, shares)
        others = [(one, p) for one, p in zip(found, shares, strict=True) if not set(one.columns) & set(best.columns)]
        beside = self._alternatives([one for one, _ in others], [p for _, p in others])
        if best.joint == TIP_JOINT:
            return [self._payload(t, best, share, beside)]
        assert self.after is not None, "a change was noticed"
        power = np.diag(self.after.sums[best.joint])[list(best.columns)] * best.value**2
        order = np.argsort(-power).tolist()  # the larger torque first
        settled = [i for i in order if abs(best.value[i]) > SETTLED_DEVIATIONS * best.std[i]]
        return [self._local(t, best, i, share, beside) for i in settled or order[:1]]

    def _payload(self, t: float, best: Suspect, probability: float, others: dict[str, float]) -> LastingChange:
        values = dict(zip(PAYLOAD_COLUMNS, map(float, best.value), strict=False))
        stds = dict(zip(PAYLOAD_COLUMNS, map(float, best.std), strict=False))
        mass, size = values["mass"], f"{abs(values['mass']):.3g} ± {1.96 * stds['mass']:.2g} kg"
        what = f"a payload of {size}" if mass > 0 else f"a load of {size} is gone"
        return LastingChange(t, "payload", self.robot.joints[-1], values, stds, probability, what, others)

    def _local(self, t: float, best: Suspect, k: int, probability: float, others: dict[str, float]) -> LastingChange:
        name = JOINT_COLUMNS[best.columns[k]]
        joint = self.robot.joints[best.joint]
        [(key, kind)] = EFFECTS[name].linear().items()
        unit = kind.unit_at(bool(self.robot.prismatic[best.joint]))
        value, std = float(best.value[k]), float(best.std[k])
        total = value + float(self.base[best.joint, best.columns[k]] - self.first[best.joint, best.columns[k]])
        size = f"{total:+.3g} ± {1.96 * std:.2g} {unit}".replace(" 1", "" if unit == "1" else " 1")
        sentence = f"{name.replace('_', ' ')} of {joint} changed by {size}"
        return LastingChange(t, name, joint, {key: total}, {key: std}, probability, sentence, others)

    def _alternatives(self, found: list[Suspect], shares: list[float]) -> dict[str, float]:
        """The next likely laws by name, with their probability."""
        return {self._label(s): p for s, p in list(zip(found, shares, strict=True))[:3] if p > MIN_LISTED_PROBABILITY}

    def _label(self, one: Suspect) -> str:
        if one.joint == TIP_JOINT:
            return "payload"
        return f"{' and '.join(JOINT_COLUMNS[k] for k in one.columns)} of {self.robot.joints[one.joint]}"

    def _unit(self, joint: int) -> str:
        return "N" if self.robot.prismatic[joint] else "N.m"


def _noticed(one: Suspect) -> bool:
    return one.gain > NOTICED_CHI2[min(len(one.columns), len(PAYLOAD_COLUMNS))]


def _share(best: Suspect, found: list[Suspect], shares: list[float]) -> float:
    """Probability of the laws of a candidate, alone or with others."""
    with_it = (set(best.columns) <= set(one.columns) and one.joint == best.joint for one in found)
    return min(1.0, sum(p for p, same in zip(shares, with_it, strict=True) if same))


def _probabilities(found: list[Suspect]) -> list[float]:
    """Posterior probabilities of candidates with equal priors."""
    if not found:
        return []
    scores = np.array([one.score for one in found])
    weight = np.exp(scores - scores.max())
    return [float(x) for x in weight / weight.sum()]
