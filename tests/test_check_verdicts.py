"""`signid check` ends with 0 or 3 on every file that it can open: what is wrong is its verdict, not a refusal."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from swing import csv, pristine, swing

import signid.check  # noqa: F401
from signid.cli import run

T, Q, TAU = pristine().values()
UNUSABLE = {  # samples, words of the reason, words of what to correct
    "no position": (csv(swing(q_1=None)), "no position column", "column map"),
    "no torque": (csv(swing(tau_1=None)), "no torque of a joint", "add columns such as tau_1"),
    "foreign names": (csv({"Zeit": T, "Achse1": Q, "Kraft": TAU}), "no column 't' of time", "name it in a column map"),
    "no samples": ("t,q_1,tau_1\n", "no samples", "record the robot in motion"),
    "one sample": (csv({"t": T[:1], "q_1": Q[:1], "tau_1": TAU[:1]}), "a single sample", "a few seconds"),
    "too short": (csv({name: x[:30] for name, x in swing().items()}), "too short", "at least 20"),
    "no motion": (csv(swing(q_1=0 * Q + 0.3)), "no joint moves", "record the robot in motion"),
    "no value of a position": (csv(swing(q_1=np.nan * Q)), "has no values", "fill it or remove it"),
    "no value of a torque": (csv(swing(tau_1=np.nan * TAU)), "has no values", "fill it or remove it"),
    "milliseconds": (csv(swing(t=1e3 * T)), "cannot be seconds", '[units] t = "ms"'),
    "one time": (csv(swing(t=0 * T)), "time does not change", "increase from row to row"),
    "time runs back": (csv(swing(t=T[::-1])), "goes back at every row", "increase from row to row"),
    "absolute torque zero": (csv(swing(tau_1=None, abs_tau_1=0 * TAU)), "zero throughout", "record the torque"),
}
REFUSED = {  # what is no recording, or no option
    "empty file": ("", "check 1r log.csv", "empty"),
    "no text": ("\0\1\2", "check 1r log.csv", "binary"),
    "no file": ("", "check 1r none.csv", "does not exist"),
    "option": (csv(swing()), "check 1r log.csv --cutoff -3", "cut-off"),
    "no column map": (csv(swing()), "check 1r log.csv --columns none.toml", "column map none.toml cannot be read"),
    "robot": (csv(swing()), "check 1r log.csv --joints elbow", "elbow"),
}


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", UNUSABLE)
def test_what_is_wrong_with_a_file_is_the_verdict(name: str, place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    content, reason, remedy = UNUSABLE[name]
    (place / "log.csv").write_text(content)
    assert run(shlex.split("check 1r log.csv -o out")) == 3
    out, err = capfd.readouterr()
    screen = " ".join(out.split())
    assert screen.startswith("1r: 1 recording Not usable for identification") and reason in screen
    assert len(err.splitlines()) == 1 and reason in err and remedy in err
    document = json.loads((place / "out/check.json").read_text())
    found = signid.check("1r", "log.csv")
    assert isinstance(found, signid.faults.UnusableRecordings) and reason in found.flags[0]  # in Python, too
    assert document["schema"] == "signid.check/1" and document["verdict"] == "unusable"
    assert document["flags"] == [err.strip().removeprefix("signid: ")] and reason in document["headline"]
    assert [entry["role"] for entry in document["inputs"]] == ["recording", "description"]
    assert reason in (place / "out/report.html").read_text().replace("&#39;", "'").replace("&quot;", '"')


def test_commands_alone_need_no_robot_to_be_judged(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (place / "log.csv").write_text(csv({"t": T, "q_1": Q}))
    assert run(["check", "log.csv", "--json"]) == 3
    document = json.loads(capfd.readouterr().out)
    assert document["robot"] is None and "q_des_J" in document["flags"][0]
    assert document["recordings"] == [{"path": "log.csv", "rows": len(T)}]


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_opened_and_bad_options_are_refused(
    name: str, place: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    content, command, words = REFUSED[name]
    (place / "log.csv").write_text(content)
    assert run(shlex.split(command)) == 2
    out, err = capfd.readouterr()
    assert not out and len(err.splitlines()) == 1 and words in err


@pytest.mark.parametrize("error", [np.linalg.LinAlgError("singular"), OverflowError("too large")])
def test_numbers_without_a_result_are_a_verdict(
    error: Exception, place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    (place / "log.csv").write_text(csv(swing()))
    monkeypatch.setattr(sys.modules["signid.check"], "prepare_and_recover", fail)
    assert run(["check", "1r", "log.csv"]) == 3
    assert str(error) in capfd.readouterr().err


def test_a_constant_that_nothing_shows_is_a_fault_of_its_joint_alone(
    place: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A current that no motion of its joint explains; the other joint, in N.m, is judged as without that column."""
    rng = np.random.default_rng(0)
    noise = 1 + 0.1 * rng.standard_normal(len(T))
    (place / "both.csv").write_text(csv({"t": T, "q_1": Q, "q_2": 0.5 * np.sin(T), "tau_1": TAU, "current_2": noise}))
    (place / "one.csv").write_text(csv({"t": T, "q_1": Q, "q_2": 0.5 * np.sin(T), "tau_1": TAU}))
    found = {}
    for name in ("both", "one"):
        assert run(["check", "3r", f"{name}.csv", "--joints", "1,2", "--json"]) in (0, 3)
        found[name] = json.loads(capfd.readouterr().out)
    lost = [flag for flag in found["both"]["flags"] if "torque constant of joint_2 is not known" in flag]
    assert len(lost) == 1 and lost[0] == found["both"]["faults"][0]["sentence"]
    assert found["both"]["base_parameters"] == found["one"]["base_parameters"]
    assert [flag for flag in found["both"]["flags"] if flag not in lost] == found["one"]["flags"]
    (place / "alone.csv").write_text(csv({"t": T, "q_2": 0.5 * np.sin(T), "current_2": noise}))
    assert run(["check", "3r", "alone.csv", "--json"]) == 3
    alone = json.loads(capfd.readouterr().out)
    assert alone["verdict"] == "unusable" and "torque_constant" in alone["flags"][0]


def test_in_python_a_constant_that_nothing_shows_is_a_fault_of_its_joint_as_well() -> None:
    robot = signid.load_robot("3r", joints=["1", "2"])
    columns = {"t": T, "q_1": Q, "q_2": 0.5 * np.sin(T), "tau_1": TAU}
    noise = 1 + 0.1 * np.random.default_rng(0).standard_normal(len(T))
    found = signid.check(robot, signid.read_recording(columns | {"current_2": noise}, robot))
    one = signid.check(robot, signid.read_recording(columns, robot))
    lost = [flag for flag in found.flags if "torque constant of joint_2 is not known" in flag]
    assert len(lost) == 1 and found.verdicts == one.verdicts
    assert [flag for flag in found.flags if flag not in lost] == list(one.flags)
