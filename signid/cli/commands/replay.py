"""The command `replay`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..app import app
from ..arguments import Actuators, Columns, Joints, Json, Lock, PackageDir, SimulationName, given_recording
from ..source import Source, given_model
from ..terminal import DONE

if TYPE_CHECKING:
    from ...output.replay import Replay

Seconds = float | None


@app.command(epilog="Example: signid replay 3r recording.csv --html replay.html")
def replay(
    simulation: SimulationName,
    recording: Annotated[str, typer.Argument(metavar="RECORDING", help="A CSV, CSV.gz, Parquet or NPZ file.")],
    diagnosis: Annotated[
        str | None, typer.Option(metavar="FILE", help="diagnosis.json, its model.json beside it.")
    ] = None,
    html: Annotated[
        str | None, typer.Option(metavar="FILE", help="Write one file that needs no network, show nothing.")
    ] = None,
    start: Annotated[float, typer.Option("--from", metavar="S", help="Where it begins [s].")] = 0.0,
    duration: Annotated[Seconds, typer.Option(metavar="S", help="How long it is [s]. Default: all, to 60.")] = None,
    horizon: Annotated[float, typer.Option(metavar="S", help="Until the simulation starts anew [s].")] = 0.5,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Frames a second [Hz].")] = 30.0,
    browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the browser.")] = True,
    joints: Joints = None,
    lock: Lock = None,
    actuators: Actuators = None,
    package_dir: PackageDir = None,
    columns: Columns = None,
    json: Json = False,
) -> int:
    """The recorded robot and its simulation, in the browser.

    Live, as a Meshcat viewer, or as one HTML file. The simulation is a ghost that starts anew from the measured state
    again and again, under the recorded torque. Links have the colour of the torque that it leaves unexplained at their
    joint. With --diagnosis what was found is marked, and a switch shows the simulation with what it lacked.
    """
    from ...output.replay import replay as build
    from ...output.report import Screen, to_json, write_files
    from ...output.report.results.documents import provenance

    _check(html)
    if diagnosis is not None and Path(diagnosis).is_dir():
        diagnosis = str(Path(diagnosis) / "diagnosis.json")
    source = Source(simulation, joints, lock, actuators, package_dir)
    model, _ = given_model(source)
    shown = build(
        model,
        given_recording(recording, model.robot, columns),
        diagnosis,
        start=start,
        duration=duration,
        horizon=horizon,
        rate=rate,
        package_dirs=package_dir or (),
    )
    written = [] if html is None else write_files(Path(html).parent, {Path(html).name: shown.page()})
    if json:
        inputs = source.inputs(model.robot, recording=recording, diagnosis=diagnosis, columns=columns)
        Screen().write(to_json({**shown.document(), **provenance((), inputs, 0)}))
    elif html is None:
        _serve(shown, browser)
    else:
        Screen().write("\n".join([_told(shown), "", "written:", *(f"  {path}" for path in written), ""]))
    return DONE


def _check(html: str | None) -> None:
    from ...errors import OptionError
    from ...output.report import probe_folder

    if html is not None:
        if not html or Path(html).suffix.lower() not in (".html", ".htm"):
            raise OptionError(f"--html {html!r} is no name of a page; let it end in .html")
        probe_folder(Path(html).parent)


def _serve(shown: Replay, browser: bool) -> None:
    import webbrowser

    from ...output.report import Screen

    live = shown.show()
    Screen().write(f"{_told(shown)}\n\n{live.url} (Meshcat: {live.zmq_url}); Ctrl-C ends it\n")
    try:
        if browser:
            webbrowser.open(live.url)
        live.wait()
    except KeyboardInterrupt:
        pass
    finally:
        live.close()


def _told(shown: Replay) -> str:
    """What is shown, in a few lines."""
    t = shown.track.t
    frames = f"{len(t)} frames, {t[0]:.4g} to {t[-1]:.4g} s; simulated anew every {shown.horizon:g} s"
    marked = [f"marked: {mark.title}" for mark in shown.marks if mark.cause]
    return "\n".join([f"{shown.title}: {frames}", *marked, *(f"note: {note}" for note in shown.notes)])
