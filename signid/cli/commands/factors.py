"""The command `reduce`, and files of factors in place of recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ...errors import OptionError
from ..app import Text, Texts, command, option, output_option
from ..arguments import given_options, given_recordings, given_robot
from ..options import Recordings, RobotArguments, RowOptions, RunOptions
from ..terminal import bars, check_unread, show

if TYPE_CHECKING:
    from ...regression.reduced import Reduced
    from ...types import Input, Progress, Recording, Robot

SHAPES = ("held_out", "columns", "effects", "cutoff", "derivatives", "no_instruments")  # options of `reduce` itself
SAMPLES = ("unsigned", "robust")  # options that need samples


def given_factors(paths: Sequence[str], robot: Robot, context: typer.Context) -> Reduced:
    """Return the sum of files, at least one of them of factors.

    Raises:
        OptionError: the files are of both kinds, or an option applies to recordings only, or the factors do not match.
    """
    from ...regression.reduced import add_up, is_factor_file, load_factors

    reduced = [is_factor_file(path) for path in paths]
    if not all(reduced):
        raise OptionError(
            f"{paths[reduced.index(False)]} is a recording and {paths[reduced.index(True)]} a file of factors; "
            f"reduce the recording in the same way (signid reduce --like), and give its factors"
        )
    defaults = {parameter.name: parameter.default for parameter in context.command.params}
    for name in (*SHAPES, *SAMPLES):
        if context.params[name] and context.params[name] != defaults[name]:
            advice = "the recordings instead" if name in SAMPLES else "it to signid reduce"
            raise OptionError(
                f"--{name.replace('_', '-')} applies to recordings, but {paths[0]} is already reduced; give {advice}"
            )
    return add_up([load_factors(path, robot) for path in paths])


def factor_inputs(paths: Sequence[str]) -> list[Input]:
    """List files of factors with their digests."""
    from ...types import Input

    return [Input(path, sha256(Path(path).read_bytes()).hexdigest(), "factors") for path in paths]


MOST_PARTS = 1000  # every part is a process that reads the recordings


@dataclass(frozen=True, kw_only=True)
class ReduceOptions:
    """Parts, data and output of a reduction."""

    output: Text = output_option("A .npz file. Needed, unless --json.", "FILE")
    held_out: Texts = option(None, "Held-out recording. Repeatable. Default: see identify.", metavar="RECORDING")
    like: Text = option(
        None, "Use laws, band and filter of this file, so that both add up. Default: its own.", metavar="FACTORS"
    )
    parts: int | None = option(
        None, "Reduce N parts in parallel; the result is identical. Default: 1.", metavar="N", min=1
    )
    scheduler: Text = option(
        None, "Dask scheduler for --parts: tcp://HOST:8786. Default: this machine.", metavar="ADDRESS"
    )
    only: Text = option(None, "Reduce part K of N only; identify takes all N files. Default: all.", metavar="K/N")


@command("signid reduce 3r recording.csv -o factors.npz")
def reduce(
    context: typer.Context,
    reduction: ReduceOptions,
    robot: RobotArguments,
    recordings: Recordings,
    rows: RowOptions,
    run: RunOptions,
) -> int:
    """Reduce recordings to the factors that identify needs.

    FILE holds factors instead of samples, 0.1 to 1 MB for recordings of any length. signid identify ROBOT FILE gives
    the same result as the recordings, at once. Files can be added if they are reduced --like one of them; otherwise
    laws, band and filter follow from the recordings themselves.
    """
    from ...output.report import to_json, write_files
    from ...output.report.results.recordings import factors_document, factors_tables
    from ...regression.reduced import add_up, encode_factors

    _check(reduction, run.json)
    if reduction.output is not None:
        read = [*recordings, *(reduction.held_out or ()), reduction.like, rows.columns, robot.robot, robot.actuators]
        check_unread(reduction.output, read)
    described = given_robot(robot.robot, robot)
    flags: tuple[str, ...] = ()
    if reduction.parts is not None:
        with bars(run.json) as progress:
            parts = list(_side_by_side(context, reduction.parts, reduction.scheduler, described, progress))
        found, flags = add_up([part for part, _ in parts]), parts[0][1]
    else:
        given, held_out = (given_recordings(some, described, rows.columns) for some in (recordings, reduction.held_out))
        found = _reduce(described, given, held_out, reduction, rows, run)
        flags = _fault_flags(found.task.robot, [*given, *held_out])
    content = encode_factors(found)
    place = Path(reduction.output or "")
    written = [] if reduction.output is None else write_files(place.parent, {place.name: content}, named=True)
    document = factors_document(found, len(content))
    return show(to_json(document) if run.json else factors_tables(document), flags, written)


def _fault_flags(robot: Robot, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Faults of the recordings, by comparison with the description."""
    from ...faults import recording_flags
    from ...model import Model, stated_inertials, stated_laws

    return recording_flags(Model(robot, stated_inertials(robot), stated_laws(robot)), recordings)


def _reduce(
    robot: Robot,
    given: Sequence[Recording],
    held_out: Sequence[Recording],
    reduction: ReduceOptions,
    rows: RowOptions,
    run: RunOptions,
) -> Reduced:
    from ...regression.reduced import load_factors, reduce as learn

    with bars(run.json) as progress:
        return learn(
            robot,
            given,
            held_out=held_out,
            options=given_options(rows, run.seed),
            like=None if reduction.like is None else load_factors(reduction.like, robot),
            share=_share(reduction.only),
            progress=progress,
        )


def _check(reduction: ReduceOptions, json: bool) -> None:
    from ...output.report import probe_folder

    output = reduction.output
    if output == "" or (output is None and not json):
        raise OptionError("no file for the factors was named; add -o FILE.npz, or --json to print a summary instead")
    if output is not None:
        if not output.lower().endswith(".npz"):
            raise OptionError(f"{output!r} is not a .npz file, the format of factors; use a name that ends in .npz")
        probe_folder(Path(output).parent)
    if reduction.parts is not None and reduction.parts > MOST_PARTS:
        raise OptionError(f"--parts is {reduction.parts}; give at most {MOST_PARTS}, about one per core")
    if reduction.parts is not None and reduction.only is not None:
        raise OptionError("--parts reduces all parts and --only one of them; give one of these options")
    if reduction.scheduler is not None and reduction.parts is None:
        raise OptionError("--scheduler distributes parts; add --parts N")


def _share(only: str | None) -> tuple[int, int]:
    """The number of a part and the number of parts."""
    try:
        which, of = (int(part) for part in (only or "1/1").split("/"))
    except ValueError:
        raise OptionError(f"--only {only!r} is not a part; write K/N, such as 3/8") from None
    return which, of


def _side_by_side(
    context: typer.Context, parts: int, scheduler: str | None, robot: Robot, progress: Progress | None
) -> Iterator[tuple[Reduced, tuple[str, ...]]]:
    """Yield every part, reduced by worker processes, and its flags."""
    from contextlib import closing
    from tempfile import TemporaryDirectory

    from ...regression.reduced import load_factors
    from ..fleet.dispatch import cores, spread
    from ..fleet.process import Order

    words = _spelled(context, ("output", "parts", "scheduler", "json"))
    orders = [Order((*words, "--only", f"{k + 1}/{parts}"), str(Path.cwd()), "part.npz") for k in range(parts)]
    workers = min(parts, cores()) if scheduler is None else None
    with closing(spread(orders, workers, scheduler)) as answers:
        for done, (number, answer) in enumerate(answers, 1):
            if not answer.done:
                raise OptionError(f"part {number + 1} of {parts} was not reduced: {answer.said[0]}")
            if progress is not None:
                progress(f"{done} of {parts} parts", done / parts)
            with TemporaryDirectory() as place:
                (file := Path(place) / "part.npz").write_bytes(answer.files["part.npz"])
                yield load_factors(file, robot), answer.said


def _spelled(context: typer.Context, but: Sequence[str]) -> tuple[str, ...]:
    """The command and its given options as words, some options excepted."""
    words = [str(context.command.name)]
    for parameter in context.command.params:
        value = context.params[str(parameter.name)]
        if parameter.name in but or value is None or value is False:
            continue
        name = [] if parameter.param_type_name == "argument" else [parameter.opts[-1]]
        for each in value if isinstance(value, list | tuple) else [value]:
            words += name if each is True else [*name, str(each)]
    return tuple(words)
