"""`signid identify` and `signid validate` on recordings of commands and positions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from servo_loops import pendulum_log

from signid.cli import run
from signid.model import load_model, with_servos
from signid.servos import Servo
from signid.toml_json import check_schema

pytestmark = pytest.mark.usefixtures("inside")

TRUTH = Servo(kp=20.0, kd=0.8, delay=0.02, coulomb_friction=0.2, viscous_friction=0.1, armature=0.02)
RATE, SECONDS = 100.0, 12.0
HOSTILE = "held <b>out [red].csv"


def commands(seed: int) -> tuple[Any, Any]:
    """Stamps (N,) [s] and a smooth command (N,) [rad]."""
    t, rng = np.arange(int(RATE * SECONDS)) / RATE, np.random.default_rng(seed)
    waves = (np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) / (1 + f) for f in (0.3, 0.7, 1.3, 2.1))
    return t, 0.6 * np.asarray(sum(waves))


def recording(path: Path, seed: int, servo: Servo = TRUTH) -> Path:
    """A recording of the 1r with a drive, simulated from its commands."""
    return pendulum_log(path, servo, *commands(seed), seed)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with two recordings, the identification of one, and the true model."""
    folder = tmp_path_factory.mktemp("servo")
    recording(folder / "a.csv", 1)
    recording(folder / HOSTILE, 2)
    model = load_model("1r")
    with_servos(model, {model.robot.joints[0]: TRUTH}).save(folder / "truth.json")
    code = run(["identify", "1r", str(folder / "a.csv"), "--held-out", str(folder / HOSTILE), "-o", str(folder / "id")])
    assert code in (0, 3)
    return folder


def refused(capfd: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Sentence on standard error of a command that ends with 2."""
    capfd.readouterr()
    assert run(list(arguments)) == 2
    out, err = capfd.readouterr()
    assert not out and err.count("\n") == 1 and err.startswith("signid: "), err
    return err


def test_identify_writes_the_drive(place: Path) -> None:
    content = json.loads((place / "id" / "identification.json").read_text())
    check_schema(content, "identification")
    (joint,) = content["servo"]["joints"]
    for key, truth in (("kp", 20.0), ("damping", 0.9), ("delay", 0.02)):
        assert joint[key]["value"] == pytest.approx(truth, rel=0.2), key
    assert joint["effort_limit"]["value"] is None and joint["effort_limit"]["sentence"]
    assert content["servo"]["rollout"]["held_out"] and content["servo"]["rollout"]["whole_rms"][0] < 0.01
    assert load_model(place / "id" / "model.json").servos and (place / "id" / "robot.urdf").is_file()
    page = (place / "id" / "report.html").read_text()
    assert "held <b>out" not in page and "held &lt;b&gt;out" in page


def test_the_same_files_give_the_same_bytes(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["identify", "1r", "a.csv", "--held-out", HOSTILE]
    assert run([*arguments, "-o", "again"]) in (0, 3)
    for name in ("identification.json", "model.json"):
        assert (place / "again" / name).read_text() == (place / "id" / name).read_text().replace(f"{place}/", "")


def test_validate_runs_the_closed_loop(capfd: pytest.CaptureFixture[str]) -> None:
    capfd.readouterr()
    assert run(["validate", "truth.json", "id/model.json", HOSTILE, "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert [one["path"] for one in found["models"]] == ["truth.json", "id/model.json"]
    for one in found["models"]:
        rolled = one["rollout"]
        assert rolled["unit"] == ["rad"] and rolled["whole_rms"][0] < 0.01 < rolled["nominal_whole_rms"][0]
        assert rolled["one_second_rms"][0] < 0.01 and one["fit"]["held_out_rms"] == rolled["whole_rms"]
    assert run(["validate", "truth.json", HOSTILE, "-o", "v"]) == 0
    assert "held <b>out" not in Path("v/report.html").read_text()


def test_firmware_gains_scale_the_stiffness(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    model = load_model("1r")
    (joint,) = model.robot.joints
    with_servos(model, {joint: TRUTH.with_(kp=10.0, kp_register=100.0)}).save("register.json")
    Path("gains.toml").write_text(f'[recording."a.csv".{joint}]\nkp_register = 200\n')
    capfd.readouterr()
    assert run(["validate", "register.json", "a.csv", "--actuators", "gains.toml", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["models"][0]["rollout"]["whole_rms"][0] < 0.01


TORQUE = str(Path(__file__).parents[1] / "robots" / "3r" / "recording.parquet")
IDENTIFY = ("identify", "1r", "a.csv", "-o", "refused")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*IDENTIFY, "--known", "magic"), "magic"),
        ((*IDENTIFY, "--known", "kp=-1"), "kp=-1"),
        ((*IDENTIFY, "--known", "kp"), "no kp is stated"),
        ((*IDENTIFY, "--known", "kp.nowhere=20"), "nowhere"),
        ((*IDENTIFY, "--known", "kp.1=nan"), "kp.1=nan"),
        ((*IDENTIFY, "--known", "masses", "--known", "kp=20"), "--known"),
        ((*IDENTIFY, "--law", "magnetic"), "magnetic"),
        ((*IDENTIFY, "--law", "elbow=duty"), "1r has no joint 'elbow' that moves by itself"),
        ((*IDENTIFY, "--law", "duty", "--law", "effort"), "--law"),
        ((*IDENTIFY, "--method", "wls"), "--method"),
        ((*IDENTIFY, "--unsigned"), "--unsigned"),
        (("identify", "3r", TORQUE, "-o", "refused", "--known", "masses"), "--servo"),
        (("identify", "3r", TORQUE, "--json", "--bounds", "kp=5..30"), "'kp=5..30' applies to position drives"),
        (("identify", "3r", TORQUE, "--json", "--compare-models"), "--compare-models applies to position drives"),
        (("identify", "3r", TORQUE, "--servo", "--json"), "--servo needs commanded positions"),
        (("validate", "1r", "a.csv"), "no drive of"),
    ],
    ids=str,
)
def test_wrong_options_are_refused(arguments: tuple[str, ...], words: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert words in refused(capfd, *arguments)
    assert not Path("refused").exists()


BAD = {
    "nan": lambda table: table.with_columns(pl.lit(float("nan")).alias("q_des")),
    "zero": lambda table: table.with_columns(pl.lit(0.0).alias("q_des")),
    "one row": lambda table: table.head(1),
    "short": lambda table: table.head(50),
    "off": lambda table: table.with_columns(pl.lit(0.0).alias("on")),
    "still": lambda table: table.with_columns(pl.lit(0.3).alias("q"), pl.lit(0.3).alias("q_des")),
}


@pytest.mark.parametrize("fault", BAD, ids=str)
def test_bad_recordings_are_refused_in_one_sentence(fault: str, capfd: pytest.CaptureFixture[str]) -> None:
    (joint,) = load_model("1r").robot.joints
    names = {f"{key}_{joint}": key for key in ("q", "q_des")}
    table = BAD[fault](pl.read_csv("a.csv").rename(names))
    table.rename({key: f"{key}_{joint}" for key in table.columns if key != "t"}).write_csv("bad.csv")
    assert "bad.csv" in refused(capfd, "identify", "1r", "bad.csv", "-o", "refused")
    if fault not in ("zero", "short", "still"):
        refused(capfd, "validate", "truth.json", "bad.csv")


def test_servo_mode_beside_torque_is_forced(capfd: pytest.CaptureFixture[str]) -> None:
    (joint,) = load_model("1r").robot.joints
    pl.read_csv("a.csv").with_columns(pl.lit(0.5).alias(f"tau_{joint}")).write_csv("torque.csv")
    capfd.readouterr()
    assert run(["identify", "1r", "torque.csv", "--servo", "--known", "kp=20", "--json"]) in (0, 3)
    (one,) = json.loads(capfd.readouterr().out)["servo"]["joints"]
    assert one["kp"]["stated"] == 20.0 and one["kp"]["std"] is None


def test_currents_without_a_constant_give_way_to_commands(capfd: pytest.CaptureFixture[str]) -> None:
    (joint,) = load_model("1r").robot.joints
    table = pl.read_csv("a.csv")
    noise = np.random.default_rng(3).normal(size=len(table))  # nothing gives the constant of such a current
    table.with_columns(pl.Series(f"current_{joint}", noise)).write_csv("current.csv")
    capfd.readouterr()
    known = ["--known", "kp=20"]
    assert run(["identify", "1r", "current.csv", *known, "--json"]) == 2, "an option of drives needs --servo"
    assert run(["identify", "1r", "current.csv", "--json"]) in (0, 3)
    content = json.loads(capfd.readouterr().out)
    assert content["servo"]["joints"][0]["joint"] == joint
    assert any(note.startswith("position drives are identified from q_des_J") for note in content["notes"])
    assert "remove --no-instruments" in refused(capfd, "identify", "1r", "current.csv", "--json", "--no-instruments")


def test_a_gain_of_one_joint_sets_the_scale(capfd: pytest.CaptureFixture[str]) -> None:
    capfd.readouterr()
    assert run(["identify", "1r", "a.csv", "--known", "kp.1=20", "--law", "effort", "--json"]) in (0, 3)
    (one,) = json.loads(capfd.readouterr().out)["servo"]["joints"]
    assert one["kp"]["stated"] == 20.0 and one["law_probability"] is None
