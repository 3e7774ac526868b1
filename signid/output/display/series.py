"""Rows over time of results, as polars frames: residuals, roll-outs, samples and motions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import polars as pl

from ...errors import OptionError
from ...estimation.fit_quality import Course
from ...types import Array, Recording
from ..report.documents import picked

ROLLED = {"simulation": pl.String, "joint": pl.String, "unit": pl.String, "t": pl.Float64, "rms": pl.Float64}


def held_out_course(result: Any) -> Course:
    """Residuals over time of an identification or a diagnosis, on what was held out.

    Raises:
        OptionError: the identification was made from factors, which hold no samples.
    """
    if hasattr(result, "held_out"):
        course: Course = result.held_out
        return course
    if not result.session.held_out:
        raise OptionError("an identification from factors has no samples to show; identify the recordings instead")
    from ..report.plots.courses import held_out_rows

    return held_out_rows(result.session, result.judged)[0]


def held_out_residuals(result: Any) -> pl.DataFrame:
    """Filtered rows of each joint on what was held out: torque, and residual before and after."""
    return residual_rows(held_out_course(result))


def residual_rows(course: Course) -> pl.DataFrame:
    """Filtered rows of each joint: torque, and residual before and after."""
    parts = [
        pl.DataFrame(
            {
                "recording": course.recording,
                "t": course.t,
                "joint": [joint] * len(course),
                **{key: values[:, j] for key, values in picked(course, "q v torque before after").items()},
            }
        )
        for j, joint in enumerate(course.joints)
    ]
    return pl.concat(parts)


def validated_residuals(result: Any) -> pl.DataFrame:
    """Filtered rows of each model and joint: torque and residual."""
    parts = [
        pl.DataFrame(
            {
                "model": [one.name] * len(one.t),
                "recording": one.recording,
                "t": one.t,
                "joint": [joint] * len(one.t),
                "torque": one.torque[:, j],
                "residual": one.residual[:, j],
            }
        )
        for one in result.models
        for j, joint in enumerate(one.fit.joints)
    ]
    return pl.concat(parts)


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
    samples = recording.read()
    columns: dict[str, Array] = {"t": samples.t}
    for key, values in samples._asdict().items():
        if key not in ("t", "origin") and values is not None:
            columns |= {f"{key}_{joint}": values[:, j] for j, joint in enumerate(recording.joints)}
    return pl.DataFrame(columns)


def simulated_rows(simulation: Any) -> pl.DataFrame:
    """Recorded signals of a simulation, with a column per signal and joint."""
    columns = {"t": simulation.t}
    for key, values in (("q", simulation.q), ("tau", simulation.tau), ("q_des", simulation.desired)):
        columns |= {f"{key}_{joint}": values[:, j] for j, joint in enumerate(simulation.joints)}
    return pl.DataFrame(columns)


def motion_rows(found: Any) -> pl.DataFrame:
    """Position, velocity and acceleration of a designed motion, with a column per joint."""
    motion = found.trajectory
    columns = {"t": motion.t}
    for key, values in (("q", motion.q), ("dq", motion.v), ("ddq", motion.a)):
        columns |= {f"{key}_{joint}": values[:, j] for j, joint in enumerate(motion.joints)}
    return pl.DataFrame(columns)
