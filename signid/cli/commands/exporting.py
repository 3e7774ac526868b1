"""The command `export`."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import OptionError, OutputError
from ..app import (
    Columns,
    Gravity,
    Json,
    PackageDir,
    Rate,
    SimulationArguments,
    SimulationName,
    Text,
    Xacro,
    command,
    option,
)
from ..arguments import given_model, given_recordings, simulation_inputs
from ..terminal import check_unread, show

if TYPE_CHECKING:
    from ...output.export import Exported

C_FILE_NAME = re.compile(r"[A-Za-z_]\w*\.c", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class ExportFiles:
    """Files to write, by format."""

    urdf: Text = option(None, "The robot's URDF with the model's inertials.", metavar="FILE")
    mjcf: Text = option(None, "MuJoCo model with every law that MJCF can hold.", metavar="FILE")
    actuators: Text = option(None, "TOML of the actuators, for use with a URDF.", metavar="FILE")
    function: Text = option(None, "Python: torque(q, v, a) of the laws.", metavar="FILE")
    ros: Text = option(None, "YAML: actuators and inertials for a ROS 2 node.", metavar="FILE")
    isaaclab: Text = option(None, "Python: actuators for Isaac Lab.", metavar="FILE")
    mjlab: Text = option(None, "Python: actuators for mjlab.", metavar="FILE")
    newton: Text = option(None, "Python: actuators for Newton.", metavar="FILE")
    c: Text = option(None, "C99: inverse dynamics; FILE.h and FILE_test.c beside it.", "--c", metavar="FILE.c")
    arrays: Text = option(None, "Python: inverse dynamics over numpy, jax.numpy or torch.", metavar="FILE")
    franka: Text = option(None, "JSON: payload as end effector of Desk; FILE_load.h for libfranka.", metavar="FILE")
    ur: Text = option(None, "URScript: payload of Universal Robots.", metavar="FILE")
    kuka: Text = option(None, "KRL: load data of KUKA KR C.", metavar="FILE")


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Content of an MJCF, of C code and of payloads, and the recording that exported position drives start from."""

    copy_meshes: bool = option(False, "Copy the meshes of --mjcf FILE.xml to FILE_meshes.", "--copy-meshes")
    floating: bool = option(False, "Put the base link of --mjcf on a free joint, with its mass.", "--floating")
    further: Text = option(
        None,
        "Further functions of --c, with commas between: nonlinear (h(q, v)), forward, jacobian, payload, observer.",
        "--with",
        metavar="LIST",
    )
    observer: bool = option(
        False, "Momentum observer in --c: residual torque, learned thresholds and contacts, as `signid watch`."
    )
    link: Text = option(None, "Link of jacobian and payload of --with, instead of the last joint's.", metavar="LINK")
    flange: Text = option(
        None, "Flange frame of --franka, --ur and --kuka. Default: link8 of Franka, tool0.", metavar="LINK"
    )
    tool: Text = option(None, "Tool frame of --franka, --ur and --kuka. Default: none.", metavar="LINK")
    start: Text = option(
        None, "Recording that drives of --mjcf, --isaaclab and --mjlab start from.", metavar="RECORDING"
    )
    columns: Columns = None
    rate: Rate = None
    package_dir: PackageDir = None
    gravity: Gravity = None
    xacro: Xacro = None

    @property
    def functions(self) -> list[str]:
        """Names of the functions of C code on request."""
        listed = [] if self.further is None else [name.strip() for name in self.further.split(",")]
        return listed + ["observer"] * self.observer


@command("signid export result/model.json --urdf arm.urdf --mjcf arm.xml")
def export(simulation: SimulationName, exports: ExportFiles, options: ExportOptions, json: Json = False) -> int:
    """Write a model in the file formats of other programs.

    Options can be combined; content that a format cannot hold is listed, and flagged where it is more than 2 % of the
    torque of a joint. The URDF gets inertials (including a payload), damping and friction, and is otherwise unchanged.
    The MJCF also gets armature, springs, gravity, ranges and motors, or position drives with their delay and limits.
    --function needs only NumPy and holds the laws that both lack. --franka, --ur and --kuka need a payload, as signid
    payload -o DIR writes it into model.json.
    """
    from ...output.export import STARTED_KINDS, export as write
    from ...output.report import Screen, to_json
    from ...output.report.documents import provenance
    from ...robot import saved_model

    asked: dict[str, Text] = asdict(exports)
    paths = {kind: Path(file) for kind, file in asked.items() if file is not None}
    _check_exports(asked, paths, options)
    saved = saved_model(simulation, exported=True)
    name, packages, start = str(saved or simulation), None if saved else options.package_dir, options.start
    source = SimulationArguments(simulation=name, package_dir=packages, gravity=options.gravity, xacro=options.xacro)
    model, _ = given_model(source)
    for kind, path in paths.items():
        check_unread(path, [simulation, model.robot.path, *([start] if start else [])], f"--{kind}")
    read = given_recordings([start] if start else [], model.robot, options.columns, rate=options.rate)
    made = {
        kind: write(
            model,
            kind,
            options.package_dir or (),
            name=path.stem,
            floating=options.floating,
            meshes=f"{path.stem}_meshes" if options.copy_meshes else None,
            start=read[0] if read and kind in STARTED_KINDS else None,
            functions=options.functions if kind == "c" else (),
            link=options.link if kind == "c" else None,
            flange=options.flange,
            tool=options.tool,
            beside=list(paths),
        )
        for kind, path in paths.items()
    }
    meshes = _write(paths, made)
    files = [
        {"kind": kind, "path": asked[kind], "flags": list(exported.flags), "notes": list(exported.notes)}
        for kind, exported in made.items()
    ]
    known = {"schema": "signid.export/1", "robot": model.robot.name, "files": files}
    flags = [f"{kind}: {flag}" for kind, exported in made.items() for flag in exported.flags]
    if json:
        return show(to_json({**known, **provenance((), simulation_inputs(source, model.robot), 0)}), flags)
    screen = Screen()
    for kind, note in ((kind, note) for kind, exported in made.items() for note in exported.notes):
        screen.print(f"{kind}: {note}")
    beside = [path.with_name(path.stem + end) for kind, path in paths.items() for end in made[kind].beside]
    screen.write("\n".join(["written:", *(f"  {path}" for path in (*paths.values(), *beside, *meshes)), ""]))
    return show("", flags)


def _check_exports(asked: dict[str, Text], paths: dict[str, Path], options: ExportOptions) -> None:
    """Check that the files can be written."""
    from ...output.export import STARTED_KINDS, VENDORS
    from ...output.export.code.languages import identifier
    from ...output.report import probe_folder

    if not paths:
        raise OptionError(f"no file was named; add {', '.join(f'--{kind}' for kind in asked)} FILE")
    for kind, path in paths.items():
        if not asked[kind] or path.is_dir():
            raise OptionError(f"--{kind} {asked[kind]!r} is not a file name; give the path of the file to write")
        if kind == "c" and not C_FILE_NAME.fullmatch(path.name):
            raise OptionError(
                f"--c {asked[kind]!r} is no name of a C file: letters, digits and underscores, no digit at the "
                f"beginning, and .c at the end; name it {identifier(path.stem)}.c"
            )
        probe_folder(path.parent, f"--{kind}")
    if options.start is not None and not set(STARTED_KINDS) & paths.keys():
        raise OptionError(
            f"--start belongs to {', '.join(f'--{kind}' for kind in STARTED_KINDS)}; add one of them with a FILE"
        )
    if options.columns is not None and options.start is None:
        raise OptionError("--columns names the columns of --start RECORDING; add it")
    if (options.functions or options.link is not None) and "c" not in paths:
        raise OptionError("--with, --observer and --link belong to C code; add --c FILE.c")
    if (options.copy_meshes or options.floating) and "mjcf" not in paths:
        raise OptionError("--copy-meshes and --floating belong to an MJCF; add --mjcf FILE")
    if (options.flange or options.tool) and not set(VENDORS) & paths.keys():
        raise OptionError("--flange and --tool belong to --franka, --ur and --kuka; add one of them with a FILE")
    if len({path.resolve() for path in paths.values()}) < len(paths):
        raise OptionError("two of the files have the same name; give each its own")


def _write(paths: dict[str, Path], made: dict[str, Exported]) -> list[Path]:
    """Write the files; those of one folder all or none, meshes before the MJCF that reads them; return the meshes."""
    from ...output.report import check_foreign, write_files

    beside = {kind: [path.with_name(path.stem + end) for end in made[kind].beside] for kind, path in paths.items()}
    for kind, further in beside.items():
        check_foreign(paths[kind].parent, [path.name for path in further], f"--{kind}")
        if shared := {path.resolve() for path in further} & {path.resolve() for path in paths.values()}:
            raise OptionError(f"--{kind} also writes {shared.pop().name}; give the other file another name")
    copies = {path.parent / name: source for kind, path in paths.items() for name, source in made[kind].meshes.items()}
    new: dict[Path, bytes] = {}  # meshes that are not there yet
    for path, source in copies.items():
        try:
            content = source.read_bytes()
            there = path.read_bytes() if path.exists() or path.is_symlink() else None
        except OSError as error:
            raise OutputError(f"cannot copy {source} to {path}: {error.strerror}; give --mjcf another name") from None
        if there is None:
            new[path] = content
        elif there != content:
            raise OutputError(f"{path} differs from the mesh {source}; move it, or give --mjcf another name")
    try:
        for place in dict.fromkeys(path.parent for path in new):
            write_files(place, {path.name: x for path, x in new.items()}, "--mjcf", named=True)
        for folder in dict.fromkeys(path.parent for path in paths.values()):
            mine = {kind: path for kind, path in paths.items() if path.parent == folder}
            texts = {path.name: made[kind].text for kind, path in mine.items()}
            texts |= {path.stem + end: x for kind, path in mine.items() for end, x in made[kind].beside.items()}
            write_files(folder, texts, f"--{next(iter(mine))}", named=True)
    except BaseException:
        for path in new:
            path.unlink(missing_ok=True)
            with suppress(OSError):
                path.parent.rmdir()  # if it is empty
        raise
    return list(copies)
