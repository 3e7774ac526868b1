"""The command `reduce`, and files of factors where recordings may stand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError
from ..app import app
from ..arguments import (
    Actuators,
    Columns,
    Cutoff,
    Derivatives,
    Effects,
    Files,
    Joints,
    Json,
    Lock,
    NoInstruments,
    PackageDir,
    RobotName,
    Seed,
    White,
    given_options,
    given_recording,
    given_robot,
)
from ..terminal import DONE, bars

if TYPE_CHECKING:
    from ...regression.reduced import Reduced
    from ...types import Input, Progress, Robot

SHAPES = ("held_out", "columns", "effects", "cutoff", "derivatives", "no_instruments")
SAMPLES = ("unsigned", "robust")  # options that need samples
PARTS = "Cut the rows into N parts, reduced side by side, to the same bytes. Default: 1."
ONLY = "One part of N, for a scheduler of your own; identify takes all N files. Default: all."


def given_factors(paths: Sequence[str], robot: Robot, context: typer.Context) -> Reduced | None:
    """The sum of files of factors; None where the files are recordings.

    Raises:
        OptionError: recordings stand beside them, an option says how recordings become rows, or they do not add.
    """
    from ...regression.reduced import add_up, is_factor_file, load_factors

    reduced = [is_factor_file(path) for path in paths]
    if not any(reduced):
        return None
    if not all(reduced):
        told = f"{paths[reduced.index(False)]} is a recording and {paths[reduced.index(True)]} a file of factors"
        raise OptionError(f"{told}; reduce the recording like those (signid reduce --like), and give its factors")
    defaults = {parameter.name: parameter.default for parameter in context.command.params}
    for name in (*SHAPES, *SAMPLES):
        if context.params[name] and context.params[name] != defaults[name]:
            told = f"--{name.replace('_', '-')} tells how recordings are read, and {paths[0]} has been reduced already"
            raise OptionError(f"{told}; give {'the recordings instead' if name in SAMPLES else 'it to signid reduce'}")
    return add_up([load_factors(path, robot) for path in paths])


def factor_inputs(paths: Sequence[str]) -> list[Input]:
    """Those of some files that are of factors, by what they hold."""
    from ...regression.reduced import is_factor_file
    from ...types import Input

    digests = ((path, sha256(Path(path).read_bytes()).hexdigest()) for path in paths if is_factor_file(path))
    return [Input(path, digest, "factors") for path, digest in digests]


@app.command(epilog="Example: signid reduce 3r recording.csv -o factors.npz")
def reduce(
    context: typer.Context,
    robot: RobotName,
    recordings: Files,
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="FILE", help="A .npz file. Needed, unless --json.")
    ] = None,
    held_out: Annotated[
        list[str] | None, typer.Option(metavar="RECORDING", help="To judge by. Repeatable. Default: see identify.")
    ] = None,
    like: Annotated[
        str | None,
        typer.Option(metavar="FACTORS", help="Laws, band and filter of that file, so that both add. Default: its own."),
    ] = None,
    parts: Annotated[int | None, typer.Option(metavar="N", min=1, help=PARTS)] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Of Dask, for --parts: tcp://HOST:8786. Default: this machine."),
    ] = None,
    only: Annotated[str | None, typer.Option(metavar="K/N", help=ONLY)] = None,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    package_dir: PackageDir = None,
    columns: Columns = None,
    effects: Effects = None,
    cutoff: Cutoff = None,
    derivatives: Derivatives = "auto",
    no_instruments: NoInstruments = False,
    white: White = False,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Recordings made small: all that identify needs.

    FILE holds factors instead of samples, 0.1 to 1 MB however long the recordings are. signid identify ROBOT FILE
    answers from it as from the recordings, at once. Files add up, in any number, where they are reduced --like one of
    them; without it laws, band and filter follow from the recordings themselves.
    """
    from ...output.report import Screen, factors_document, factors_tables, to_json, write_files
    from ...regression.reduced import add_up, encode_factors, load_factors, reduce as learn

    _check(output, only, parts, scheduler, json)
    described = given_robot(robot, joints, lock, actuators, package_dir)
    if parts is not None:
        with bars(json) as progress:
            found = add_up(list(_side_by_side(context, parts, scheduler, described, progress)))
    else:
        given, judges = (
            [given_recording(p, described, columns) for p in some] for some in (recordings, held_out or ())
        )
        with bars(json) as progress:
            found = learn(
                described,
                given,
                held_out=judges,
                options=given_options(effects, cutoff, derivatives, no_instruments, white, seed),
                like=None if like is None else load_factors(like, described),
                share=_share(only),
                progress=progress,
            )
    content = encode_factors(found)
    place = Path(output or "")
    written = [] if output is None else write_files(place.parent, {place.name: content})
    document = factors_document(found, len(content))
    if json:
        Screen().write(to_json(document))
    else:
        Screen().print(*factors_tables(document), sep="\n")
        Screen().write("\n".join(["", "written:", *(f"  {path}" for path in written), ""]))
    return DONE


def _check(output: str | None, only: str | None, parts: int | None, scheduler: str | None, json: bool) -> None:
    from ...output.report import probe_folder

    if output == "" or (output is None and not json):
        raise OptionError("no file for the factors was named; add -o FILE.npz, or --json to print what is told of them")
    if output is not None:
        if not output.lower().endswith(".npz"):
            raise OptionError(f"factors are written as .npz, and {output!r} is none; let its name end in .npz")
        probe_folder(Path(output).parent)
    if parts is not None and only is not None:
        raise OptionError("--parts makes all parts and --only one; give one of them")
    if scheduler is not None and parts is None:
        raise OptionError("--scheduler is where parts are reduced side by side; add --parts N")


def _share(only: str | None) -> tuple[int, int]:
    """Which part of how many.

    Raises:
        OptionError: it is none.
    """
    try:
        which, of = (int(part) for part in (only or "1/1").split("/"))
    except ValueError:
        raise OptionError(f"--only {only!r} is no part; write K/N, such as 3/8") from None
    return which, of


def _side_by_side(
    context: typer.Context, parts: int, scheduler: str | None, robot: Robot, progress: Progress | None
) -> Iterator[Reduced]:
    """Every part, as processes of their own reduce them."""
    from contextlib import closing
    from tempfile import TemporaryDirectory

    from ...regression.reduced import load_factors
    from ..fleet import Order, cores, spread

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
                yield load_factors(file, robot)


def _spelled(context: typer.Context, but: Sequence[str]) -> tuple[str, ...]:
    """The command with all that was given to it, but for some options, as words."""
    words = [str(context.command.name)]
    for parameter in context.command.params:
        value = context.params[str(parameter.name)]
        if parameter.name in but or value is None or value is False:
            continue
        name = [] if parameter.param_type_name == "argument" else [parameter.opts[-1]]
        for each in value if isinstance(value, list | tuple) else [value]:
            words += name if each is True else [*name, str(each)]
    return tuple(words)
