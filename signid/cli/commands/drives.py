"""Position drives in `identify` and `validate`: recordings of commands and positions, without torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import OptionError, OutputError, readable
from ..app import DriveOptions, RunOptions
from ..terminal import bars

if TYPE_CHECKING:
    from ...output.report import Content
    from ...servo.identify import ServoIdentification
    from ...types import Input, Recording, Robot

COLUMNS_FILE = "columns.toml"  # column map with the signs and zeros that an identification found
SERVO_PREFIX = "servo@"  # beginning of injected numbers of drives


def identify_drives(
    robot: Robot,
    given: Sequence[Recording],
    held_out: Sequence[Recording],
    drives: DriveOptions,
    run: RunOptions,
    *,
    bounds: Sequence[str] | None,
    refit: bool | None,
) -> ServoIdentification:
    """Identify position drives, and compare friction models if asked; `robot` has its actuators file."""
    from ...servo.compare import compare_models
    from ...servo.identify import ServoOptions, identify_servos
    from ...servo.validate import need_commands

    need_commands((*given, *held_out), moving=True)
    laws = _laws(robot, drives.law or ())
    with bars(run.json) as progress:
        result = identify_servos(
            robot,
            given,
            held_out=held_out,
            laws=laws,
            known=drives.known,
            prior=drives.prior or (),
            bounds=bounds or (),
            equal=drives.equal or (),
            refit=refit,
            options=ServoOptions(seed=run.seed),
            progress=progress,
        )
        return compare_models(result, given, held_out=held_out, progress=progress) if drives.compare_models else result


def revised_columns(
    result: ServoIdentification, recordings: Sequence[Recording], columns: str | None, output: str | None
) -> tuple[dict[str, Content], tuple[str, ...]]:
    """columns.toml with the signs and zeros that are decided; if it cannot be written, a note with the reason."""
    from ...output.report import check_foreign
    from ...recording.mapping import Turned, revised_map

    turned = {zero.joint: Turned(zero.sign, zero.zero or 0.0) for zero in result.zeros if zero.changed and zero.decided}
    if not turned or output is None:
        return {}, ()
    first = recordings[0]
    if any(other.columns != first.columns for other in recordings):
        return {}, (f"{COLUMNS_FILE} is not written: the recordings have columns of different names",)
    try:
        check_foreign(output, [COLUMNS_FILE])
    except OutputError:
        return {}, (f"{COLUMNS_FILE} is not written: {output} has one that is not of signid",)
    return {COLUMNS_FILE: revised_map(columns, first.joints, first.columns, turned)}, ()


def registers_beside(actuators: str | None, models: Sequence[str]) -> tuple[str | None, list[Input]]:
    """Actuators file with firmware gains of recordings: the given one, or the one beside a model.json; as an input."""
    from ...recording.source import digest_of
    from ...robot import saved_model
    from ...types import Input

    beside = [saved.with_name("actuators.toml") for model in models if (saved := saved_model(model))]
    file = actuators or next((str(path) for path in beside if path.is_file()), None)
    if file is None or not Path(file).is_file():
        return file, []
    return file, [Input(readable(file), digest_of(Path(file)), "actuators")]


def _laws(robot: Robot, texts: Sequence[str]) -> Mapping[str, str] | str | None:
    """Law of all drives, or by joint."""
    from ...servos import DRIVE_LAWS

    if not texts:
        return None
    parts = [text.rpartition("=") for text in texts]
    pairs = [(_joint(joint, robot) if mark else None, law) for joint, mark, law in parts]
    if (wrong := next((law for _, law in pairs if law not in DRIVE_LAWS), None)) is not None:
        raise OptionError(f"--law {wrong!r} is none of {', '.join(DRIVE_LAWS)}; write LAW, or J=LAW for joint J")
    if any(joint is None for joint, _ in pairs):
        if len(pairs) > 1:
            raise OptionError("--law names a law of all drives and another one; give one law, or J=LAW for each joint")
        return pairs[0][1]
    return {joint: law for joint, law in pairs if joint is not None}


def _joint(name: str, robot: Robot) -> str:
    """Name of a joint that is given by name or number."""
    from ...robot.joints import find_joint

    return robot.joints[find_joint(name, robot)]


def injected_numbers(text: str, robot: Robot) -> tuple[str, dict[str, float]]:
    """Joint and numbers of `servo@JOINT:key=value,...` in --inject.

    Raises:
        OptionError: the text has another form.
    """
    joint, colon, tail = text[len(SERVO_PREFIX) :].partition(":")
    pairs = [pair.partition("=") for pair in tail.split(",")]
    try:
        numbers = {key.strip(): float(value) for key, _, value in pairs}
    except ValueError:
        numbers = {}
    if not (colon and numbers and all(0 <= abs(x) < 1e12 for x in numbers.values())):
        raise OptionError(f"--inject {text!r} cannot be read; write {SERVO_PREFIX}JOINT:kp=20,delay=0.01")
    return _joint(joint.strip(), robot), numbers
