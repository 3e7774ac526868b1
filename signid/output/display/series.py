"""Rows over time of results, as polars frames: residuals, roll-outs, samples and motions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import polars as pl

from ...estimation.fit_quality import Course
from ...types import Array, Recording
from ..report.documents import picked

ROLLED = {"simulation": pl.String, "joint": pl.String, "unit": pl.String, "t": pl.Float64, "rms": pl.Float64}


def held_out_course(result: Any) -> Course:
    """Residuals over time of an identification or a diagnosis, on what was held out."""
    if hasattr(result, "held_out"):
        course: Course = result.held_out
        return course
    from ..report.plots.courses import held_out_rows

    return held_out_rows(result.session, result.judged)[0]


def held_out_residuals(result: Any) -> pl.DataFrame:
    """Filtered rows of each joint on what was held out: torque, and residual before and after."""
    return residual_rows(held_out_course(result))


def residual_rows(course: Course) -> pl.DataFrame:
    """Filtered rows of each joint: torque, and residual before and after."""
    first = {"recording": course.recording, "t": course.t}
    return _long(course.joints, first, picked(course, "q v torque before after"))


def validated_residuals(result: Any) -> pl.DataFrame:
    """Filtered rows of each model and joint: torque and residual."""
    parts = []
    for one in result.models:
        first = {"model": [one.name] * len(one.t), "recording": one.recording, "t": one.t}
        parts.append(_long(one.fit.joints, first, picked(one, "torque residual")))
    return pl.concat(parts)


def traced_rows(result: Any) -> pl.DataFrame:
    """Positions of each held-out recording and joint: command, measured, simulated before and after."""
    parts = []
    for trace in result.traces:
        first = {"recording": [trace.path] * len(trace.t), "t": trace.t}
        parts.append(_long(trace.joints, first, picked(trace, "command measured nominal simulated")))
    return pl.concat(parts) if parts else pl.DataFrame()


def _long(joints: Iterable[str], first: Mapping[str, Any], values: Mapping[str, Array]) -> pl.DataFrame:
    """A row per time and joint; first: (N,) each, values: (N, n) each [any unit]."""
    rows = len(first["t"])
    return pl.concat(
        pl.DataFrame({**first, "joint": [joint] * rows, **{key: x[:, j] for key, x in values.items()}})
        for j, joint in enumerate(joints)
    )


def rolled_rows(runs: Iterable[tuple[str, Any]]) -> pl.DataFrame:
    """Rms error of roll-outs over the time since their start; no rows without a roll-out."""
    rows = []
    for name, run in runs:
        if run is not None:
            rms = np.sqrt(np.mean(run.error**2, axis=0))
            rows += [
                (name, joint, unit, t, x)
                for j, (joint, unit) in enumerate(zip(run.joints, run.unit, strict=True))
                for t, x in zip(run.t.tolist(), rms[:, j].tolist(), strict=True)
            ]
    return pl.DataFrame(rows, schema=ROLLED, orient="row")


def sample_rows(recording: Recording) -> pl.DataFrame:
    """All samples of a recording, with a column per signal and joint."""
    signals = recording.read()._asdict()
    signals.pop("origin", None)
    return _wide(signals.pop("t"), recording.joints, signals)


def simulated_rows(simulation: Any) -> pl.DataFrame:
    """Recorded signals of a simulation, with a column per signal and joint."""
    signals = {"q": simulation.q, "tau": simulation.tau, "q_des": simulation.desired}
    return _wide(simulation.t, simulation.joints, signals)


def motion_rows(found: Any) -> pl.DataFrame:
    """Position, velocity and acceleration of a designed motion, with a column per joint."""
    motion = found.trajectory
    return _wide(motion.t, motion.joints, {"q": motion.q, "dq": motion.v, "ddq": motion.a})


def _wide(t: Array, joints: Iterable[str], signals: Mapping[str, Array | None]) -> pl.DataFrame:
    """A row per time, and a column per signal and joint; t: (N,) [s], signals: (N, n) each, or None [any unit]."""
    columns = {
        f"{key}_{joint}": values[:, j]
        for key, values in signals.items()
        if values is not None
        for j, joint in enumerate(joints)
    }
    return pl.DataFrame({"t": t, **columns})
