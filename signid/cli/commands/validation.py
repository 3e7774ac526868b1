"""The command `validate`."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError, RecordingError, RobotError
from ..app import app
from ..arguments import Actuators, Columns, Cutoff, Joints, Json, Lock, PackageDir, Seed, again, given_recording
from ..output import check_folder
from ..source import Source, given_model
from ..terminal import bars

if TYPE_CHECKING:
    from ...model import Model
    from ...types import Robot

DESCRIPTIONS = (".urdf", ".xacro", ".xml", ".mjcf", ".sdf")
EXPECTED = "a model is a model.json, a URDF, xacro or MJCF file or a name such as panda, a recording a file of samples"


@app.command(epilog="Example: signid validate 3r recording.csv")
def validate(
    context: typer.Context,
    given: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL|RECORDING", help="Models: model.json or ROBOT. Recordings: CSV, Parquet, NPZ, bag."
        ),
    ],
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="DIR", help="Folder of the results. Default: none.")
    ] = None,
    rollout: Annotated[bool, typer.Option("--rollout/--no-rollout", help="Simulate short horizons, too.")] = True,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    package_dir: PackageDir = None,
    columns: Columns = None,
    cutoff: Cutoff = None,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Given models against recordings, without fitting anything.

    Per joint: rms of measured - predicted torque, noise floor, R2, and the position error of short simulations from
    measured states. Several models stand side by side, judged on the same rows. Each argument is taken by its kind,
    as a model or as a recording. --joints, --lock and --actuators count for robots, not for a model.json. DIR gets
    validation.json and report.html.
    """
    from ...regression.session import Options
    from ...validate import validate as judge
    from ..files import deliver_validation

    check_folder(output, json=True)
    names, recordings = sort_arguments(given)
    about = (joints, lock, actuators, package_dir)
    sources = [Source(name, *about) for name in names]
    if not all(source.saved for source in sources):
        sources = [Source(one.name) if one.saved else one for one in sources]
    models = {source.name: given_model(source)[0] for source in sources}
    reader = _reader(list(models.values()))
    read = [given_recording(path, reader, columns) for path in recordings]
    with bars(json) as progress:
        result = judge(models, read, options=Options(cutoff=cutoff, seed=seed), rollout=rollout, progress=progress)
    inputs = [file for one in sources for file in one.inputs(models[one.name].robot, columns=columns)]
    return deliver_validation(result, inputs, output, json, again(context))


def sort_arguments(given: Sequence[str]) -> tuple[list[str], list[str]]:
    """Models and recordings among some arguments, each by its kind.

    Raises:
        OptionError: one is neither, or may be either, or was given twice; or there is no model, or no recording.
    """
    if twice := next((name for name in given if given.count(name) > 1), None):
        raise OptionError(f"{twice} was given twice; give each model and each recording once")
    models = [name for name in given if _is_model(name)]
    recordings = [name for name in given if name not in models]
    if not models:
        raise OptionError(f"no model was given beside {recordings[0]}; {EXPECTED}")
    if not recordings:
        raise OptionError(f"no recording was given beside {models[0]}; {EXPECTED}")
    return models, recordings


def _is_model(name: str) -> bool:
    """Whether an argument is a model, by its name or by what the folder holds.

    Raises:
        OptionError: it is neither a model nor a recording, or may be either.
    """
    from ...recording.formats.find import find_format
    from ...robot.locate import locate

    path = Path(name)
    if path.suffix.lower() == ".json" or path.suffix.lower() in DESCRIPTIONS:
        return True
    try:
        recorded = find_format(path) is not None
    except RecordingError:
        recorded = False
    if not path.is_dir():
        if recorded:
            return False
        if path.is_file():
            raise OptionError(f"the name of {name} is neither that of a model nor of a recording; {EXPECTED}")
        try:
            locate(name)
        except RobotError as error:
            raise OptionError(f"{name} is neither a model nor a recording: {error}") from None
        return True
    held = [file for file in ("model.json", "robot.urdf") if (path / file).is_file()]
    if len(held) + recorded != 1:
        found = " and ".join([*held, *(["a recording"] if recorded else [])]) or "neither a model nor a recording"
        raise OptionError(f"the folder {name} holds {found}; name the file that is meant")
    if held == ["model.json"]:
        raise OptionError(f"the folder {name} holds a model.json; name the file, {path / held[0]}")
    return not recorded


def _reader(models: Sequence[Model]) -> Robot:
    """The robot that recordings are read for: with most joints, then with most torque constants, then the first."""

    def known(robot: Robot) -> tuple[int, int]:
        return len(robot.joints), sum(map(isfinite, robot.actuators.torque_constant.tolist()))

    return max((model.robot for model in models), key=known)
