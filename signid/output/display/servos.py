"""Tables of a servo identification, as polars frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from ...servos import SERVO_NUMBERS, SERVO_UNITS
from ..report.documents import picked

DRIVES = {"joint": pl.String, "law": pl.String, "parameter": pl.String}
NUMBERS = {"value": pl.Float64, "std": pl.Float64, "unit": pl.String, "stated": pl.Boolean}
LOOPS = "whole_rms one_second_rms nominal_whole_rms nominal_one_second_rms"


def drive_rows(result: Any) -> pl.DataFrame:
    """Numbers of the drives; null where not identifiable."""
    numbers = ((one.joint, one.law, number) for one in result.joints for number in one.numbers.values())
    rows = [(joint, law, x.name, x.value, x.std, x.unit, x.stated) for joint, law, x in numbers]
    return pl.DataFrame(rows, schema={**DRIVES, **NUMBERS}, orient="row", strict=False)


def stated_drives(model: Any) -> pl.DataFrame:
    """Numbers of the drives of a model, without infinite ones."""
    rows = [
        (joint, servo.law, name, float(getattr(servo, name)), SERVO_UNITS[name])
        for joint, servo in model.servos.items()
        for name in SERVO_NUMBERS
        if np.isfinite(getattr(servo, name))
    ]
    return pl.DataFrame(rows, schema={**DRIVES, "value": pl.Float64, "unit": pl.String}, orient="row")


def recorded_rows(result: Any) -> pl.DataFrame:
    """Recording of a simulation of drives, with a column per signal and joint."""
    return pl.DataFrame(dict(result.columns))


def loop_rows(result: Any) -> pl.DataFrame:
    """Rms position error of closed loops from commands alone, per joint."""
    found = result.rollout
    return pl.DataFrame({"joint": list(found.joints), "unit": list(found.units), **picked(found, LOOPS)})


def validated_loops(result: Any) -> pl.DataFrame:
    """Rms position error of closed loops of each model, per joint."""
    return pl.concat([loop_rows(one).insert_column(0, pl.lit(one.name).alias("model")) for one in result.models])


def traced_rows(result: Any) -> pl.DataFrame:
    """Positions of each held-out recording and joint: command, measured, simulated before and after."""
    parts = [
        pl.DataFrame(
            {
                "recording": [trace.path] * len(trace.t),
                "t": trace.t,
                "joint": [joint] * len(trace.t),
                **{key: values[:, j] for key, values in picked(trace, "command measured nominal simulated").items()},
            }
        )
        for trace in result.traces
        for j, joint in enumerate(trace.joints)
    ]
    return pl.concat(parts) if parts else pl.DataFrame()
