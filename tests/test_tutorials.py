"""The tutorials run in any folder, and their statements about the arm are true."""

from __future__ import annotations

import re
import runpy
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signid
from signid.cli import run

HERE = Path(__file__).parents[1] / "robots" / "3r"
TUTORIALS = ("identify_my_arm", "no_torque_sign", "wrong_simulation")


@pytest.fixture
def run_tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Function that runs a tutorial in an empty folder and returns its variables and printed text."""

    def run_in_folder(name: str) -> tuple[dict[str, Any], str]:
        monkeypatch.chdir(tmp_path)
        return runpy.run_path(str(HERE / f"{name}.py")), capsys.readouterr().out

    return run_in_folder


def test_identify_my_arm(run_tutorial: Any, tmp_path: Path) -> None:
    names, printed = run_tutorial("identify_my_arm")
    result, truth = names["result"], tomllib.loads((HERE / "truth.toml").read_text())
    assert not result.flags and not names["checked"].flags and result.fit.held_out_r2.min() > 0.997
    for joint, numbers in names["friction"].items():
        assert numbers["level"] == pytest.approx(truth["joint"][joint]["coulomb_friction"], rel=0.01)
    assert set(names["friction"]) == set(truth["joint"])
    assert names["moment"] == pytest.approx(truth["link"]["link_3"]["first_moment"][0], rel=0.003)
    assert names["moment"] > 1.09 * names["stated"], "the URDF is 10 % off"
    assert "25 base parameters" in printed and f"{names['moment']:.4f} kg.m, truly 0.0825" in printed
    assert [path.name for path in tmp_path.iterdir()] == ["identified.urdf"]
    arm = signid.load_robot(tmp_path / "identified.urdf")
    mass = arm.model.inertias[3].mass
    assert mass * arm.model.inertias[3].lever[0] == pytest.approx(names["moment"], rel=1e-6)
    assert arm.actuators.coulomb_friction[0] == pytest.approx(names["friction"]["joint_1"]["level"], rel=1e-6)


def test_no_torque_sign(run_tutorial: Any, tmp_path: Path) -> None:
    names, printed = run_tutorial("no_torque_sign")
    assert len(names["right"]) > 30 and all(names["right"])
    assert f"{len(names['right'])} of {len(names['right'])} segments have their true sign" in printed
    assert names["signs"].is_certain() and names["signs"].proof.optimal
    assert names["change"].max() < 1, "standard deviations"
    assert np.allclose(names["result"].fit.held_out_r2, names["signed"].fit.held_out_r2, atol=1e-3)
    assert any("is not decided" in flag for flag in names["short"].flags), (
        "two seconds are too short, and a flag says so"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_wrong_simulation(run_tutorial: Any, tmp_path: Path) -> None:
    names, printed = run_tutorial("wrong_simulation")
    assert any("joint_3 does not follow" in flag for flag in names["checked"].flags)
    pair = r"\n  (spring|counterbalance) of joint_3.* probability (.*)\n    or (\w+), probability (.*?): (.*)"
    first = re.search(pair, printed)
    assert first and {first[1], first[3]} == {"spring", "counterbalance"}, "the first recording cannot distinguish them"
    assert max(float(first[2]), float(first[4])) < 0.9 and "signid excite ROBOT --separate" in first[5]
    assert names["apart"].enough
    surely = names["surely"]
    numbers = {f.law.effect.name: (f.law.joints, f.law.parameters, f.probability) for f in surely.causes}
    assert set(numbers) == {"counterbalance", "coulomb_friction"} and surely.verdict == "named"
    assert numbers["counterbalance"][0] == (2,) and numbers["coulomb_friction"][0] == (0,)
    assert numbers["counterbalance"][1]["amplitude"] == pytest.approx(0.5, rel=0.02)
    assert numbers["coulomb_friction"][1]["level"] == pytest.approx(0.5, rel=0.02)
    assert all(probability > 0.999 for *_, probability in numbers.values())
    assert np.all(names["after"] < 0.05 * names["before"]), "the extended simulation stays with the robot"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["extended.xml", "laws.py", "replay.html", "report.html"]
    assert "counterbalance" in (tmp_path / "report.html").read_text()
    page = (tmp_path / "replay.html").read_text()
    assert "counterbalance" in page and "Coulomb friction of joint_1" in page
    laws = runpy.run_path(str(tmp_path / "laws.py"))
    torque = laws["torque"](np.array([0, 0, 0.5]), np.array([1.0, 0, 0]), np.zeros(3))
    expected = [numbers["coulomb_friction"][1]["level"], 0, 0.5 * np.sin(0.5)]
    assert np.allclose(torque, expected, atol=2e-3)


@pytest.mark.parametrize("name", TUTORIALS)
def test_a_tutorial_is_short_and_its_commands_exist(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = (HERE / f"{name}.py").read_text()
    assert 60 <= len(text.splitlines()) <= 120
    assert all(word in text for word in ("# Step 1.", "# With your own robot", "columns.toml", "actuators.toml"))
    assert run(["--help"]) == 0
    commands = re.findall(r"^  (\w+)  ", capsys.readouterr().out.partition("Commands:")[2], re.MULTILINE)
    named = re.findall(r"signid (\w+) (?:3r|my_arm|diagnosis)", text)
    assert named and set(named) <= set(commands)
    for command, line in re.findall(r"signid (\w+) ((?:3r|my_arm|diagnosis).*)", text):
        assert run([command, "--help"]) == 0
        known = capsys.readouterr().out
        assert all(option in known for option in re.findall(r"--?[a-z][a-z-]*", line)), line
