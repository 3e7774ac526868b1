"""The command `export`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError
from ..app import app
from ..arguments import given_model, simulation_inputs
from ..options import Json, PackageDir, SimulationArguments, SimulationName, expanded
from ..terminal import DONE

if TYPE_CHECKING:
    from ...output.export import Exported

File = str | None


@dataclass(frozen=True, kw_only=True)
class ExportFiles:
    """Files to write, by format."""

    urdf: Annotated[File, typer.Option(metavar="FILE", help="The robot's URDF with the model's inertials.")] = None
    mjcf: Annotated[File, typer.Option(metavar="FILE", help="MuJoCo model with every law that MJCF can hold.")] = None
    actuators: Annotated[File, typer.Option(metavar="FILE", help="TOML of the actuators, for use with a URDF.")] = None
    function: Annotated[File, typer.Option(metavar="FILE", help="Python: torque(q, v, a) of the laws.")] = None
    ros: Annotated[File, typer.Option(metavar="FILE", help="YAML: actuators and inertials for a ROS 2 node.")] = None
    isaaclab: Annotated[File, typer.Option(metavar="FILE", help="Python: actuators for Isaac Lab.")] = None


@app.command(epilog="Example: signid export result/model.json --urdf arm.urdf --mjcf arm.xml")
@expanded
def export(
    simulation: SimulationName,
    exports: ExportFiles,
    package_dir: PackageDir = None,
    json: Json = False,
) -> int:
    """Write a model in the file formats of other programs.

    Options can be combined; content that a format cannot hold is listed. The URDF gets inertials (including a payload),
    damping and friction, and is otherwise unchanged. The MJCF also gets armature, springs, gravity, ranges and motors.
    The Python file needs only NumPy and holds the laws that both lack.
    """
    from ...output.export import export as write
    from ...output.report import Screen, to_json
    from ...output.report.results.documents import provenance

    asked: dict[str, File] = asdict(exports)
    paths = {kind: Path(file) for kind, file in asked.items() if file is not None}
    _check(asked, paths)
    packages = None if simulation.endswith(".json") else package_dir
    source = SimulationArguments(simulation=simulation, package_dir=packages)
    model, _ = given_model(source)
    made = {kind: write(model, kind, package_dir or ()) for kind in paths}
    _write(paths, made)
    files = [{"kind": kind, "path": asked[kind], "notes": list(made[kind].notes)} for kind in paths]
    known = {"schema": "signid.export/1", "robot": model.robot.name, "files": files}
    screen = Screen()
    if json:
        screen.write(to_json({**known, **provenance((), simulation_inputs(source, model.robot), 0)}))
        return DONE
    for kind in paths:
        for note in made[kind].notes:
            screen.print(f"{kind}: {note}")
    screen.write("\n".join(["written:", *(f"  {path}" for path in paths.values()), ""]))
    return DONE


def _check(asked: dict[str, File], paths: dict[str, Path]) -> None:
    """Check that the files can be written."""
    from ...output.report import probe_folder

    if not paths:
        raise OptionError("no file was named; add --urdf, --mjcf, --actuators, --function, --ros or --isaaclab FILE")
    for kind, path in paths.items():
        if not asked[kind] or path.is_dir():
            raise OptionError(f"--{kind} {asked[kind]!r} is not a file name; give the path of the file to write")
        probe_folder(path.parent, f"--{kind}")
    if len({path.resolve() for path in paths.values()}) < len(paths):
        raise OptionError("two of the files have the same name; give each its own")


def _write(paths: dict[str, Path], made: dict[str, Exported]) -> None:
    """Write the files; those of one folder all or none."""
    from ...output.report import write_files

    for folder in dict.fromkeys(path.parent for path in paths.values()):
        mine = {kind: path for kind, path in paths.items() if path.parent == folder}
        write_files(folder, {path.name: made[kind].text for kind, path in mine.items()}, f"--{next(iter(mine))}")
