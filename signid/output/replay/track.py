"""What moves: the recorded robot, the simulated ones, and the torque that each simulation leaves unexplained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...model import Model
from ...recording.sampling import Sampling, samples, survey
from ...regression.bandwidth import Band, choose_band
from ...regression.filters import lowpass
from ...regression.motion import build_motion, margin
from ...regression.session import longest_piece
from ...simulation.rollout import roll_out
from ...types import Array, Frozen, Indices, Mask, Recording

STEP = 2e-3  # [s] of the simulation, at most
SHOWN = 0.4  # times the rate of the frames: what is faster is not shown
STANDSTILL = 3.0  # times the noise of a velocity, within which the direction of motion is not certain


@dataclass(frozen=True, eq=False)
class Track(Frozen):
    """F frames of n joints, recorded and by one or two simulations (M of them: as given, and with what it lacked)."""

    t: Array  # (F,) [s] as in the recording
    recorded: Array  # (F, n) [rad or m]
    simulated: Array  # (M, F, n) [rad or m]; NaN where nothing is simulated
    apart: Mask  # (M, F) whether joints fly off so fast that they are no longer followed
    window: Indices  # (F,) of the roll-out that a frame lies in, -1 for none
    residual: Array  # (M, F, n) measured minus predicted torque [N.m or N]; NaN where no torque is recorded
    torque: Array  # (n,) root mean square of the measured torque [N.m or N]


class _Read(NamedTuple):
    recording: Recording
    sampling: Sampling
    band: Band


class _Strayed(NamedTuple):
    """A model over windows: simulated minus recorded position (F, n) [rad or m], and where it flies off (F,)."""

    error: Array
    apart: Mask
    window: Indices  # (F,)


def follow(models: Sequence[Model], recording: Recording, window: float, rate: float) -> Track:
    """The motion of a recording and of roll-outs of one or two models over it, at so many frames a second.

    Windows follow one another all along the recording; in each the simulated robots start from the measured state.

    Args:
        models: over the joints of the recording.
        recording: with signed torque.
        window: length of a roll-out [s].
        rate: [Hz].

    Raises:
        RecordingError: the recording cannot be used, or is shorter than a window.
    """
    sampling = survey(recording, models[0].robot)
    read = _Read(recording, sampling, choose_band([longest_piece((recording, sampling))], 1 / sampling.period))
    known = [samples(recording, sampling, span, 0, sampling.length(span)) for span in sampling.spans]
    times, q = np.concatenate([x.t for x in known]), np.concatenate([x.q for x in known])
    t = times[0] + np.arange(int((times[-1] - times[0]) * rate * (1 + 1e-9)) + 1) / rate
    recorded = _at(t, times, q)
    strayed = [_strayed(read, models[k], models[k - 1], window, t) for k in range(len(models))]
    torque = np.concatenate([x.tau for x in known])
    told = np.array([bool(column) for column in recording.columns["tau"]])
    return Track(
        t=t,
        recorded=recorded,
        simulated=np.stack([recorded + x.error for x in strayed]),
        apart=np.stack([x.apart for x in strayed]),
        window=strayed[0].window,
        residual=np.stack([_residual(read, model, t, rate) for model in models]),
        torque=np.where(told, np.sqrt(np.mean(np.where(told, torque, 0.0) ** 2, axis=0)), np.nan),
    )


def _strayed(read: _Read, model: Model, other: Model, window: float, t: Array) -> _Strayed:
    """Roll-outs one after another; a joint that flies off stays where it was last, as long as another does not."""
    count = int(np.ceil(read.sampling.duration / window))  # so many that none begins after another has ended
    found = roll_out(model, read.recording, (window,), windows=count, band=read.band, step=STEP, beside=other)
    which = np.searchsorted(found.start, t, side="right") - 1
    age = t - found.start[which]
    which = np.where((which >= 0) & (age <= found.t[-1] + read.sampling.period), which, -1)
    told = np.array([bool(column) for column in read.recording.columns["tau"]])
    error, apart = np.full((len(t), len(told)), np.nan), np.zeros(len(t), dtype=bool)
    ages = np.concatenate([[0.0], found.t])
    for w in np.unique(which[which >= 0]):
        frames = which == w
        path = np.concatenate([np.zeros((1, len(told))), np.where(told, found.error[w], 0.0)])
        lost = ~np.isfinite(path)
        last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(path))[:, None]), axis=0)
        held = np.take_along_axis(path, last, axis=0)
        held[lost[:, told].all(axis=1)] = np.nan
        error[frames] = _at(age[frames], ages, held)
        apart[frames] = np.interp(age[frames], ages, lost.any(axis=1)) > 0
    return _Strayed(error, apart, which)


def _residual(read: _Read, model: Model, t: Array, rate: float) -> Array:
    """Measured minus predicted torque (F, n) [N.m or N], of what is slow enough to be seen."""
    recording, sampling, band = read
    taps = lowpass(1 / sampling.period, min(band.cutoff, SHOWN * rate))
    slow = np.maximum(STANDSTILL * band.velocity_noise, 1e-12)
    out = np.full((len(t), len(model.robot.joints)), np.nan)
    for span in sampling.spans:
        if sampling.length(span) <= 2 * margin(band) + 1:
            continue
        piece = samples(recording, sampling, span, 0, sampling.length(span))
        motion = build_motion(model.robot, piece, band, sampling.period, slow=slow)
        assert motion.recorded is not None, "a recording has torque"
        left = _smooth(motion.recorded - model.inverse(motion), taps)
        inside = (t >= motion.t[0]) & (t <= motion.t[-1])
        out[inside] = _at(t[inside], motion.t, left)
    return out


def _smooth(signal: Array, taps: Array) -> Array:
    """Filtered (N, n) [as given], mirrored at the ends."""
    from scipy.ndimage import convolve1d

    return np.asarray(convolve1d(signal, taps, axis=0, mode="mirror")) if len(taps) > 1 else signal


def _at(t: Array, known: Array, values: Array) -> Array:
    """Values (N, n) [any] known at times (N,) [s], straight in between, at others (F,) [s]."""
    return np.column_stack([np.interp(t, known, x) for x in values.T])
