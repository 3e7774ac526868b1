"""The command `replay`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import OptionError
from ..app import Columns, Json, Mcap, Rate, RecordingName, Rrd, SimulationArguments, Text, command, option
from ..arguments import given_model, given_recordings, simulation_inputs
from ..terminal import DONE, check_unread

if TYPE_CHECKING:
    from ...output.replay import Replay

COMMANDS_NOTE = "simulation from the commands alone"


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """Content of the animation, and where it is shown."""

    diagnosis: Text = option(None, "diagnosis.json, with its model.json in the same folder.", metavar="FILE")
    html: Text = option(None, "Write one self-contained file instead of opening a viewer.", metavar="FILE")
    start: float = option(0.0, "Start time in the recording [s].", "--from", metavar="S")
    duration: float | None = option(None, "Length to show [s]. Default: all, at most 60.", metavar="S")
    horizon: float | None = option(
        None, "Time between restarts from the measured state [s]. Default: 0.5; with position drives none.", metavar="S"
    )
    fps: float = option(30.0, "Frames a second [Hz].", metavar="HZ")
    browser: bool = option(True, "Open the browser.", "--open/--no-open")
    columns: Columns = None
    rate: Rate = None
    rrd: Rrd = None
    mcap: Mcap = None


@command("signid replay 3r recording.csv --html replay.html")
def replay(shown: ReplayOptions, simulation: SimulationArguments, recording: RecordingName, json: Json = False) -> int:
    """Animate the recorded robot and its simulation in the browser.

    Opens a Meshcat viewer or writes one HTML file. The simulation appears as a ghost that restarts from the measured
    state at regular intervals and is driven by the recorded torque. The colour of a link shows the residual torque of
    its joint. With --diagnosis the findings are marked, and a switch shows the extended simulation.

    Position drives, recorded with q_des_J and without torque, are simulated from the commands alone; a second ghost
    shows the commanded positions, and colours show the error of the simulated position.

    --rrd and --mcap write torque, residuals, positions and findings as a log for other viewers.

    Raises:
        OptionError: the page has not the name of one.
    """
    from ...output.replay import DEFAULT_MAX_DURATION, part, replay as build
    from ...output.report import Screen, probe_folder, to_json, write_files
    from ...output.report.documents import provenance
    from ...output.viewers import viewer_log
    from ..terminal import check_logs, write_logs

    html, diagnosis = shown.html, shown.diagnosis
    if html is not None:
        if not html or Path(html).suffix.lower() not in (".html", ".htm"):
            raise OptionError(f"--html {html!r} is not the name of a page; use a name that ends in .html")
        probe_folder(Path(html).parent)
    logs = check_logs(rrd=shown.rrd, mcap=shown.mcap)
    if html is not None:
        given = [recording, diagnosis, shown.columns, simulation.simulation, simulation.actuators]
        check_unread(html, given, "--html")
    if diagnosis is not None and Path(diagnosis).is_dir():
        diagnosis = str(Path(diagnosis) / "diagnosis.json")
    model, _ = given_model(simulation)
    [read] = given_recordings([recording], model.robot, shown.columns, rate=shown.rate)
    built = build(
        model,
        read,
        diagnosis,
        start=shown.start,
        duration=shown.duration,
        horizon=shown.horizon,
        fps=shown.fps,
        package_dirs=simulation.package_dir or (),
    )
    log = None
    if logs:  # of the rows that are shown
        rows = part(read, shown.start, DEFAULT_MAX_DURATION if shown.duration is None else shown.duration)
        log = viewer_log(model, rows, shown.diagnosis, rolled=built.track)
    written = [] if html is None else write_files(Path(html).parent, {Path(html).name: built.page()}, named=True)
    written += [] if log is None else write_logs(log, logs)
    if json:
        files = {"recording": recording, "diagnosis": diagnosis, "columns": shown.columns}
        inputs = simulation_inputs(simulation, model.robot, **files)
        Screen().write(to_json({**built.document(), **provenance((), inputs, 0)}))
    elif not written:
        _serve(built, shown.browser)
    else:
        Screen().write("\n".join([_summary(built), "", "written:", *(f"  {path}" for path in written), ""]))
    return DONE


def _serve(shown: Replay, browser: bool) -> None:
    import webbrowser

    from ...output.report import Screen

    live = shown.show()
    Screen().write(f"{_summary(shown)}\n\n{live.url} (Meshcat: {live.zmq_url}); press Ctrl-C to stop\n")
    try:
        if browser:
            webbrowser.open(live.url)
        live.wait()
    except KeyboardInterrupt:
        pass
    finally:
        live.close()


def _summary(shown: Replay) -> str:
    """Content of the animation, in a few lines."""
    t = shown.track.t - shown.origin
    since = " since the start of the recording" if shown.origin else ""
    often = [] if shown.horizon is None else [f"restarted every {shown.horizon:g} s"]
    drive = f"simulation {often[0]}" if shown.commanded is None else ", ".join([COMMANDS_NOTE, *often])
    frames = f"{len(t)} frames, {t[0]:.4g} to {t[-1]:.4g} s{since}; {drive}"
    marked = [f"marked: {mark.title}" for mark in shown.marks if mark.cause]
    return "\n".join([f"{shown.title}: {frames}", *marked, *(f"note: {note}" for note in shown.notes)])
