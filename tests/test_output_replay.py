"""The replay as data (motion, roll-out, colours, shapes and marks), its command, and its server."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import numpy as np
import pytest
from diagnosis_file import write_diagnosis
from numpy.testing import assert_allclose

import signid
from signid.cli import run
from signid.output.replay import Live, Replay, part
from signid.output.report.layout import content_policy
from signid.robot import load_robot
from signid.simulation.rollout import RollOut
from signid.types import Recording

LAWS = ("coulomb_friction@2:level=0.8", "payload:mass=0.3,first_moment_x=0.03")
CONTACT = "external_contact:force_x=1,force_y=2,force_z=-3,start=2,end=3"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of an arm with friction and a payload, its diagnosis, and one without signs."""
    place = tmp_path_factory.mktemp("replay")
    laws = [word for law in (*LAWS, CONTACT) for word in ("--inject", law)]
    assert run(["simulate", "3r", *laws, *"--seed 3 --duration 6 -o".split(), str(place / "arm.csv")]) == 0
    assert run(["simulate", "3r", *"--unsigned --duration 2 -o".split(), str(place / "lost.csv")]) == 0
    write_diagnosis(place, "3r", (*LAWS, CONTACT))
    return place


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


@pytest.fixture(scope="module")
def recording(folder: Path) -> Recording:
    return signid.read_recording(folder / "arm.csv", load_robot("3r"))


@pytest.fixture(scope="module")
def shown(folder: Path, recording: Recording) -> Replay:
    return signid.replay(signid.load_model("3r"), recording, folder / "diagnosis.json")


def test_the_recorded_robot_is_where_it_was(shown: Replay, recording: Recording) -> None:
    samples, track = recording.read(), shown.track
    assert_allclose(np.diff(track.t), 1 / 30)
    for j in range(3):
        assert_allclose(track.recorded[:, j], np.interp(track.t, samples.t, samples.q[:, j]), atol=1e-9)
    third, q2 = shown.bodies.index(3), track.recorded[:, 1]
    out, place = 0.3 * np.cos(q2) + 0.09j, shown.recorded[:, third]  # the elbow is 0.09 m beside the arm's plane
    assert_allclose(place[:, 2], 0.3 + 0.3 * np.sin(q2), atol=1e-9)
    assert_allclose(np.hypot(place[:, 0], place[:, 1]), np.abs(out), atol=1e-9)


def test_the_simulated_robot_strays_as_rolled_out(shown: Replay, recording: Recording) -> None:
    track, model = shown.track, signid.load_model("3r")
    error = track.simulated - track.recorded
    assert track.simulated.shape == (2, *track.recorded.shape) and np.isnan(error[:, track.window < 0]).all()
    starts = np.flatnonzero(np.diff(track.window) > 0) + 1
    assert 10 <= len(starts) <= 12, "a roll-out every half second"
    assert np.abs(error[0][starts[1:]]).max() < 0.1 * np.nanmax(np.abs(error[0]))
    found = signid.roll_out(model, recording, (0.5,), windows=12, step=2e-3)
    ends = np.abs(error[0][starts[1:] - 1])
    assert_allclose(np.sqrt(np.mean(ends**2, axis=0)), found.rms(0.45), rtol=0.35)
    assert np.nanmax(np.abs(error[1])) < 0.2 * np.nanmax(np.abs(error[0])), "with what it lacked"


def test_the_residual_is_the_torque_that_is_missing(recording: Recording) -> None:
    model = signid.load_model("3r")
    plain = signid.replay(model, recording).track
    rows = recording.read()
    speed = np.interp(plain.t, rows.t, np.gradient(rows.q[:, 1], rows.t))
    bodies = signid.replay(signid.load_model("3r"), recording, "diagnosis.json").track.residual
    moving = (np.abs(speed) > 0.5) & np.isfinite(plain.residual[0]).all(axis=1)
    assert plain.residual.shape[0] == 1 and np.sqrt(np.mean(bodies[1][moving] ** 2)) < 0.05
    assert np.corrcoef(plain.residual[0][moving, 1], np.sign(speed[moving]))[0, 1] > 0.6
    assert_allclose(plain.torque, np.sqrt(np.mean(rows.tau**2, axis=0)))


def test_findings_are_marked(shown: Replay) -> None:
    marks = {mark.kind: mark for mark in shown.marks}
    assert marks["joint"].title == "Coulomb friction of joint_2: 0.800 ± 0.002 N.m" and marks["joint"].body == 2
    assert marks["joint"].lines == ("level 0.8000 ± 0.0020 N.m", "probability >0.999")
    assert_allclose(marks["body"].point, (0.1, 0, 0))
    assert "centre of mass at 100, 0, 0 mm in the joint frame" in marks["body"].lines
    assert_allclose(marks["body"].size, (3 * 0.3 / (4 * np.pi * 3000)) ** (1 / 3))
    assert marks["force"].time == (2.0, 3.0) and marks["force"].along == (-1.0, -2.0, 3.0), "what pushes the robot"
    assert_allclose(marks["force"].point, (0.1, 0, 0), err_msg="the centre of mass of the last link")


def test_a_diagnosis_is_shown_as_its_files() -> None:
    made = "simulate 1r --inject coulomb_friction@1:level=0.5 --seed 1 --duration 6 -o swing.csv"
    assert run(made.split()) == 0 and run("diagnose 1r swing.csv -o real".split()) in (0, 3)
    model = signid.load_model("1r")
    recording = signid.read_recording("swing.csv", model.robot)
    found = signid.diagnose(model, [recording])
    given = found, "real/diagnosis.json", Path("real")
    pages = [signid.replay(model, recording, each).page() for each in given]
    assert pages[0] == pages[1] == pages[2] and "Coulomb friction of " in pages[0] and found.causes


def test_a_part_of_a_recording(recording: Recording) -> None:
    cut = part(recording, 1.0, 2.0)
    assert_allclose(cut.read().t[[0, -1]], (1.0, 3.0))
    assert_allclose(cut.read().q, recording.read(250, 751).q)
    assert part(recording, 0.0, 100.0) is recording
    shown = signid.replay(signid.load_model("3r"), recording, start=1.0, duration=2.0, fps=10.0)
    assert_allclose(shown.track.t, 1 + 0.1 * np.arange(21))


def test_pages_are_whole_and_the_same_every_time(shown: Replay, recording: Recording) -> None:
    again = signid.replay(signid.load_model("3r"), recording, "diagnosis.json")
    page = shown.page()
    assert page == again.page() and "%%" not in page and 0.9e6 < len(page) < 1.5e6
    assert 'src="' not in page and '<link rel="stylesheet' not in page and page.count("</script>") == 4


def test_joints_that_are_not_recorded_are_held_and_names_do_no_harm(recording: Recording) -> None:
    rows, robot = recording.read(), load_robot("3r")
    columns = {"t": rows.t, "q_1": rows.q[:, 0], "tau_1": rows.tau[:, 0]}
    shown = signid.replay(signid.load_model("3r"), replace(signid.read_recording(columns, robot), path="<b>&.csv"))
    assert shown.robot.joints == ("joint_1",) and shown.movers == (0, 0, 0), "all that it carries has its colour"
    assert "<b>" not in shown.page() and "&lt;b&gt;&amp;.csv" in shown.page()


def test_torque_that_is_not_recorded_has_no_colour(recording: Recording) -> None:
    rows = recording.read()
    columns = {"t": rows.t, **{f"q_{j + 1}": rows.q[:, j] for j in range(3)}, "tau_2": rows.tau[:, 1]}
    track = signid.replay(signid.load_model("3r"), signid.read_recording(columns, load_robot("3r"))).track
    assert np.isnan(track.residual[0][:, [0, 2]]).all() and np.isfinite(track.residual[0][20:-20, 1]).all()
    error = (track.simulated[0] - track.recorded)[track.window >= 0]
    assert np.abs(error[:, 1]).max() > 0.01 and not error[:, [0, 2]].any(), "it follows what was measured"


def test_a_simulation_that_flies_apart_is_shown_as_far_as_it_goes(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    def flying(*given: Any, **options: Any) -> RollOut:
        found = signid.roll_out(*given, **options)
        error = found.error.copy()
        error[3, 60:, 2] = error[5, 60:] = np.inf
        return replace(found, error=error)

    model = signid.load_model("3r")
    calm = signid.replay(model, recording).track
    monkeypatch.setattr(sys.modules["signid.output.replay.track"], "roll_out", flying)
    wild = signid.replay(model, recording).track
    for window, partly in ((3, True), (5, False)):
        lost = (wild.window == window) & wild.apart[0]
        assert 3 < lost.sum() < 12 and np.isfinite(wild.simulated[0][lost]).all() == partly
        assert partly or np.isnan(wild.simulated[0][lost]).all()
    assert_allclose(wild.simulated[0][:, :2][wild.window == 3], calm.simulated[0][:, :2][wild.window == 3])
    assert not wild.apart[0][np.isin(wild.window, [3, 5], invert=True)].any() and not calm.apart.any()


def test_the_command_writes_the_page(shown: Replay, capfd: pytest.CaptureFixture[str]) -> None:
    assert run("replay 3r arm.csv --diagnosis diagnosis.json --html deep/er/replay.html".split()) == 0
    out, err = capfd.readouterr()
    assert out.endswith("\nwritten:\n  deep/er/replay.html\n") and not err
    assert "marked: Coulomb friction of joint_2: 0.800 ± 0.002 N.m" in out and out.startswith(
        "3r: arm.csv: 180 frames, 0 to 5.967 s"
    )
    assert Path("deep/er/replay.html").read_text() == shown.page()
    assert run("replay model.json arm.csv --duration 2 --html saved.html".split()) == 0
    capfd.readouterr()
    assert run("replay 3r arm.csv --diagnosis diagnosis.json --json".split()) == 0
    document = json.loads(capfd.readouterr().out)
    assert (document["schema"], document["frames"], document["joints"][1]) == ("signid.replay/1", 180, "joint_2")
    assert document["residual_rms"][1][1] < 0.2 * document["residual_rms"][0][1]
    assert document["strayed_rms"][1][1] < 0.05
    assert [x["path"] for x in document["inputs"]] == ["3r", "arm.csv", "diagnosis.json"]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("3r none.csv --html a.html", "none.csv"),
        ("3r arm.csv --html a.txt", "use a name that ends in .html"),
        ("3r arm.csv --html arm.csv/a.html", "arm.csv is a file"),
        ("3r lost.csv --html a.html", "no sign"),
        ("3r arm.csv --diagnosis none.json --html a.html", "none.json"),
        ("3r arm.csv --diagnosis model.json --html a.html", "signid.model/1"),
        ("3r arm.csv --diagnosis arm.csv --html a.html", "not a diagnosis.json"),
        ("3r arm.csv --diagnosis alone/diagnosis.json --html a.html", "no model.json next to"),
        ("3r arm.csv --diagnosis other/diagnosis.json --html a.html", "the diagnosis is of 1r"),
        ("3r arm.csv --diagnosis broken/diagnosis.json --html a.html", "is not a diagnosis.json"),
        ("3r arm.csv --from 9 --html a.html", "start earlier"),
        ("3r arm.csv --duration -1 --html a.html", "cannot be shown"),
        ("3r arm.csv --fps 0 --html a.html", "0 frames a second"),
        ("3r arm.csv --horizon 0 --html a.html", "horizon"),
        ("3r arm.csv --horizon 20 --html a.html", "shorter horizons"),
        ("model.json arm.csv --lock 1=0 --html a.html", "states its joints"),
    ],
)
def test_bad_input_is_a_sentence(command: str, words: str, capfd: pytest.CaptureFixture[str]) -> None:
    for name in ("alone", "other", "broken"):
        Path(name).mkdir(exist_ok=True)
    Path("alone/diagnosis.json").write_text("{}")
    write_diagnosis(Path("other"), "1r", ("spring@1",))
    write_diagnosis(Path("broken"), "3r", LAWS)
    document = json.loads(Path("broken/diagnosis.json").read_text())
    del document["findings"][0]["parameters"]
    Path("broken/diagnosis.json").write_text(json.dumps(document))
    assert run(["replay", *command.split()]) == 2
    out, err = capfd.readouterr()
    assert words in err and err.count("\n") == 1 and not out and not Path("a.html").exists()


def test_the_command_serves_the_page_until_it_is_interrupted(shown: Replay, folder: Path) -> None:
    command = [sys.executable, "-m", "signid", "replay", "3r", "arm.csv", "--diagnosis", "diagnosis.json", "--no-open"]
    there = {**os.environ, "PYTHONPATH": str(Path(signid.__file__).parents[1]), "PYTHONUNBUFFERED": "1"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, cwd=folder, text=True, env=there, **pipes) as served:  # type: ignore[call-overload]
        address = next(line for line in served.stdout if line.startswith("http")).split()[0]
        with urlopen(address, timeout=60) as answer:
            page = shown.page().replace("<body>", '<body class="live">')
            host = urlsplit(address).netloc
            assert answer.read().decode() == page.replace("connect-src 'none'", f"connect-src ws://{host}")
        served.send_signal(signal.SIGINT)
        assert served.wait(60) == 0 and served.stderr.read() == ""


PAGE = f'<html><head><meta content="{content_policy(["a"])}"></head><body></body></html>'


@pytest.fixture(scope="module")
def live() -> Iterator[Live]:
    served = Live(PAGE)
    yield served
    served.close()


def test_the_page_connects_to_its_own_server_only(live: Live) -> None:
    for name in ("127.0.0.1", "localhost"):
        host = f"{name}:{urlsplit(live.url).port}"
        with urlopen(f"http://{host}/replay", timeout=60) as answer:
            text = answer.read().decode()
            assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
        assert f"connect-src ws://{host};" in text and '<body class="live">' in text


def test_other_addresses_of_the_machine_do_not_answer(live: Live) -> None:
    port = urlsplit(live.url).port
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", port), timeout=5):
        pass


@pytest.mark.parametrize("path", ["replay", "static/main.min.js", ""])
@pytest.mark.parametrize("host", ["example.com:7000", "localhost.example.com", "localhost;script-src *"])
def test_a_request_under_a_foreign_name_is_refused(live: Live, path: str, host: str) -> None:
    """A web page that resolves its own name to this machine cannot read the replay."""
    with pytest.raises(HTTPError, match="404|400"):
        urlopen(Request(live.url.replace("replay", path), headers={"Host": host}), timeout=60)
