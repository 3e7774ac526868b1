"""The command `export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError
from ..app import app
from ..arguments import Json, SimulationName
from ..source import Source, given_model
from ..terminal import DONE

if TYPE_CHECKING:
    from ...output.export import Exported

File = str | None


@app.command(epilog="Example: signid export result/model.json --urdf arm.urdf --mjcf arm.xml")
def export(
    simulation: SimulationName,
    urdf: Annotated[File, typer.Option(metavar="FILE", help="The robot's own, with the model's inertials.")] = None,
    mjcf: Annotated[File, typer.Option(metavar="FILE", help="For MuJoCo, with all that it can hold.")] = None,
    actuators: Annotated[File, typer.Option(metavar="FILE", help="TOML: the drives, to go beside a URDF.")] = None,
    function: Annotated[File, typer.Option(metavar="FILE", help="Python: torque(q, v, a) of the laws.")] = None,
    ros: Annotated[File, typer.Option(metavar="FILE", help="YAML: drives and inertials for a ROS 2 node.")] = None,
    isaaclab: Annotated[File, typer.Option(metavar="FILE", help="Python: the actuators for Isaac Lab.")] = None,
    package_dir: Annotated[
        list[str] | None, typer.Option(metavar="DIR", help="Where packages of meshes lie. Repeatable.")
    ] = None,
    json: Json = False,
) -> int:
    """A model in files that other programs read.

    Any of them together; what a format cannot hold is said. The URDF holds inertials (a payload among them), damping
    and friction, all else as it was; the MJCF also armature, springs, gravity, ranges and motors; the Python file needs
    numpy alone and has what both lack.
    """
    from ...output.export import export as write
    from ...output.report import Screen, to_json
    from ...output.report.results.documents import provenance

    asked = {
        "urdf": urdf, "mjcf": mjcf, "actuators": actuators, "function": function, "ros": ros, "isaaclab": isaaclab
    }  # fmt: skip
    paths = {kind: Path(file) for kind, file in asked.items() if file is not None}
    _check(asked, paths)
    source = Source(simulation, packages=None if simulation.endswith(".json") else package_dir)
    model, _ = given_model(source)
    made = {kind: write(model, kind, package_dir or ()) for kind in paths}
    _write(paths, made)
    files = [{"kind": kind, "path": asked[kind], "notes": list(made[kind].notes)} for kind in paths]
    known = {"schema": "signid.export/1", "robot": model.robot.name, "files": files}
    screen = Screen()
    if json:
        screen.write(to_json({**known, **provenance((), source.inputs(model.robot), 0)}))
        return DONE
    for kind in paths:
        for note in made[kind].notes:
            screen.print(f"{kind}: {note}")
    screen.write("\n".join(["written:", *(f"  {path}" for path in paths.values()), ""]))
    return DONE


def _check(asked: dict[str, File], paths: dict[str, Path]) -> None:
    """Find out at once whether the files can be written."""
    from ...output.report import probe_folder

    if not paths:
        raise OptionError("no file was named; add --urdf, --mjcf, --actuators, --function, --ros or --isaaclab FILE")
    for kind, path in paths.items():
        if not asked[kind] or path.is_dir():
            raise OptionError(f"--{kind} {asked[kind]!r} is no name of a file; give the path of the file to write")
        probe_folder(path.parent, f"--{kind}")
    if len({path.resolve() for path in paths.values()}) < len(paths):
        raise OptionError("two of the files have the same name; give each its own")


def _write(paths: dict[str, Path], made: dict[str, Exported]) -> None:
    """The files, those of a folder all or none."""
    from ...output.report import write_files

    for folder in dict.fromkeys(path.parent for path in paths.values()):
        mine = {kind: path for kind, path in paths.items() if path.parent == folder}
        write_files(folder, {path.name: made[kind].text for kind, path in mine.items()}, f"--{next(iter(mine))}")
