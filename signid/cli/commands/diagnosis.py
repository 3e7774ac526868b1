"""The commands `diagnose` and `validate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...deadline import DEFAULT_TIME_LIMIT, time_limit
from ...errors import OptionError, RecordingError, RobotError, readable
from ..app import (
    Columns,
    Cutoff,
    Mcap,
    Rate,
    Recordings,
    RobotOptions,
    Rrd,
    RunOptions,
    SimulationArguments,
    Text,
    Texts,
    TimeLimit,
    Unsigned,
    command,
    complete_law,
    complete_robot,
    option,
    output_option,
)
from ..arguments import given_command, given_model, given_recordings, has_drives, simulation_inputs, under_gravity
from ..terminal import bars, check_folder

if TYPE_CHECKING:
    from ...diagnose import Diagnosis
    from ...model import Model
    from ...servo.diagnose import ServoDiagnosis
    from ...types import Recording
    from ..terminal import Logs

ROBOT_SUFFIXES = (".urdf", ".xacro", ".xml", ".mjcf", ".sdf")
INPUTS_HINT = "a model is a model.json, a URDF, xacro or MJCF file or a name such as panda; a recording is a data file"


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions:
    """Recordings, search and output of a diagnosis."""

    output: Text = output_option("Output folder. Needed, unless --json.")
    held_out: Texts = option(None, "Held-out recording. Repeatable. Default: see above.", metavar="RECORDING")
    reference: Texts = option(None, "Recording of the robot in a healthy state. Repeatable.", metavar="RECORDING")
    skip: Texts = option(
        None, "Effect to exclude from the search. Repeatable.", metavar="EFFECT", autocompletion=complete_law
    )
    columns: Columns = None
    rate: Rate = None
    cutoff: Cutoff = None
    unsigned: Unsigned = False
    servo: bool = option(False, "Diagnose position drives even if torque is recorded.", "--servo")
    rrd: Rrd = None
    mcap: Mcap = None
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT


@command("signid diagnose 3r recording.csv -o diagnosis")
def diagnose(
    context: typer.Context,
    diagnosis: DiagnoseOptions,
    simulation: SimulationArguments,
    recordings: Recordings,
    run: RunOptions,
) -> int:
    """Find the physics that a simulation lacks, and where it acts.

    Each law is listed with its parameters, its probability and the alternatives that fit equally well. DIR gets
    diagnosis.json, report.html, and the extended simulation as model.json and robot.urdf. Without --held-out the last
    of several recordings, or the last 30 % of a single one, is held out. Differences that --reference recordings show
    as well are not reported. Lost torque signs are recovered first, as in identify.

    Recordings with commanded positions (q_des_J) and without torque are compared with the closed loop of drives and
    robot, in rad: SIMULATION then has position drives, as a model.json of identify or by kp in its actuators file.

    Raises:
        OptionError: a reference for position drives.
    """
    from ...diagnose import diagnose as search
    from ...regression.session import Options
    from ..terminal import DIAGNOSIS_FILES, check_logs, deliver_diagnosis
    from .drives import registers_beside

    check_folder(diagnosis.output, run.json, DIAGNOSIS_FILES)
    logs = check_logs(rrd=diagnosis.rrd, mcap=diagnosis.mcap)
    simulation = under_gravity(simulation, recordings, diagnosis.columns)
    gains = simulation.actuators if simulation.saved else None
    model, _ = given_model(replace(simulation, actuators=None) if gains else simulation)
    given, held_out, healthy = (
        given_recordings(
            paths,
            model.robot,
            diagnosis.columns,
            diagnosis.unsigned,
            diagnosis.rate,
            output=diagnosis.output,
            quiet=run.json,
        )
        for paths in (recordings, diagnosis.held_out, diagnosis.reference)
    )
    skip = [name.strip() for text in diagnosis.skip or () for name in text.split(",")]
    if has_drives((*given, *held_out), diagnosis.servo):
        if healthy:
            raise OptionError(
                "--reference applies to torque; for position drives, identify them from the healthy recordings, and "
                "diagnose the resulting model.json"
            )
        from ...servo.diagnose import diagnose_servos

        file, read = registers_beside(gains, [simulation.simulation])
        with time_limit(diagnosis.time_limit):
            with bars(run.json) as progress:
                drives = diagnose_servos(
                    model, given, held_out=held_out, skip=skip, actuators=file, seed=run.seed, progress=progress
                )
            inputs = [*simulation_inputs(simulation, model.robot, columns=diagnosis.columns), *read]
            log = _log(model, [*given, *held_out], drives, logs)
            return deliver_diagnosis(drives, inputs, diagnosis.output, run.json, given_command(context), log)
    if gains:
        given_model(simulation)
    with time_limit(diagnosis.time_limit):
        with bars(run.json, one=True) as progress:
            result = search(
                model,
                given,
                held_out=held_out,
                reference=healthy,
                skip=skip,
                options=Options(cutoff=diagnosis.cutoff, seed=run.seed),
                progress=progress,
            )
        inputs = simulation_inputs(simulation, model.robot, columns=diagnosis.columns)
        log = _log(model, result.recordings, result, logs)
        return deliver_diagnosis(result, inputs, diagnosis.output, run.json, given_command(context), log)


def _log(
    model: Model, recordings: Sequence[Recording], diagnosis: Diagnosis | ServoDiagnosis, paths: dict[str, Path]
) -> Logs:
    """Log of the recordings for viewers, and the paths that were asked for."""
    if not paths:
        return None
    from ...output.viewers import viewer_log

    return viewer_log(model, recordings, diagnosis), paths


@dataclass(frozen=True, kw_only=True)
class ValidateOptions:
    """Data and output of a validation."""

    output: Text = output_option("Output folder. Default: none.")
    rollout: bool = option(True, "Also simulate from measured states.", "--rollout/--no-rollout")
    horizon: Text = option(None, "Length of these simulations [s], or whole. Default: 0.5.", metavar="S")
    columns: Columns = None
    rate: Rate = None
    cutoff: Cutoff = None


@command("signid validate 3r recording.csv")
def validate(
    context: typer.Context,
    given: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL|RECORDING",
            help="Models: model.json or ROBOT. Recordings: CSV, Parquet, NPZ, bag.",
            autocompletion=complete_robot,
        ),
    ],
    validation: ValidateOptions,
    robot: RobotOptions,
    run: RunOptions,
) -> int:
    """Compare given models with recordings, without fitting.

    Per joint: rms of measured - predicted torque, noise floor, R2, and the position error of short simulations from
    measured states. Several models are compared on the same rows. Each argument is recognised as a model or as a
    recording. --joints, --lock and --actuators apply to robot descriptions, not to a model.json. DIR gets
    validation.json and report.html.

    Recordings with commanded positions (q_des_J) and without torque are compared with closed loops of models with
    position drives: rms position error over whole recordings and over 1 s. --actuators then states the firmware gains
    of recordings, for a model.json too.

    Raises:
        OptionError: a horizon for recordings of closed loops.
    """
    from ...regression.session import Options
    from ...servo.validate import validate_servos
    from ...validate import HORIZON, validate as judge
    from ..terminal import VALIDATION_FILES, deliver_report
    from .drives import registers_beside

    check_folder(validation.output, True, VALIDATION_FILES)
    try:
        horizon: float | str = HORIZON if validation.horizon is None else float(validation.horizon)
    except ValueError:  # whole, or a text that is refused
        horizon = str(validation.horizon)
    names, recordings = _sort_arguments(given)
    robot = under_gravity(robot, recordings, validation.columns)
    sources = [SimulationArguments(simulation=name, **vars(robot)) for name in names]
    if not all(source.saved for source in sources):
        sources = [
            SimulationArguments(simulation=source.simulation, gravity=source.gravity) if source.saved else source
            for source in sources
        ]
    stated = robot.actuators is not None and all(source.saved for source in sources)
    sources = [replace(source, actuators=None) if stated else source for source in sources]
    models = {readable(source.simulation): given_model(source)[0] for source in sources}
    read = given_recordings(
        recordings,
        max(  # with most joints and torque constants
            (model.robot for model in models.values()),
            key=lambda robot: (len(robot.joints), sum(map(isfinite, robot.actuators.torque_constant.tolist()))),
        ),
        validation.columns,
        rate=validation.rate,
        output=validation.output,
        quiet=run.json,
    )
    servo = has_drives(read)
    if stated and not servo:
        given_model(replace(sources[0], actuators=robot.actuators))
    inputs = [
        file
        for source in sources
        for file in simulation_inputs(source, models[readable(source.simulation)].robot, columns=validation.columns)
    ]
    if servo and validation.horizon is not None:
        raise OptionError(
            "--horizon is for recordings with torque; closed loops are always simulated over whole recordings and 1 s"
        )
    if servo:
        gains, file = registers_beside(robot.actuators, names)
        with bars(run.json) as progress:
            loops = validate_servos(models, read, actuators=gains, seed=run.seed, progress=progress)
        return deliver_report(loops, [*inputs, *file], validation.output, run.json, given_command(context))
    options = Options(cutoff=validation.cutoff, seed=run.seed)
    with bars(run.json) as progress:
        result = judge(models, read, options=options, rollout=validation.rollout, horizon=horizon, progress=progress)
    return deliver_report(result, inputs, validation.output, run.json, given_command(context))


def _sort_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Separate arguments into models and recordings."""
    if twice := next((name for name in arguments if arguments.count(name) > 1), None):
        raise OptionError(f"{twice} was given twice; give each model and each recording once")
    models = [name for name in arguments if _is_model(name)]
    recordings = [name for name in arguments if name not in models]
    if not models:
        raise OptionError(f"no model was given with {recordings[0]}; {INPUTS_HINT}")
    if not recordings:
        raise OptionError(f"no recording was given with {models[0]}; {INPUTS_HINT}")
    return models, recordings


def _is_model(name: str) -> bool:
    """Whether an argument is a model, by its name or by the content of the folder."""
    from ...recording.formats import find_format
    from ...recording.formats.json_ import holds_samples
    from ...robot.locate import locate

    path = Path(name)
    if path.suffix.lower() in ROBOT_SUFFIXES or (path.suffix.lower() == ".json" and not holds_samples(path)):
        return True
    try:
        recorded = find_format(path) is not None
    except RecordingError:
        recorded = False
    if not path.is_dir():
        if recorded:
            return False
        if path.is_file():
            raise OptionError(f"{name} has the name of neither a model nor a recording; {INPUTS_HINT}")
        try:
            locate(name)
        except RobotError as error:
            raise OptionError(f"{name} is neither a model nor a recording: {error}") from None
        return True
    held = [file for file in ("model.json", "robot.urdf") if (path / file).is_file()]
    if len(held) + recorded != 1:
        content = " and ".join([*held, *(["a recording"] if recorded else [])]) or "neither a model nor a recording"
        raise OptionError(f"the folder {name} holds {content}; name the file instead")
    if held == ["model.json"]:
        raise OptionError(f"the folder {name} holds a model.json; name the file, {path / held[0]}")
    return not recorded
