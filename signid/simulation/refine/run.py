"""Model and recordings -> the model whose roll-outs follow them better, or the given one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import InputError, OptionError
from ...model import Model, ModelSource, as_model, torque_model
from ...recording import Recordings, as_recordings, need_torque
from ...recording.sampling import survey
from ...regression.bandwidth import Band, choose_band
from ...regression.session import Part, common_rate, longest_piece
from ...types import Array, Frozen, Result
from ..rollout.whole import check_whole, whole_windows
from ..rollout.windows import Windows, cut_windows, restrict_joints
from .fit import LawTrial, choose, cross_validate, fit_windows, window_rms

ONE, SEVERAL = (2.5, 5.0), (0.5,)  # [s] lengths of windows for one joint, where errors hardly grow, and for several
STEP = 1e-3  # [s] largest step of a simulation
MOST_WINDOWS = 200  # windows of a recording at most
MEANINGFUL = 0.2  # [1] rms error of a roll-out over the motion's standard deviation, up to which whole runs are fitted


@dataclass(frozen=True, eq=False)
class Refinement(Result):
    """The model to use, and what windows that took no part in the fit say about it and about the given one."""

    model: Model  # the refined one if `kept`, else the given one
    kept: bool
    lengths: tuple[float, ...]  # [s] of the windows
    whole: bool  # whether whole recordings were fitted, too
    unit: tuple[str, ...]  # rad or m, one per joint
    before: Array  # (n,) [rad or m] median over windows of the rms position error of the given model
    after: Array  # (n,) [rad or m] the same of the refined one
    trials: tuple[LawTrial, ...]  # sets of laws that were tried, the chosen one last; empty without a choice
    notes: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """Sentence on the errors before and after, and on which numbers are kept."""
        errors = ", ".join(
            f"{b:.3g} to {a:.3g} {u}" for b, a, u in zip(self.before, self.after, self.unit, strict=True)
        )
        span = " and ".join(f"{length:g}" for length in self.lengths)
        if self.kept:
            return f"refined by roll-outs of {span} s: median error of windows that were not fitted {errors}"
        return (
            f"roll-outs of {span} s did not improve the model (median error of windows that were not fitted "
            f"{errors}), so its numbers are kept"
        )


@dataclass(frozen=True, eq=False)
class _Data(Frozen):
    """Windows to learn from and to judge by; the latter are the former where nothing is held out."""

    train: tuple[Windows, ...]
    held_out: tuple[Windows, ...]
    scale: Array  # (n,) [rad or m]


def refine(
    model: ModelSource,
    recordings: Recordings,
    held_out: Recordings = (),
    *,
    candidates: Sequence[str] = (),
    lengths: Sequence[float] = (),
) -> Refinement:
    """Refine the numbers of a model's laws, so that open-loop roll-outs under recorded torque follow the positions.

    Numbers are fitted by least squares to windows that start at measured states, then to whole recordings as well where
    whole roll-outs stay near the motion. The given model is kept unless the refined one is better at windows that took
    no part in the fit: those of `held_out`, else in cross-validation. Bodies stay as they are, except the mass of a
    single prismatic joint.

    Args:
        model: identified model.
        recordings: with signed torque.
        held_out: recordings to judge by.
        candidates: names of laws to choose from, for robots with one joint.
        lengths: lengths of the windows [s]; default: 2.5 and 5 for one joint, 0.5 for several.

    Raises:
        OptionError: unknown candidates, or no law to refine.
        RecordingError: a recording cannot be used, or is shorter than the windows.
    """
    model = torque_model(as_model(model, "refine"))
    learned, judged = (as_recordings(x, model.robot, "refine") for x in (recordings, held_out))
    need_torque([*learned, *judged])
    model, _ = restrict_joints(model, [*learned, *judged])
    parts = [[(r, survey(r, model.robot)) for r in each] for each in (learned, judged)]
    everything = [*parts[0], *parts[1]]
    rate = common_rate(everything, "refine with each by itself")
    band = choose_band([longest_piece(part) for part in everything], rate)
    return refine_parts(model, parts[0], parts[1], band, candidates=candidates, lengths=lengths)


def refine_parts(
    model: Model,
    train: Sequence[Part],
    held_out: Sequence[Part],
    band: Band,
    *,
    candidates: Sequence[str] = (),
    lengths: Sequence[float] = (),
) -> Refinement:
    """The same for surveyed recordings of the model's joints, with the band of the filter on positions.

    Raises:
        OptionError: unknown candidates, no law to refine, or a length that is not positive.
        RecordingError: a recording is shorter than the windows.
    """
    lengths = tuple(lengths) or (ONE if len(model.robot.joints) == 1 else SEVERAL)
    if wrong := [length for length in lengths if not (np.isfinite(length) and length > 0)]:
        raise OptionError(f"windows of {wrong[0]:g} s cannot be simulated; give a length above 0 s")
    data = _cut(model, train, held_out, band, lengths)
    trials = choose(model, data.train, data.scale, candidates) if candidates else []
    fitted = trials[-1].model if trials else fit_windows(model, data.train, data.scale)
    ended, whole = _whole(fitted, train, data.train)
    before = window_rms(model, data.held_out)
    if held_out:
        after = window_rms(ended, data.held_out)
    else:
        after = (trials[-1] if trials else cross_validate(model, data.train, data.scale)).errors
    first, last = (np.asarray(np.median(errors, axis=0)) for errors in (before, after))
    kept = bool((last <= first).all() and (last < first).any())  # no joint is predicted worse, and one better
    unit = tuple("m" if prismatic else "rad" for prismatic in model.robot.prismatic)
    return Refinement(ended if kept else model, kept, lengths, whole and kept, unit, first, last, tuple(trials))


def _cut(model: Model, train: Sequence[Part], held_out: Sequence[Part], band: Band, lengths: Sequence[float]) -> _Data:
    """Windows that overlap by half, torque held from each sample to the next."""

    def cut(part: Part, length: float) -> Windows:
        count = int(np.clip(2 * part[1].duration / length, 1, MOST_WINDOWS))
        return cut_windows(model, part, band, length, count, STEP, held=True)

    learned, judged = (tuple(cut(part, length) for part in parts for length in lengths) for parts in (train, held_out))
    errors = np.median(window_rms(model, learned), axis=0)
    motion = _motion(learned)
    return _Data(learned, judged or learned, np.where(errors > 0, np.minimum(errors, motion), motion))


def _motion(windows: Sequence[Windows]) -> Array:
    """Standard deviation (n,) [rad or m] of the recorded positions; 1 for a joint at rest."""
    q = np.concatenate([w.q.reshape(-1, w.q.shape[2]) for w in windows])
    return np.where(q.std(axis=0) > 0, q.std(axis=0), 1.0)


def _whole(model: Model, train: Sequence[Part], windows: Sequence[Windows]) -> tuple[Model, bool]:
    """The model fitted to windows and whole recordings together, if roll-outs stay near the motion; whether it was.

    Both count by their own error, so that the drift of one run does not spoil the windows. Measured on EMPS, two thirds
    of the training file fitted and the other simulated: 2.5 mm, 3.6 mm with the whole runs alone, 2.4 mm with windows
    alone (geometric means).
    """
    try:
        check_whole(model, [recording for recording, _ in train])
    except InputError:
        return model, False
    runs = [one for part in train for one in whole_windows(model, part)]
    if not runs or not (window_rms(model, runs) < MEANINGFUL * _motion(runs)).all():
        return model, False
    together = [*windows, *runs]
    errors = np.array([np.sqrt(np.mean(window_rms(model, [one]) ** 2, axis=0)) for one in together])
    size = np.array([one.q.shape[0] * one.q.shape[1] for one in together])
    scale = np.where(errors > 0, errors, 1.0) * np.sqrt(size / size.sum())[:, None]
    return fit_windows(model, together, scale), True
