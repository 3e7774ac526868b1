"""Identification problem of drives, and its trials: fits to all training data, errors on windows that took no part."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...model import Model
from ...robot.joints import similar_joints
from ...servos import Servo, ServoGrid
from ...types import Array, Progress
from ..fit import ServoFit, fit_servos
from ..given import UNSHARED, Assumptions, unions
from ..plant.course import recorded_course
from ..plant.roll_out import roll_out_along
from .data import ServoData

BOOTSTRAP_DRAWS = 2000  # Bayesian bootstrap (Rubin, Annals of Statistics 9(1), 1981)
SCORE_TOLERANCE = 0.05  # log rms; closer scores count as equal
LAW_PRIOR = {"torque_speed": 0.25}  # share of a law among equal ones; it contains `effort`
MIN_LOG_GAIN = 0.01  # log rms that an additional number must save on windows that took no part
SAVING_ERRORS = 2.0  # standard errors of that saving
MAX_RMS_GROWTH = 1.02  # ratio by which the rms over all these windows may grow
MIN_SCORED_RMS = 1e-6  # [rad or m] rms below which windows are equally good
SCORE_WINDOW = 1.0  # [s] of the scores
STEPS, FOLD_STEPS = 15, 3  # most iterations on all training data, and from there without a fold
SHORT_WINDOW = 0.2  # [s] of the first windows where drives saturate: nearly linear
ROUNDS = 2  # fits in which a limit that is tied to kp follows it
DIVERGED = 10.0  # [rad or m] an error beyond this counts as this
TRIAL_ERROR_RATIO = 0.98  # error on the training data, over that without a number, from which it is cross-validated
EARLY_NUMBER = "load_friction"  # tried before laws of joints that saturate rarely: else limits fit friction
ADDITIONAL = (EARLY_NUMBER, "dead_band", "droop", "profile_speed")
WINDOW_FACTORS = (2.0, 4.0, 16.0)  # of the windows, one after another
MIN_WINDOWS = 16  # windows in all recordings: fewer give no intervals
LONGER_STEPS = 8  # most iterations
LONGER_WINDOW_RATIO = 1.15  # error of whole recordings over that of windows from which longer windows are tried
WHOLE_ERROR_RATIO = 0.98  # error of whole recordings over that before, geometric mean of the joints, so that they stay
Estimates = Mapping[str, tuple[float, float]]  # value and standard deviation by number [SERVO_UNITS]


@dataclass(frozen=True)
class Candidate:
    """Drives to start a fit from, and their free numbers."""

    servos: Mapping[str, Servo]
    free: tuple[tuple[str, str], ...]
    tied: Mapping[str, float] = field(default_factory=dict)  # effort limit over kp [rad or m], by joint
    usual: Mapping[str, float] = field(default_factory=dict)  # kp by joint, about which an unknown scale stays
    window: float = 0.0  # [s] of the windows of its fits; 0: that of the search
    assumptions: Assumptions = Assumptions()

    def changed(self, servos: Mapping[str, Servo], free: Sequence[tuple[str, str]] = ()) -> Candidate:
        """With other drives at some joints, and more free numbers."""
        return replace(self, servos={**self.servos, **servos}, free=tuple(dict.fromkeys((*self.free, *free))))

    def only(self, joints: Collection[str]) -> Candidate:
        """The same for some joints; the others follow the recorded motion."""
        return replace(
            self,
            servos={joint: servo for joint, servo in self.servos.items() if joint in joints},
            free=tuple(name for name in self.free if name[0] in joints),
            tied={joint: error for joint, error in self.tied.items() if joint in joints},
        )

    def with_limits(self, joints: Collection[str]) -> Candidate:
        """With limits of their own at joints where they were tied to gains: a supply that sags gives less torque."""
        tied = {joint: error for joint, error in self.tied.items() if joint not in joints}
        return replace(self.changed({}, [(joint, "effort_limit") for joint in joints]), tied=tied)

    def united(self) -> Candidate:
        """With the law, the free numbers and the mean of each number of equal joints."""
        servos, free = dict(self.servos), list(self.free)
        for members in ([j for j in group if j in servos] for group in self.assumptions.equal):
            names = dict.fromkeys(name for joint, name in self.free if joint in members and name != UNSHARED)
            means = dict[str, float]()
            for name in names:
                finite = [x for joint in members if np.isfinite(x := getattr(servos[joint], name))]
                means |= {name: float(np.mean(finite))} if finite else {}
            servos |= {j: replace(servos[j], law=servos[members[0]].law).with_(**means) for j in members}
            free += [(joint, name) for joint in members for name in names]
        return replace(self, servos=servos, free=tuple(dict.fromkeys(free)))

    def follow(self, servos: Mapping[str, Servo]) -> Candidate:
        """With other drives, whose tied limits follow their gains."""
        tied = {j: servos[j].with_(effort_limit=servos[j].kp * error) for j, error in self.tied.items()}
        return replace(self, servos={**servos, **tied})


@dataclass(frozen=True)
class ServoTrial:
    """A candidate, fitted to all training data."""

    candidate: Candidate  # with the fitted drives
    residual: Mapping[str, float]  # rms on windows of the training data [rad or m], by joint
    scores: Mapping[str, Array] = field(default_factory=dict)  # (W,) [1] log rms of unused windows, by joint
    laws: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # probabilities, by joint

    def only(self, joints: Collection[str]) -> ServoTrial:
        """The same for some joints."""
        residual = {joint: x for joint, x in self.residual.items() if joint in joints}
        scores = {joint: x for joint, x in self.scores.items() if joint in joints}
        return replace(self, candidate=self.candidate.only(joints), residual=residual, scores=scores)

    def with_joints(self, other: ServoTrial) -> ServoTrial:
        """With some joints of another trial."""
        new = other.candidate
        rest = tuple(name for name in self.candidate.free if name[0] not in new.servos)
        candidate = replace(self.candidate, free=rest, window=max(self.candidate.window, new.window))
        candidate, scores = candidate.changed(new.servos, new.free), {**self.scores, **other.scores}
        return replace(self, candidate=candidate, residual={**self.residual, **other.residual}, scores=scores)


def fit_candidate(
    model: Model,
    grids: Sequence[ServoGrid],
    candidate: Candidate,
    window: float,
    steps: int = STEPS,
    *,
    relinearise: bool = False,
    rounds: int = ROUNDS,
    coarse: bool = False,
) -> tuple[Candidate, ServoFit]:
    """Fit a candidate; limits that are tied to gains follow them; `coarse`: without intervals."""
    candidate, rounds = candidate.united(), rounds if candidate.tied else 1
    for k in range(rounds):
        fit = fit_servos(
            model,
            grids,
            candidate.servos,
            candidate.free,
            window=candidate.window or window,
            relinearise=relinearise and k == rounds - 1,
            iterations=steps,
            scales=False,
            coarse=coarse,
            usual=candidate.usual,
            assumptions=candidate.assumptions,
        )
        candidate = candidate.follow(fit.servos)
    return candidate, fit


@dataclass(frozen=True)
class ServoOptions:
    """Options of a servo identification. Defaults come from the data."""

    rate: float | None = None  # [Hz] of the grids
    window: float = 0.0  # [s] of the windows of the fit; 0: 1 s for single joints, 0.8 s for coupled ones (linearised)
    additional: tuple[str, ...] = ADDITIONAL  # numbers that are tried one at a time
    seed: int = 0


@dataclass(frozen=True)
class ServoProblem:
    """Model, rows, knowledge and options of an identification, and what its steps have found so far."""

    described: Model  # with ideal drives, and the masses of the description
    model: Model  # the same with the masses that are used
    data: ServoData  # all rows
    searched: ServoData  # rows of the search
    sets: Sequence[Sequence[str]]  # driven joints that share moved bodies
    assumptions: Assumptions
    options: ServoOptions
    progress: Progress | None = None
    flags: tuple[str, ...] = ()
    full_duty: Mapping[str, float] = field(default_factory=dict)  # error [rad or m] by joint, from the recorded PWM
    regressed: Mapping[str, Servo] = field(default_factory=dict)  # drives by regression, by joint
    start: Candidate = Candidate({}, ())  # without limits, unless they are stated or tied to a gain
    limited: Mapping[str, Candidate] = field(default_factory=dict)  # by law: the start, with limits by regression
    command_timing: Mapping[str, float] = field(default_factory=dict)  # time [s] by which a delay may be longer
    unequal: Mapping[str, Estimates] = field(default_factory=dict)  # of equal joints: numbers without that assumption

    def saturating(self) -> list[str]:
        """Joints that seem to saturate or state a limit that no gain ties, with those that share their numbers."""
        servos = [item for start in self.limited.values() for item in start.servos.items()]
        names = dict.fromkeys(joint for joint, servo in servos if servo.effort_limit < np.inf)
        return self.assumptions.with_peers([joint for joint in names if joint not in self.start.tied])

    def fit(self, candidate: Candidate, steps: int = STEPS, coarse: bool = True) -> ServoTrial:
        """Fit to all training data; `coarse`: until a step gains little.

        Equal joints have the residual and the scores of all of them, so that they are judged together.
        """
        window, data = self.options.window, self.searched
        candidate, fit = fit_candidate(self.model, data.train, candidate, window, steps, coarse=coarse)
        squares = {joint: float(fit.residual_rms[data.joints.index(joint)]) ** 2 for joint in candidate.servos}
        peers = {joint: [j for j in candidate.assumptions.peers(joint) if j in squares] for joint in squares}
        return ServoTrial(
            candidate, {joint: float(np.sqrt(np.mean([squares[j] for j in equal]))) for joint, equal in peers.items()}
        )

    def lengthen(self, trial: ServoTrial) -> ServoTrial:
        """Fit again over longer windows, where whole recordings are fitted worse than windows.

        Short windows begin at measured states, which take up what repeats of an error would add to.
        """
        whole, grids, window = self._whole_rms(trial.candidate), self.searched.train, self.options.window
        if not any(whole[joint] > LONGER_WINDOW_RATIO * trial.residual[joint] for joint in whole):
            return trial
        best, seconds = trial, sum(len(grid) / grid.rate for grid in grids)
        for factor in WINDOW_FACTORS:
            if seconds / (factor * window) < MIN_WINDOWS and factor * window > max(len(g) / g.rate for g in grids):
                break
            new = self.fit(replace(best.candidate, window=factor * window), LONGER_STEPS)
            after = self._whole_rms(new.candidate)
            if np.mean([np.log(after[joint] / whole[joint]) for joint in whole]) > np.log(WHOLE_ERROR_RATIO):
                break
            best, whole = new, after
        return best

    def shorten(self, trial: ServoTrial) -> ServoTrial:
        """Fit again over short windows, whose cost is smooth, unless whole recordings are then fitted worse."""
        new = self.fit(replace(trial.candidate, window=0.0))
        before, after = (self._whole_rms(end.candidate) for end in (trial, new))
        return trial if np.mean([np.log(after[joint] / before[joint]) for joint in before]) > 0.0 else new

    def _whole_rms(self, candidate: Candidate) -> dict[str, float]:
        """Rms error by joint [rad or m] of whole recordings from commands alone."""
        grids = self.searched.train
        errors = [roll_out_along(recorded_course(self.model, g), candidate.servos, g) - g.q for g in grids]
        both = np.clip(np.nan_to_num(np.concatenate(errors), nan=DIVERGED), -DIVERGED, DIVERGED)
        rms = np.maximum(np.sqrt(np.mean(both**2, axis=0)), 1e-12)
        return {joint: float(rms[grids[0].joints.index(joint)]) for joint in candidate.servos}

    def score(self, trial: ServoTrial, joints: Collection[str]) -> ServoTrial:
        """Score some joints, with those that share bodies with them, on windows that took no part in refits."""
        if all(joint in trial.scores for joint in joints):
            return trial
        part, window = trial.only(joints), self.options.window
        scores: dict[str, list[Array]] = {joint: [] for joint in part.residual}
        for learned, unseen in self.searched.folds:
            candidate, _ = fit_candidate(self.model, learned, part.candidate, window, FOLD_STEPS, rounds=1, coarse=True)
            for grid in unseen:
                of_grid = roll_out_scores(self.model, candidate.servos, grid)
                for joint in scores:
                    scores[joint].append(of_grid[:, grid.joints.index(joint)])
        peers = {joint: [j for j in part.candidate.assumptions.peers(joint) if j in scores] for joint in scores}
        whole = {joint: [x for j in peers[joint] for x in scores[j]] for joint in scores if scores[joint]}
        return trial.with_joints(replace(part, scores={joint: np.concatenate(x) for joint, x in whole.items()}))

    def near(self, joints: Collection[str]) -> set[str]:
        """Joints that share moved bodies or numbers with some joints, and these."""
        sets = unions((*self.sets, *self.assumptions.equal))
        return {joint for members in sets if any(j in joints for j in members) for joint in members}

    def say(self, step: str, share: float) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(step, share)


def roll_out_scores(model: Model, servos: Mapping[str, Servo], grid: ServoGrid) -> Array:
    """Log rms (W, n) of the whole roll-out of a grid, linear about its motion, over windows of one second."""
    error = roll_out_along(recorded_course(model, grid), servos, grid) - grid.q
    error = np.nan_to_num(error, nan=DIVERGED, posinf=DIVERGED, neginf=DIVERGED)
    return window_scores(np.clip(error, -DIVERGED, DIVERGED), _seconds(grid))


def _seconds(grid: ServoGrid) -> list[slice]:
    """Rows of the windows of scores."""
    step = round(SCORE_WINDOW * grid.rate)
    return [slice(a, a + step) for a in range(0, max(len(grid) - step, 0) + 1, step)]


def worth(before: ServoTrial, after: ServoTrial, joints: Sequence[str], ratio: float = TRIAL_ERROR_RATIO) -> list[str]:
    """Joints whose training data a change fits notably better."""
    return [joint for joint in joints if after.residual[joint] < ratio * before.residual[joint]]


def improved(before: ServoTrial, after: ServoTrial, joints: Sequence[str]) -> list[str]:
    """Joints whose windows that took no part improve surely."""
    return [joint for joint in joints if improves(before.scores[joint], after.scores[joint])]


def supported(
    data: ServoData, before: ServoTrial, after: ServoTrial, joints: Sequence[str], tried: Collection[str]
) -> list[str]:
    """Joints that a number improves, without those where other windows contradict it: none of them gain by it.

    Those are the windows without any one of several recordings or, of one recording, the windows of all other joints
    that are alike by name and where the number was tried.
    """
    paths = np.array([grid.sha256 or grid.path for _, unseen in data.folds for grid in unseen for _ in _seconds(grid)])
    saved = {j: before.scores[j] - after.scores[j] if j in after.scores else np.zeros(1) for j in tried}
    kind = {joint: members for members in similar_joints(tuple(tried)) for joint in members}
    kept = []
    for joint in joints:
        names = np.resize(paths, len(saved[joint]))  # equal joints: once for each
        others = [saved[joint][names != path] for path in np.unique(names)]
        if len(others) == 1:
            mirrors = [np.nanmean(saved[j]) for j in kind.get(joint, ()) if j != joint]
            others = [np.array([np.mean(mirrors)])] if mirrors else []
        kept += [joint] if all(np.nanmean(rest) > MIN_LOG_GAIN for rest in others) else []
    return kept


def window_scores(error: Array, windows: Sequence[slice]) -> Array:
    """Log rms (W, n) of a simulation error (N, n) [rad or m] over windows of rows; NaN where a window has no rows."""
    rows = [np.sqrt(np.nanmean(error[window] ** 2, axis=0)) for window in windows if len(error[window])]
    return np.asarray(np.log(np.maximum(np.array(rows).reshape(-1, error.shape[1]), MIN_SCORED_RMS)))


def law_probabilities(scores: Mapping[str, Array], seed: int = 0) -> dict[str, float]:
    """Probability that each law has the smallest expected score.

    scores: (W,) [1] by law, log rms of the same windows, which took no part in the fit. Equal laws share the
    probability, but for `torque_speed`, which is `effort` with one number more; few windows never give certainty.
    """
    laws = list(scores)
    prior = np.array([LAW_PRIOR.get(law, 1.0) for law in laws])
    values = np.array([scores[law] for law in laws], float).reshape(len(laws), -1)
    values = values[:, np.isfinite(values).all(axis=0)]
    if values.shape[1] == 0:
        return {law: 1.0 / len(laws) for law in laws}
    weights = np.random.default_rng(seed).dirichlet(np.ones(values.shape[1]), BOOTSTRAP_DRAWS)
    top = np.exp(2 * (values - values.max()))
    # Heuristic, not derived: mean log rms is a score of typical windows, the log of rms over all is one of the few
    # windows where a limit acts; a law must do well in both, so they count alike.
    means = (weights @ values.T + 0.5 * np.log(weights @ top.T)) / 2  # (BOOTSTRAP_DRAWS, laws)
    best = prior * (means <= means.min(axis=1, keepdims=True) + SCORE_TOLERANCE)
    share = np.mean(best / best.sum(axis=1, keepdims=True), axis=0)
    count = values.shape[1]
    return {law: float((s * count + 1 / len(laws)) / (count + 1)) for law, s in zip(laws, share, strict=True)}


def improves(before: Array, after: Array) -> bool:
    """Whether a change saves error on windows that took no part.

    before: (W,) [1] log rms without the change; after: (W,) [1] with it.
    """
    saved = np.asarray(before - after, float).ravel()
    saved = saved[np.isfinite(saved)]
    if len(saved) < 2:
        return False
    error = saved.std(ddof=1) / np.sqrt(len(saved))
    loud = np.nanmean(np.exp(2 * after)) <= MAX_RMS_GROWTH**2 * np.nanmean(np.exp(2 * before))
    return bool(loud and saved.mean() > MIN_LOG_GAIN and saved.mean() > SAVING_ERRORS * error)
