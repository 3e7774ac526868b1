"""Frames -> lasting changes of the robot: noticed in windows with forgetting, named from the frames that follow."""

from __future__ import annotations

import numpy as np

from ..effects import EFFECTS
from ..model import Model
from ..types import Array
from .events import Change
from .frames import COLUMNS, LOCAL, PAYLOAD, Frames
from .quiet import Noise
from .windows import TIP, Candidate, Window, products

MEMORIES = (4.0, 60.0)  # [s] of the windows: sudden changes, and slow ones
EVERY = 0.5  # [s] between tests
NOTICED = {1: 45.0, 2: 50.0, 4: 60.0}  # [1] by number of coefficients: chi-squared, once in 1e9 tests of noise
SHORTEST, LONGEST = 3.0, 20.0  # [s] of frames that name a change
GIVEN_UP = 8.0  # [s] after which a change that is not there any more is dropped
SURE = 0.95  # [1] probability of a law that is named
EXPLAINED = 0.6  # [1] share of the excess that a named law explains
SETTLED = 5.0  # [standard deviations] of the main number
PIECE = 1.0  # [s] of the pieces of the frames after a change
OFTEN = 0.6  # [1] share of pieces with excess that make an unknown change a lasting one
PRESENT = 30.0  # [1] excess of such a piece


class Changes:
    """State of the windows, and the coefficients that are known already."""

    def __init__(self, model: Model, noise: Noise) -> None:
        self.model, self.robot, self.noise = model, model.robot, noise
        n = len(model.robot.joints)
        self.base = np.zeros((n, COLUMNS))
        self.base[:, : len(LOCAL)] = noise.base
        self.first = self.base.copy()
        self.windows = [Window(n, memory) for memory in MEMORIES]
        self.after: Window | None = None  # frames since a change was noticed
        self.pieces: list[float] = []
        self.piece = Window(n)
        self.since = self.in_piece = self.untested = 0.0

    def restart_after(self) -> None:
        """A contact ended: what was noticed may have been the contact."""
        if self.after is not None:
            self._begin()
        for window in self.windows:
            window.restart()

    def add(self, frames: Frames, step: float) -> list[Change]:
        """Changes that frames of `step` [s] show."""
        sums, usable = products(frames, self.base, self.noise)
        seconds = step * len(frames.t)
        for window in self.windows:
            window.add(sums, usable, seconds)
        if self.after is not None:
            self._follow(sums, usable, seconds)
        self.untested += seconds
        if self.untested < EVERY:
            return []
        self.untested = 0.0
        if self.after is not None:
            return self._name(float(frames.t[-1]))
        if any(_noticed(one) for window in self.windows for one in window.candidates(self.noise)):
            self._begin()
        return []

    def _begin(self) -> None:
        n = len(self.noise.frame)
        self.after, self.piece, self.pieces = Window(n), Window(n), []
        self.since = self.in_piece = 0.0

    def _follow(self, sums: Array, usable: Array, seconds: float) -> None:
        assert self.after is not None, "a change was noticed"
        self.after.add(sums, usable, seconds)
        self.piece.add(sums, usable, seconds)
        self.since += seconds
        self.in_piece += seconds
        if self.in_piece >= PIECE:
            self.pieces.append(self.piece.excess)
            self.piece.restart()
            self.in_piece = 0.0

    def _name(self, t: float) -> list[Change]:
        """The change that the frames since it was noticed show, if the evidence suffices."""
        assert self.after is not None, "a change was noticed"
        if self.since < SHORTEST:
            return []
        found = self.after.candidates(self.noise)
        best = found[0] if found else None
        shares = _probabilities(found)
        if best is not None and _noticed(best) and shares[0] >= SURE:
            settled = bool((np.abs(best.value[:1]) > SETTLED * best.std[:1]).all())
            if settled and best.raw >= EXPLAINED * self.after.excess:
                events = self._named(t, best, found, shares)
                self._known(best)
                return events
        if self.since >= GIVEN_UP and not any(map(_noticed, found)):
            self._forget()
        elif self.since >= LONGEST:
            return self._unknown(t, found, shares)
        return []

    def _known(self, best: Candidate) -> None:
        """Add a change to the coefficients that are known."""
        rows = slice(None) if best.joint == TIP else best.joint
        self.base[rows, list(best.columns)] += best.value
        self._forget()

    def _forget(self) -> None:
        self.after = None
        for window in self.windows:
            window.restart()

    def _unknown(self, t: float, found: list[Candidate], shares: list[float]) -> list[Change]:
        """A lasting excess that no law explains; it becomes part of what is known and of the noise."""
        assert self.after is not None, "a change was noticed"
        lasting = np.mean(np.array(self.pieces) > PRESENT) >= OFTEN if self.pieces else False
        after = self.after
        if not lasting:
            self._forget()
            return []
        excess = after.sums[:, -1, -1] - after.count
        j = int(np.argmax(excess))
        name = self.robot.joints[j]
        rms = float(self.noise.frame[j] * np.sqrt(after.sums[j, -1, -1] / max(after.count[j], 1.0)))
        raised = np.sqrt(np.maximum(after.sums[:, -1, -1] / np.maximum(after.count, 1.0), 1.0))
        self.noise.frame[:] *= raised
        self.noise.filtered[:] *= raised
        self.noise.peak[:] *= raised
        self._forget()
        sentence = f"unknown change at {name}: residual of {rms:.3g} {self._unit(j)}"
        alternatives = self._alternatives(found, shares, 0)
        return [Change(t, "unknown", name, {"rms": rms}, {}, 1.0 - max(shares, default=0.0), sentence, alternatives)]

    def _named(self, t: float, best: Candidate, found: list[Candidate], shares: list[float]) -> list[Change]:
        others = self._alternatives(found, shares, 1)
        n = len(self.robot.joints)
        if best.joint == TIP:
            values = dict(zip(PAYLOAD, map(float, best.value), strict=True))
            stds = dict(zip(PAYLOAD, map(float, best.std), strict=True))
            mass, std = values["mass"], stds["mass"]
            what = f"a payload of {mass:.3g} ± {1.96 * std:.2g} kg" if mass > 0 else f"a load of {-mass:.3g} kg is gone"
            return [Change(t, "payload", self.robot.joints[n - 1], values, stds, shares[0], what, others)]
        return [self._local(t, best, k, shares[0], others) for k in range(len(best.columns))]

    def _local(self, t: float, best: Candidate, k: int, probability: float, others: dict[str, float]) -> Change:
        name = LOCAL[best.columns[k]]
        joint = self.robot.joints[best.joint]
        [(key, kind)] = EFFECTS[name].linear().items()
        unit = kind.unit_at(bool(self.robot.prismatic[best.joint]))
        value, std = float(best.value[k]), float(best.std[k])
        total = value + float(self.base[best.joint, best.columns[k]] - self.first[best.joint, best.columns[k]])
        size = f"{total:+.3g} ± {1.96 * std:.2g} {unit}".replace(" 1", "" if unit == "1" else " 1")
        sentence = f"{name.replace('_', ' ')} of {joint} changed by {size}"
        return Change(t, name, joint, {key: total}, {key: std}, probability, sentence, others)

    def _alternatives(self, found: list[Candidate], shares: list[float], first: int) -> dict[str, float]:
        """The next likely laws by name, with their probability."""
        return {self._label(one): p for one, p in list(zip(found, shares, strict=True))[first : first + 3] if p > 1e-3}

    def _label(self, one: Candidate) -> str:
        if one.joint == TIP:
            return "payload"
        return f"{' and '.join(LOCAL[k] for k in one.columns)} of {self.robot.joints[one.joint]}"

    def _unit(self, joint: int) -> str:
        return "N" if self.robot.prismatic[joint] else "N.m"


def _noticed(one: Candidate) -> bool:
    return one.gain > NOTICED[len(one.columns)]


def _probabilities(found: list[Candidate]) -> list[float]:
    """Posterior probabilities of candidates with equal priors."""
    if not found:
        return []
    scores = np.array([one.score for one in found])
    weight = np.exp(scores - scores.max())
    return [float(x) for x in weight / weight.sum()]
