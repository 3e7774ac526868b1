"""Frames -> lasting changes of the robot: noticed in windows with forgetting, named from the frames that follow."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..effects import EFFECTS
from ..effects.bodies import INERTIA, point_inertia
from ..model import Model
from ..types import Array
from .intake import LastingChange
from .observer import FRAME_COLUMNS, JOINT_COLUMNS, LINK_COLUMNS, PAYLOAD_COLUMNS, Frames
from .quiet import QuietNoise

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
FRICTION_PAIR = (0, 1)  # of JOINT_COLUMNS: viscous and Coulomb friction, which grow together when it gets cold or dry
TIP_JOINT = -1  # joint of the payload
PAYLOAD_ROUNDS = 4  # of the inertia of a payload
FRICTION_EIGENVALUE_RATIO, PAYLOAD_EIGENVALUE_RATIO = 1e-3, 1e-9  # [1] smallest over largest, of normal equations


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
        if any(_noticed(suspect) for window in self.windows for suspect in window.candidates(self.noise)):
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
        suspects = self.after.candidates(self.noise)
        scores = np.array([candidate.score for candidate in suspects])
        weight = np.exp(scores - scores.max(initial=-np.inf))
        shares = (weight / weight.sum()).tolist()  # posterior probabilities with equal priors
        for k, best in enumerate(suspects[:2]):
            if _noticed(best) and self._clear(best, _share(best, suspects, shares)) and self._lasts(best):
                events = self._named(t, k, suspects, shares)
                self._add(best)
                self._begin()
                self.first_named = best, events[0]
                return events
        if self.since >= GIVE_UP_TIME and not any(map(_noticed, suspects)):
            self._forget()
        elif self.since >= MAX_NAMING_TIME:
            return self._unknown(t, suspects, shares)
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
        for suspect in self.known:
            c = list(suspect.columns[: len(suspect.covariance)])
            at = slice(None) if suspect.joint == TIP_JOINT else slice(suspect.joint, suspect.joint + 1)
            columns = frames.columns[-1, at][:, c]
            variance[at] += np.einsum("nk,kl,nl->n", columns, suspect.covariance, columns)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def _forget(self) -> None:
        self.after = self.first_named = None
        for window in self.windows:
            window.restart()

    def _unknown(self, t: float, suspects: list[Suspect], shares: list[float]) -> list[LastingChange]:
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
        alternatives = self._alternatives(suspects, shares)
        return [
            LastingChange(t, "unknown", name, {"rms": rms}, {}, 1.0 - max(shares, default=0.0), sentence, alternatives)
        ]

    def _named(self, t: float, k: int, suspects: list[Suspect], shares: list[float]) -> list[LastingChange]:
        """Events of the k-th candidate; of two laws of friction, those that are settled."""
        best, share = suspects[k], _share(suspects[k], suspects, shares)
        others = [
            (suspect, p)
            for suspect, p in zip(suspects, shares, strict=True)
            if not set(suspect.columns) & set(best.columns)
        ]
        beside = self._alternatives([suspect for suspect, _ in others], [p for _, p in others])
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

    def _alternatives(self, suspects: list[Suspect], shares: list[float]) -> dict[str, float]:
        """The next likely laws by name, with their probability."""
        return {
            self._label(s): p for s, p in list(zip(suspects, shares, strict=True))[:3] if p > MIN_LISTED_PROBABILITY
        }

    def _label(self, suspect: Suspect) -> str:
        if suspect.joint == TIP_JOINT:
            return "payload"
        return f"{' and '.join(JOINT_COLUMNS[k] for k in suspect.columns)} of {self.robot.joints[suspect.joint]}"

    def _unit(self, joint: int) -> str:
        return "N" if self.robot.prismatic[joint] else "N.m"


def _noticed(suspect: Suspect) -> bool:
    return suspect.gain > NOTICED_CHI2[min(len(suspect.columns), len(PAYLOAD_COLUMNS))]


def _share(best: Suspect, suspects: list[Suspect], shares: list[float]) -> float:
    """Probability of the laws of a candidate, alone or with others."""
    with_it = (set(best.columns) <= set(suspect.columns) and suspect.joint == best.joint for suspect in suspects)
    return min(1.0, sum(p for p, same in zip(shares, with_it, strict=True) if same))


class Suspect(NamedTuple):
    """A law, or two of friction, with their numbers and their evidence."""

    joint: int  # or TIP_JOINT
    columns: tuple[int, ...]  # of the frames
    value: Array  # (m,) [units of the laws]
    covariance: Array  # (k, k) [products of the units], without an inertia that follows from others
    gain: float  # [1] reduction of the squared residual in units of its variance, inflation included
    raw: float  # [1] the same without inflation
    score: float  # [1] log of the evidence: Schwarz, Annals of Statistics 6(2), 1978

    @property
    def std(self) -> Array:
        """Standard deviations (k,) [units of the laws]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


class Sums(NamedTuple):
    """Sums over frames of n joints."""

    products: Array  # (n, 15, 15) [1] of columns and residual over the noise
    frames: Array  # (n,) [1] number
    model: Array  # (n,) [1] squared error of the model over the variance of the noise


class Window:
    """Sums (n, 15, 15) of products of columns and residual, each over the noise of its joint."""

    def __init__(self, joints: int, memory: float = np.inf) -> None:
        self.sums = np.zeros((joints, FRAME_COLUMNS + 1, FRAME_COLUMNS + 1))
        self.count = np.zeros(joints)  # frames
        self.model = np.zeros(joints)  # squared error of the model by its covariance, over the variance of the noise
        self.memory = memory  # [s]

    def restart(self) -> None:
        """Forget everything."""
        self.sums[:], self.count[:], self.model[:] = 0.0, 0.0, 0.0

    def add(self, sums: Sums, seconds: float) -> None:
        """Add sums of frames that last for some seconds."""
        keep = float(np.exp(-seconds / self.memory))
        for mine, more in zip((self.sums, self.count, self.model), sums, strict=True):
            mine *= keep
            mine += more

    def inflation(self, noise: QuietNoise) -> Array:
        """Variance (n, 14) of the sums of each column over that of white noise, with the error of the model [1]."""
        return np.asarray(noise.inflation * (1 + self.model)[:, None])

    def narrowed(self, suspect: Suspect, noise: QuietNoise) -> tuple[Array, Array]:
        """Change (k,) of the numbers of a known law by this window, and their covariance (k, k) with both.

        Where the law leaves more than the noise of the quiet stretch, the window counts less by that misfit.
        """
        c = list(suspect.columns[: len(suspect.covariance)])
        tip = suspect.joint == TIP_JOINT
        at = slice(None) if tip else slice(suspect.joint, suspect.joint + 1)
        sums, count = self.sums[at].sum(axis=0), float(self.count[at].sum())
        power = np.maximum(np.einsum("nkk->n", self.sums[at][:, c][:, :, c]), 1e-300)
        whole = self.inflation(noise)[at][:, c].mean(axis=1)
        alone = np.linalg.lstsq(sums[np.ix_(c, c)], sums[c, -1], rcond=None)[0]
        misfit = max(1.0, float(sums[-1, -1] - alone @ sums[c, -1]) / max(count, 1.0))
        inflated = misfit * float(power @ whole / power.sum())
        covariance = np.linalg.inv(np.linalg.inv(suspect.covariance) + sums[np.ix_(c, c)] / inflated)
        return covariance @ sums[c, -1] / inflated, covariance

    @property
    def excess(self) -> float:
        """Squared residual [1], in units of its variance, beyond that of noise, over all joints."""
        return float(np.maximum(self.sums[:, -1, -1] - self.count, 0.0).sum())

    def candidates(self, noise: QuietNoise) -> list[Suspect]:
        """All laws that act in the window, the best first.

        An error of the model lasts for the whole window, so its square is not divided by the number of frames.
        """
        whole = self.inflation(noise)
        excess = np.maximum(self.sums[:, -1, -1] - self.count, 1e-9)
        common = float(excess @ whole.mean(axis=1) / excess.sum())  # or the score prefers noisy joints
        suspects, count = [], float(self.count.sum())
        for j, sums in enumerate(self.sums):
            for columns in ((0,), (1,), (2,), (3,), FRICTION_PAIR):
                if suspect := _fit(sums, columns, j):
                    own = float(np.mean(whole[j, list(columns)]))
                    suspects.append(_scaled(suspect, own, common, self.count[j]))
        if suspect := _payload(self.sums.sum(axis=0)):
            suspects.append(_scaled(suspect, common, common, count))
        return sorted(suspects, key=lambda suspect: -suspect.score)


def products(frames: Frames, base: Array, noise: QuietNoise) -> Sums:
    """Sums of usable frames; base: (n, 4) coefficients of JOINT_COLUMNS that are known already [units of the laws]."""
    known = np.einsum("fnk,nk->fn", frames.columns[:, :, : len(JOINT_COLUMNS)], base)
    whole = np.concatenate([frames.columns, (frames.residual - known)[:, :, None]], axis=2)
    whole *= (frames.usable / noise.frame)[:, :, None]
    by_joint = whole.transpose(1, 0, 2)
    model = np.sum(frames.usable * np.minimum(frames.std / noise.frame, 1.0) ** 2, axis=0)  # at most what was measured
    return Sums(by_joint.transpose(0, 2, 1) @ by_joint, frames.usable.sum(axis=0).astype(float), model)


def gain(sums: Array, suspect: Suspect) -> float:
    """Reduction of the squared residual [1] by a candidate; sums: (15, 15) [1] of its joint, or of all joints."""
    c, value = list(suspect.columns), suspect.value
    return float(2 * value @ sums[c, -1] - value @ sums[np.ix_(c, c)] @ value)


def effect(sums: Array, suspect: Suspect) -> float:
    """Squared torque [1] of a candidate in units of the variance of the noise; sums: (15, 15) [1]."""
    c = list(suspect.columns)
    return float(suspect.value @ sums[np.ix_(c, c)] @ suspect.value)


def _scaled(suspect: Suspect, own: float, common: float, count: float) -> Suspect:
    """Suspect with its evidence: variances inflated by its own factor, the score by a common one."""
    cost = min(len(suspect.columns), len(PAYLOAD_COLUMNS)) * np.log(max(count, 2.0))
    return suspect._replace(
        covariance=suspect.covariance * own, gain=suspect.raw / own, score=0.5 * (suspect.raw / common - cost)
    )


def _payload(sums: Array) -> Suspect | None:
    """Point mass at the last link: mass and first moment, and the inertia that follows from them."""
    first, columns = len(JOINT_COLUMNS), tuple(range(len(JOINT_COLUMNS), len(JOINT_COLUMNS) + len(PAYLOAD_COLUMNS)))
    inertia, shifted, suspect = np.zeros(len(INERTIA)), sums, None
    turning = list(range(first + len(PAYLOAD_COLUMNS), FRAME_COLUMNS))
    for _ in range(PAYLOAD_ROUNDS):
        suspect = _fit(shifted, columns, TIP_JOINT)
        if suspect is None or not suspect.value[0] > 0:
            return suspect
        inertia = np.array(point_inertia(float(suspect.value[0]), suspect.value[1:].tolist()))
        shifted = sums.copy()
        shifted[:, -1] -= sums[:, turning] @ inertia
    assert suspect is not None, "there is a round"
    whole = suspect._replace(columns=tuple(range(first, FRAME_COLUMNS)), value=np.concatenate([suspect.value, inertia]))
    return whole._replace(raw=gain(sums, whole))


def _fit(sums: Array, columns: tuple[int, ...], joint: int) -> Suspect | None:
    """Least squares of the columns, without evidence; None if the window does not excite them."""
    c = list(columns)
    normal, right = sums[np.ix_(c, c)], sums[c, -1]
    size = np.sqrt(np.diag(normal))
    if not size.max() > 0 or (joint != TIP_JOINT and not (size > 0).all()):
        return None
    size = np.maximum(size, PAYLOAD_EIGENVALUE_RATIO * size.max())
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    seen = values > (PAYLOAD_EIGENVALUE_RATIO if joint == TIP_JOINT else FRICTION_EIGENVALUE_RATIO) * values[-1]
    if joint != TIP_JOINT and not seen.all():
        return None
    root = vectors[:, seen] / np.sqrt(values[seen])
    inverse = (root @ root.T) / np.outer(size, size)
    value = inverse @ right
    return Suspect(joint, columns, value, inverse, 0.0, float(right @ value), 0.0)
