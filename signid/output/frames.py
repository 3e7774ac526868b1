"""Tables of results by name, as polars frames; numbers are in SI units, intervals are standard deviations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np
import polars as pl

from ..effects.naming import law_place
from ..errors import OptionError
from ..servos import SERVO_NUMBERS, SERVO_UNITS
from ..types import INERTIAL, INERTIAL_UNITS, Array, Law, Recording, Robot
from .report.documents import picked
from .report.quantities import Quantity, finding_numbers, law_numbers
from .report.results.identification import identified_numbers, joint_documents, payload_numbers, whole_numbers
from .report.results.servo_identification import drive_numbers

Rows: TypeAlias = Iterable[tuple[Any, ...]]
Table: TypeAlias = Callable[[Any], pl.DataFrame] | tuple[str, Callable[[Any], Rows]]  # or columns and rows
COLUMN_TYPES: dict[str, type[pl.DataType]] = {"s": pl.String, "f": pl.Float64, "i": pl.Int64, "b": pl.Boolean}
LAW_ROWS = "law:s joint:s partner:s parameter:s value:f std:f unit:s"
FIT = "joint:s unit:s train_rms:f held_out_rms:f noise_floor:f irreducible_rms:f held_out_r2:f"


def frame(result: Any, name: str | None = None) -> pl.DataFrame:
    """Return a table of a result by name; None: the first one.

    Raises:
        OptionError: the result has no such table, or none at all.
    """
    kind, makers = type(result).__name__, FRAMES.get(type(result).__name__, {})
    if not makers:
        raise OptionError(f"{kind} has no tables; its repr and its attributes show what it holds")
    if name is not None and name not in makers:
        raise OptionError(f"{kind} has no table {name!r}; choose from {', '.join(makers)}")
    maker = makers[next(iter(makers)) if name is None else name]
    return maker(result) if callable(maker) else table_of(maker[0], maker[1](result))


def frame_names(result: Any) -> tuple[str, ...]:
    """Names of the tables of a result."""
    return tuple(FRAMES.get(type(result).__name__, ()))


def table_of(columns: str, rows: Rows) -> pl.DataFrame:
    """A frame with columns `name:kind`, kind s (text), f (number), i (integer) or b (truth value)."""
    schema = {name: COLUMN_TYPES[kind] for name, kind in (column.split(":") for column in columns.split())}
    plain = [tuple(x.item() if isinstance(x, np.generic) else x for x in row) for row in rows]
    return pl.DataFrame(plain, schema=schema, orient="row", strict=False)


def _side_by_side(names: str) -> Callable[[Any], Rows]:
    """Rows of attributes (N,) each of a result."""
    return lambda result: zip(*attrgetter(*names.split())(result), strict=True)


def _estimated(found: Any) -> Rows:
    count = len(found.value)
    names, units = found.names or map(str, range(1, count + 1)), found.units or [None] * count
    return zip(names, found.value, found.std, units, strict=True)


def numbers_frame(columns: str, numbers: Iterable[Quantity]) -> pl.DataFrame:
    """A row per number, with columns `attribute:kind`."""
    names = [column.partition(":")[0] for column in columns.split()]
    return table_of(columns, (x.row(names) for x in numbers))


def _law_rows(robot: Robot, laws: Iterable[tuple[Law, list[Quantity]]]) -> Iterator[Quantity]:
    """Numbers of the laws; a law without parameters has one row."""
    for law, numbers in laws:
        yield from numbers or [Quantity("", np.nan, None, "", law_place(law, robot)[0], law.effect.name)]


def _bodies(result: Any) -> Rows:
    bodies = result.parameters.bodies() if hasattr(result, "parameters") else result.inertials
    for link, x in zip(result.robot.links, bodies, strict=True):
        yield from ((link, *row) for row in zip(INERTIAL, x, INERTIAL_UNITS, strict=True))


def _segments(result: Any) -> Rows:
    """Segments of recovered signs; no rows if every sign was recorded."""
    signs = getattr(result, "signs", result)
    for s in () if signs is None else signs.segments:
        yield s.part, signs.joints[s.joint], s.start, s.end, s.sign, s.confidence


def _findings(result: Any) -> Rows:
    for f in result.findings:
        place = (result.robot.joints[f.where.joint], f.where.variable, f.where.region)
        first = (f.law.effect.name, law_place(f.law, result.robot)[0], f.role, f.probability)
        size = float(np.max(f.torque_share, initial=0.0))
        yield *first, size, *place, f.held_out_gain, len(f.alternatives), f.in_model


def _loops(result: Any) -> pl.DataFrame:
    """Rms position error of closed loops from commands alone, per joint."""
    rollout = result.rollout
    sizes = picked(rollout, "whole_rms one_second_rms nominal_whole_rms nominal_one_second_rms")
    return pl.DataFrame({"joint": list(rollout.joints), "unit": list(rollout.units), **sizes})


def _residuals(result: Any) -> pl.DataFrame:
    """Filtered rows of each joint on what was held out: torque, and residual before and after."""
    if hasattr(result, "held_out"):
        course = result.held_out
    else:
        from .report.plots import held_out_rows

        course = held_out_rows(result.session, result.judged)[0]
    return _long([(course.joints, picked(course, "recording t"), picked(course, "q v torque before after"))])


def _long(parts: Iterable[tuple[Iterable[str], Mapping[str, Any], Mapping[str, Array]]]) -> pl.DataFrame:
    """A row per time and joint; of each part the joints, columns (N,) and values (N, n) [any unit]."""
    frames = [
        pl.DataFrame({**first, "joint": [joint] * len(first["t"]), **{key: x[:, j] for key, x in values.items()}})
        for joints, first, values in parts
        for j, joint in enumerate(joints)
    ]
    return pl.concat(frames) if frames else pl.DataFrame()


def _positions(result: Any) -> pl.DataFrame:
    """Positions of each held-out recording and joint: command, measured, simulated before and after."""
    keys = "command measured nominal simulated"
    return _long((x.joints, {"recording": [x.path] * len(x.t), "t": x.t}, picked(x, keys)) for x in result.traces)


def _rolled(runs: Mapping[str, Any]) -> Rows:
    """Rms error of roll-outs over the time since their start, by name; no rows without a roll-out."""
    for name, run in runs.items():
        if run is not None:
            sizes = np.sqrt(np.mean(run.error**2, axis=0)).T
            for joint, unit, errors in zip(run.joints, run.unit, sizes, strict=True):
                yield from ((name, joint, unit, t, x) for t, x in zip(run.t, errors, strict=True))


def _listed(entries: str, keys: str) -> Callable[[Any], Rows]:
    """A row per entry of a list of the document, with its values at some keys."""
    return lambda result: (tuple(map(entry.get, keys.split())) for entry in result.document()[entries])


def _wide(t: Array, joints: Iterable[str], signals: Mapping[str, Array | None]) -> pl.DataFrame:
    """A row per time, and a column per signal and joint; t: (N,) [s], signals: (N, n) each, or None [any unit]."""
    known = {key: values for key, values in signals.items() if values is not None}
    columns = {f"{key}_{joint}": x[:, j] for key, x in known.items() for j, joint in enumerate(joints)}
    return pl.DataFrame({"t": t, **columns})


def _samples(recording: Recording) -> pl.DataFrame:
    """All samples of a recording."""
    signals = recording.read()._asdict()
    signals.pop("origin", None)
    return _wide(signals.pop("t"), recording.joints, signals)


def _motion(found: Any) -> pl.DataFrame:
    """Position, velocity and acceleration of a designed motion."""
    motion = found.trajectory
    return _wide(motion.t, motion.joints, {"q": motion.q, "dq": motion.v, "ddq": motion.a})


ROLLOUT = "simulation:s joint:s unit:s t:f rms:f"
_held_out = _side_by_side("joints unit held_out_rms noise_floor held_out_r2")
_fit = _side_by_side("joints unit train_rms held_out_rms noise_floor irreducible_rms held_out_r2")
BODY_TABLE: Table = ("link:s parameter:s value:f unit:s", _bodies)
SEGMENT_TABLE: Table = ("recording:i joint:s start:f end:f sign:i confidence:f", _segments)
FRAMES: dict[str, dict[str, Table]] = {
    "BaseMap": {"base_parameters": ("expression:s unit:s", _side_by_side("expressions units"))},
    "Check": {
        "base_parameters": (
            "expression:s std:f unit:s verdict:s",
            _side_by_side("base.expressions std base.units verdicts"),
        ),
        "segments": SEGMENT_TABLE,
    },
    "Diagnosis": {
        "findings": (
            "law:s joint:s role:s probability:f torque_share:f where:s variable:s region:s held_out_gain:f "
            "alternatives:i in_model:b",
            _findings,
        ),
        "laws": lambda result: numbers_frame(
            f"{LAW_ROWS} stated:f",
            _law_rows(result.robot, ((x.law, finding_numbers(result.robot, x)) for x in result.findings)),
        ),
        "alternatives": (
            "law:s joint:s alternative:s alternative_joint:s probability:f separating_motion:s",
            lambda result: (
                (
                    *(cause.law.effect.name, law_place(cause.law, result.robot)[0]),
                    *(rival.law.effect.name, law_place(rival.law, result.robot)[0]),
                    *(rival.probability, rival.separating_motion),
                )
                for cause in result.findings
                for rival in cause.alternatives
            ),
        ),
        "unexplained": (
            "joint:s variable:s region:s share:f held_out_gain:f in_model:b",
            lambda result: (
                (result.robot.joints[x.joint], x.place.variable, x.place.region, x.share, x.held_out_gain, x.modelled)
                for x in result.unexplained
            ),
        ),
        "fit": (
            f"simulation:s {FIT}",
            lambda result: ((name, *row) for name in ("before", "after") for row in _fit(getattr(result, name))),
        ),
        "rollouts": (ROLLOUT, lambda found: _rolled({"before": found.rollout_before, "after": found.rollout_after})),
        "residuals": _residuals,
        "segments": SEGMENT_TABLE,
    },
    "Estimate": {"base_parameters": ("expression:s value:f std:f unit:s", _estimated)},
    "Excitation": {
        "motion": _motion,
        "base_parameters": ("expression:s std:f relative_std:f", _side_by_side("expressions std relative_std")),
    },
    "Fit": {"fit": (FIT, _fit)},
    "Fleet": {
        "robots": (
            "robot:s verdict:s joint:s mismatch:f after:f explained:f",
            _listed("robots", "name verdict joint mismatch left explained"),
        ),
        "sessions": ("session:s name:s robot:s task:s state:s", _listed("sessions", "session name robot task state")),
    },
    "Identification": {
        "base_parameters": (
            "expression:s value:f std:f estimate:f unit:s",
            _side_by_side("base.expressions base_value estimate.std estimate.value base.units"),
        ),
        "laws": lambda result: numbers_frame(LAW_ROWS, (n for law in identified_numbers(result) for n in law)),
        "numbers": lambda result: numbers_frame("parameter:s value:f unit:s", whole_numbers(result)),
        "standard_parameters": BODY_TABLE,
        "fit": (FIT, lambda result: _fit(result.fit)),
        "residuals": _residuals,
        "segments": SEGMENT_TABLE,
    },
    "Inspection": {"base_parameters": lambda found: frame(found.base), "joints": lambda found: frame(found.robot)},
    "Model": {
        "laws": lambda model: numbers_frame(
            LAW_ROWS,
            _law_rows(model.robot, ((law, law_numbers(model.robot, law, {})) for law in model.laws_beside_drives)),
        ),
        "standard_parameters": BODY_TABLE,
        "drives": (
            "joint:s law:s parameter:s value:f unit:s",
            lambda model: (  # without infinite ones
                (joint, servo.law, name, value, SERVO_UNITS[name])
                for joint, servo in model.servos.items()
                for name in SERVO_NUMBERS
                if np.isfinite(value := float(getattr(servo, name)))
            ),
        ),
    },
    "Payload": {"payload": lambda found: numbers_frame("parameter:s value:f std:f unit:s", payload_numbers(found))},
    "Recording": {"samples": _samples},
    "Robot": {"joints": lambda robot: pl.DataFrame(joint_documents(robot))},
    "RollOut": {"rollouts": (ROLLOUT, lambda run: _rolled({"simulation": run}))},
    "Separation": {"motion": _motion},
    "ServoIdentification": {
        "drives": lambda result: numbers_frame(  # null where not identifiable
            "joint:s law:s parameter:s value:f std:f unit:s stated:f",
            (x for joint in result.joints for x in drive_numbers(joint)),
        ).with_columns(pl.col("stated").is_not_null()),
        "closed_loops": _loops,
        "positions": _positions,
    },
    "ServoSimulation": {"samples": lambda run: pl.DataFrame(dict(run.columns))},
    "ServoValidatedModel": {"closed_loops": _loops, "positions": _positions},
    "ServoValidation": {
        "closed_loops": lambda result: pl.concat(
            _loops(model).insert_column(0, pl.lit(model.name).alias("model")) for model in result.models
        )
    },
    "Signs": {"segments": SEGMENT_TABLE},
    "Simulation": {"samples": lambda run: _wide(run.t, run.joints, {"q": run.q, "tau": run.tau, "q_des": run.desired})},
    "ValidatedModel": {"fit": (FIT, lambda model: _fit(model.fit))},
    "Validation": {
        "fit": (
            "model:s joint:s unit:s rms:f noise_floor:f r2:f",
            lambda result: ((model.name, *row) for model in result.models for row in _held_out(model.fit)),
        ),
        "rollouts": (ROLLOUT, lambda result: _rolled({model.name: model.rollout for model in result.models})),
        "residuals": lambda result: _long(
            (x.fit.joints, {"model": [x.name] * len(x.t), **picked(x, "recording t")}, picked(x, "torque residual"))
            for x in result.models
        ),
    },
}
