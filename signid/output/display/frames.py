"""Tables of results by name, as polars frames; numbers are in SI units, intervals are standard deviations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import polars as pl

from ...effects.naming import law_place
from ...errors import OptionError
from ...estimation.fit_quality import Fit
from ...servos import SERVO_NUMBERS, SERVO_UNITS
from ...types import INERTIAL, INERTIAL_UNITS, Array, Law, Recording, Robot
from ..report.documents import picked
from ..report.quantities import Quantity
from ..report.results.identification import identified_numbers
from ..report.results.inspection import joint_documents
from ..report.results.laws import finding_numbers, law_numbers
from ..report.results.payload import payload_numbers
from ..report.results.servo_identification import drive_numbers

Maker = Callable[[Any], pl.DataFrame]
KINDS: dict[str, type[pl.DataType]] = {"s": pl.String, "f": pl.Float64, "i": pl.Int64, "b": pl.Boolean}
LAWS = "law:s joint:s partner:s parameter:s value:f std:f unit:s"
FIT = "joint:s unit:s train_rms:f held_out_rms:f noise_floor:f irreducible_rms:f held_out_r2:f"
ROLLED = "simulation:s joint:s unit:s t:f rms:f"
SEGMENTS = "recording:i joint:s start:f end:f sign:i confidence:f"


def frame(result: Any, name: str | None = None) -> pl.DataFrame:
    """Return a table of a result by name; None: the first one.

    Raises:
        OptionError: the result has no such table, or none at all.
    """
    makers = FRAMES.get(type(result).__name__, {})
    if name is None and makers:
        name = next(iter(makers))
    if name not in makers:
        kind = type(result).__name__
        if not makers:
            raise OptionError(f"{kind} has no tables; its repr and its attributes show what it holds")
        raise OptionError(f"{kind} has no table {name!r}; choose from {', '.join(makers)}")
    return makers[name](result)


def frame_names(result: Any) -> tuple[str, ...]:
    """Names of the tables of a result."""
    return tuple(FRAMES.get(type(result).__name__, ()))


def table_of(columns: str, rows: Iterable[tuple[Any, ...]]) -> pl.DataFrame:
    """A frame with columns `name:kind`, kind s (text), f (number), i (integer) or b (truth value)."""
    schema = {name: KINDS[kind] for name, kind in (column.split(":") for column in columns.split())}
    plain = [tuple(x.item() if isinstance(x, np.generic) else x for x in row) for row in rows]
    return pl.DataFrame(plain, schema=schema, orient="row", strict=False)


def _base(result: Any) -> pl.DataFrame:
    columns = (result.base.expressions, result.base_value, result.estimate.std, result.estimate.value)
    rows = zip(*columns, result.base.units, strict=True)
    return table_of("expression:s value:f std:f estimate:f unit:s", rows)


def _mapped(base: Any) -> pl.DataFrame:
    return table_of("expression:s unit:s", zip(base.expressions, base.units, strict=True))


def _estimated(found: Any) -> pl.DataFrame:
    count = len(found.value)
    names, units = found.names or map(str, range(1, count + 1)), found.units or [None] * count
    return table_of("expression:s value:f std:f unit:s", zip(names, found.value, found.std, units, strict=True))


def _checked(result: Any) -> pl.DataFrame:
    rows = zip(result.base.expressions, result.std, result.base.units, result.verdicts, strict=True)
    return table_of("expression:s std:f unit:s verdict:s", rows)


def _identified_laws(result: Any) -> pl.DataFrame:
    return numbers_frame(LAWS, (n for numbers in identified_numbers(result) for n in numbers))


def _stated_laws(model: Any) -> pl.DataFrame:
    each = [(law, law_numbers(model.robot, law, {})) for law in model.laws_beside_drives]
    return numbers_frame(LAWS, _law_rows(model.robot, each))


def _found_laws(result: Any) -> pl.DataFrame:
    each = [(finding.law, finding_numbers(result.robot, finding)) for finding in result.findings]
    return numbers_frame(f"{LAWS} stated:f", _law_rows(result.robot, each))


def numbers_frame(columns: str, numbers: Iterable[Quantity]) -> pl.DataFrame:
    """A row per number, with columns `attribute:kind`."""
    names = [column.partition(":")[0] for column in columns.split()]
    return table_of(columns, (x.row(names) for x in numbers))


def _law_rows(robot: Robot, laws: Iterable[tuple[Law, list[Quantity]]]) -> Iterator[Quantity]:
    """Numbers of the laws; a law without parameters has one row."""
    for law, numbers in laws:
        yield from numbers or [Quantity("", np.nan, None, "", law_place(law, robot)[0], law.effect.name)]


def _bodies(result: Any) -> pl.DataFrame:
    bodies = result.parameters.bodies() if hasattr(result, "parameters") else result.inertials
    numbers = (zip(INERTIAL, x, INERTIAL_UNITS, strict=True) for x in bodies)
    rows = ((link, *row) for link, some in zip(result.robot.links, numbers, strict=True) for row in some)
    return table_of("link:s parameter:s value:f unit:s", rows)


def _fit_rows(fit: Fit) -> Iterable[tuple[Any, ...]]:
    sizes = picked(fit, "train_rms held_out_rms noise_floor irreducible_rms held_out_r2").values()
    return zip(fit.joints, fit.unit, *sizes, strict=True)


def _fit(fit: Fit) -> pl.DataFrame:
    return table_of(FIT, _fit_rows(fit))


def _compared(result: Any) -> pl.DataFrame:
    pairs = (("before", result.before), ("after", result.after))
    return table_of(f"simulation:s {FIT}", ((name, *row) for name, fit in pairs for row in _fit_rows(fit)))


def _segments(result: Any) -> pl.DataFrame:
    """Segments of recovered signs; no rows if every sign was recorded."""
    signs = getattr(result, "signs", result)
    if signs is None:
        return table_of(SEGMENTS, ())
    rows = ((s.part, signs.joints[s.joint], s.start, s.end, s.sign, s.confidence) for s in signs.segments)
    return table_of(SEGMENTS, rows)


def _findings(result: Any) -> pl.DataFrame:
    robot, rows = result.robot, list[tuple[Any, ...]]()
    for f in result.findings:
        place = (robot.joints[f.where.joint], f.where.variable, f.where.region)
        share = float(np.max(f.torque_share, initial=0.0))
        gain = (f.held_out_gain, len(f.alternatives), f.in_model)
        rows.append((f.law.effect.name, law_place(f.law, robot)[0], f.role, f.probability, share, *place, *gain))
    names = "law:s joint:s role:s probability:f torque_share:f where:s variable:s region:s"
    return table_of(f"{names} held_out_gain:f alternatives:i in_model:b", rows)


def _alternatives(result: Any) -> pl.DataFrame:
    robot, rows = result.robot, list[tuple[Any, ...]]()
    for f in result.findings:
        first = (f.law.effect.name, law_place(f.law, robot)[0])
        rows += [
            (*first, x.law.effect.name, law_place(x.law, robot)[0], x.probability, x.separating_motion)
            for x in f.alternatives
        ]
    return table_of("law:s joint:s alternative:s alternative_joint:s probability:f separating_motion:s", rows)


def _unexplained(result: Any) -> pl.DataFrame:
    rows = (
        (result.robot.joints[x.joint], x.place.variable, x.place.region, x.share, x.held_out_gain, x.modelled)
        for x in result.unexplained
    )
    return table_of("joint:s variable:s region:s share:f held_out_gain:f in_model:b", rows)


def _validated(result: Any) -> pl.DataFrame:
    rows = ((one.name, *row) for one in result.models for row in _fit_rows(one.fit))
    return (
        table_of(f"model:s {FIT}", rows)
        .drop("train_rms", "irreducible_rms")
        .rename({"held_out_rms": "rms", "held_out_r2": "r2"})
    )


def _listed(columns: str, keys: str, rows: Iterable[Mapping[str, Any]]) -> pl.DataFrame:
    """A row per entry of a document, with its values at some keys."""
    return table_of(columns, (tuple(row.get(key) for key in keys.split()) for row in rows))


def _drives(result: Any) -> pl.DataFrame:
    """Numbers of the drives; null where not identifiable."""
    numbers = (x for one in result.joints for x in drive_numbers(one))
    found = numbers_frame("joint:s law:s parameter:s value:f std:f unit:s stated:f", numbers)
    return found.with_columns(pl.col("stated").is_not_null())


def _stated_drives(model: Any) -> pl.DataFrame:
    """Numbers of the drives of a model, without infinite ones."""
    rows = (
        (joint, servo.law, name, float(getattr(servo, name)), SERVO_UNITS[name])
        for joint, servo in model.servos.items()
        for name in SERVO_NUMBERS
        if np.isfinite(getattr(servo, name))
    )
    return table_of("joint:s law:s parameter:s value:f unit:s", rows)


def _loops(result: Any) -> pl.DataFrame:
    """Rms position error of closed loops from commands alone, per joint."""
    found = result.rollout
    sizes = picked(found, "whole_rms one_second_rms nominal_whole_rms nominal_one_second_rms")
    return pl.DataFrame({"joint": list(found.joints), "unit": list(found.units), **sizes})


def _residuals(result: Any) -> pl.DataFrame:
    """Filtered rows of each joint on what was held out: torque, and residual before and after."""
    if hasattr(result, "held_out"):
        course = result.held_out
    else:
        from ..report.plots.courses import held_out_rows

        course = held_out_rows(result.session, result.judged)[0]
    first = {"recording": course.recording, "t": course.t}
    return _long(course.joints, first, picked(course, "q v torque before after"))


def _validated_residuals(result: Any) -> pl.DataFrame:
    """Filtered rows of each model and joint: torque and residual."""
    parts = []
    for one in result.models:
        first = {"model": [one.name] * len(one.t), "recording": one.recording, "t": one.t}
        parts.append(_long(one.fit.joints, first, picked(one, "torque residual")))
    return pl.concat(parts)


def _traced(result: Any) -> pl.DataFrame:
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


def _rolled(runs: Mapping[str, Any]) -> pl.DataFrame:
    """Rms error of roll-outs over the time since their start, by name; no rows without a roll-out."""
    rows = [
        (name, joint, unit, t, x)
        for name, run in runs.items()
        if run is not None
        for joint, unit, rms in zip(run.joints, run.unit, np.sqrt(np.mean(run.error**2, axis=0)).T, strict=True)
        for t, x in zip(run.t, rms, strict=True)
    ]
    return table_of(ROLLED, rows)


def _samples(recording: Recording) -> pl.DataFrame:
    """All samples of a recording, with a column per signal and joint."""
    signals = recording.read()._asdict()
    signals.pop("origin", None)
    return _wide(signals.pop("t"), recording.joints, signals)


def _simulated(simulation: Any) -> pl.DataFrame:
    """Recorded signals of a simulation, with a column per signal and joint."""
    signals = {"q": simulation.q, "tau": simulation.tau, "q_des": simulation.desired}
    return _wide(simulation.t, simulation.joints, signals)


def _motion(found: Any) -> pl.DataFrame:
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


FRAMES: dict[str, dict[str, Maker]] = {
    "BaseMap": {"base_parameters": _mapped},
    "Check": {"base_parameters": _checked, "segments": _segments},
    "Diagnosis": {
        "findings": _findings,
        "laws": _found_laws,
        "alternatives": _alternatives,
        "unexplained": _unexplained,
        "fit": _compared,
        "rollouts": lambda result: _rolled({"before": result.rollout_before, "after": result.rollout_after}),
        "residuals": _residuals,
        "segments": _segments,
    },
    "Estimate": {"base_parameters": _estimated},
    "Excitation": {
        "motion": _motion,
        "base_parameters": lambda found: table_of(
            "expression:s std:f relative_std:f", zip(found.expressions, found.std, found.relative_std, strict=True)
        ),
    },
    "Fit": {"fit": _fit},
    "Fleet": {
        "robots": lambda fleet: _listed(
            "robot:s verdict:s joint:s mismatch:f after:f explained:f",
            "name verdict joint mismatch left explained",
            fleet.document()["robots"],
        ),
        "sessions": lambda fleet: _listed(
            "session:s name:s robot:s task:s state:s", "session name robot task state", fleet.document()["sessions"]
        ),
    },
    "Identification": {
        "base_parameters": _base,
        "laws": _identified_laws,
        "standard_parameters": _bodies,
        "fit": lambda result: _fit(result.fit),
        "residuals": _residuals,
        "segments": _segments,
    },
    "Inspection": {
        "base_parameters": lambda result: _mapped(result.base),
        "joints": lambda result: pl.DataFrame(joint_documents(result.robot)),
    },
    "Model": {"laws": _stated_laws, "standard_parameters": _bodies, "drives": _stated_drives},
    "Payload": {"payload": lambda found: numbers_frame("parameter:s value:f std:f unit:s", payload_numbers(found))},
    "Recording": {"samples": _samples},
    "Robot": {"joints": lambda robot: pl.DataFrame(joint_documents(robot))},
    "RollOut": {"rollouts": lambda result: _rolled({"simulation": result})},
    "Separation": {"motion": _motion},
    "ServoIdentification": {"drives": _drives, "closed_loops": _loops, "positions": _traced},
    "ServoSimulation": {"samples": lambda run: pl.DataFrame(dict(run.columns))},
    "ServoValidatedModel": {"closed_loops": _loops, "positions": _traced},
    "ServoValidation": {
        "closed_loops": lambda result: pl.concat(
            _loops(one).insert_column(0, pl.lit(one.name).alias("model")) for one in result.models
        )
    },
    "Signs": {"segments": _segments},
    "Simulation": {"samples": _simulated},
    "ValidatedModel": {"fit": lambda one: _fit(one.fit)},
    "Validation": {
        "fit": _validated,
        "rollouts": lambda result: _rolled({one.name: one.rollout for one in result.models}),
        "residuals": _validated_residuals,
    },
}
