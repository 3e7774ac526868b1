"""Replay of position drives: recorded robot, simulation from the commands alone, and a ghost at the commands."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from chromium import Chromium, changed
from servo_loops import SWING, driven

import signid
from signid.cli import run
from signid.errors import OptionError
from signid.output.replay import Replay
from signid.servo.plant import roll_out, servo_grid

DRIVES = {"joint_2": SWING.with_(kp=300.0, kd=20.0, coulomb_friction=1.0), "joint_3": SWING.with_(kp=80.0, kd=5.0)}
AREA = slice(60, 420), slice(320, 990)  # of the window: clear of cards, switches and curves


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model with two drives and a recording of others."""
    place = tmp_path_factory.mktemp("replay")
    saved = driven("3r", DRIVES).save(place / "model.json")
    other = ["--inject", "servo@joint_2:kp=150,delay=0.05", "--inject", "coulomb_friction@joint_3:level=2"]
    assert run(["simulate", str(saved), "--servo", "--duration", "6", *other, "-o", str(place / "x.csv")]) == 0
    return place


@pytest.fixture(scope="module")
def shown(folder: Path) -> Replay:
    return signid.replay(str(folder / "model.json"), str(folder / "x.csv"))


def test_the_simulation_follows_the_commands_alone(folder: Path, shown: Replay) -> None:
    model = signid.load_model(folder / "model.json")
    grid = servo_grid(signid.read_recording(folder / "x.csv", model.robot), model.robot)
    expected = roll_out(model, model.servos, grid)
    track = shown.track
    t = np.arange(len(grid)) * grid.step
    assert track.command is not None and shown.commanded is not None and shown.horizon is None
    for j in (1, 2):
        np.testing.assert_allclose(track.simulated[0, :, j], np.interp(track.t, t, expected[:, j]), atol=1e-9)
        assert set(np.round(track.command[:, j], 9)) <= set(np.round(grid.command[:, j], 9)), "commands are held"
    assert np.isnan(track.command[:, 0]).all() and np.isnan(track.residual[0, :, 0]).all(), "joint_1 has no drive"
    assert 0.01 < np.abs(track.residual[0, :, 1]).max() < 1
    np.testing.assert_array_equal(shown.recorded.shape, shown.commanded.shape)


def test_roll_outs_can_restart(folder: Path, shown: Replay) -> None:
    short = signid.replay(str(folder / "model.json"), str(folder / "x.csv"), horizon=0.1)
    assert np.nanstd(short.track.residual) < 0.5 * np.nanstd(shown.track.residual)
    assert short.track.window.max() in (59, 60)


def test_the_command_writes_a_page_and_a_document(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["replay", str(folder / "model.json"), str(folder / "x.csv"), "--html", str(folder / "page.html")]
    assert run(command) == 0
    assert "simulation from the commands alone" in capsys.readouterr().out
    assert run([*command, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["horizon"] is None and "torque_unit" not in document
    assert document["command_rms"][0] is None and document["command_rms"][1] > 0.01


def test_a_model_without_the_drives_is_refused(folder: Path) -> None:
    with pytest.raises(OptionError, match="3r has no position drive of joint_2, joint_3"):
        signid.replay("3r", str(folder / "x.csv"))
    with pytest.raises(OptionError, match="horizon"):
        signid.replay(str(folder / "model.json"), str(folder / "x.csv"), horizon=0.0)


def test_findings_of_a_diagnosis_stand_at_their_joints(folder: Path) -> None:
    place = folder / "diagnosis"
    place.mkdir()
    driven("3r", {**DRIVES, "joint_2": DRIVES["joint_2"].with_(kp=150.0, delay=0.05)}).save(place / "model.json")
    finding = {"effect": "command_delay", "joint": "joint_2", "role": "cause", "probability": 0.9999}
    finding["parameters"] = {"delay": {"value": 0.05, "std": 0.001, "unit": "s"}}
    content = {"schema": "signid.diagnosis/1", "verdict": "named", "findings": [finding]}
    (place / "diagnosis.json").write_text(json.dumps(content))
    made = signid.replay(str(folder / "model.json"), str(folder / "x.csv"), place)
    (mark,) = made.marks
    assert (mark.title, mark.joints, mark.kind) == ("Command delay of joint_2", ("joint_2",), "joint")
    assert mark.lines == ("delay 0.0500 ± 0.0020 s", "probability >0.999")
    before, after = (np.nanstd(x[:, 1]) for x in made.track.residual)
    assert after < 0.2 * before and made.headline == "Missing or wrongly stated: command delay of joint_2."


@pytest.fixture(scope="module")
def page(folder: Path, shown: Replay) -> Iterator[Chromium]:
    (folder / "replay.html").write_text(shown.page(), encoding="utf-8")
    window = Chromium(folder / "profile")
    window.open(f"{(folder / 'replay.html').as_uri()}#t=3&joint=2&curves=1", "window.player")
    yield window
    window.close()


@pytest.mark.slow
def test_the_ghosts_are_drawn_and_can_be_hidden(page: Chromium) -> None:
    seen = page.picture()
    page.click("#show-commanded")
    without = page.picture()
    page.click("#show-simulated")
    assert changed(AREA, seen, without) > 50 < changed(AREA, without, page.picture())
    page.click("#show-commanded")
    page.click("#show-simulated")
    assert page.errors == [] and page.requests == [request for request in page.requests if request.startswith("file:")]


@pytest.mark.slow
def test_the_curves_show_command_measured_and_simulated(page: Chromium) -> None:
    words = page.value("document.querySelector('#key').textContent")
    assert all(word in words for word in ("measured", "simulated", "command", "rad"))
    assert "position: measured \u2212 simulated" in page.value("document.querySelector('figcaption').textContent")
    assert page.value("document.querySelector('#torque-axis').textContent").count("command \u2212 position [rad]") == 1
