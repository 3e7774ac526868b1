"""The command `signid diagnose`."""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from strict_json import strict

import signid
from signid.cli import run

pytestmark = pytest.mark.usefixtures("inside")

SENSORS = "--noise 0.02 --encoder-bits 17".split()
FILES = ["diagnosis.json", "model.json", "report.html", "robot.urdf"]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with recordings: of an arm with friction at one joint, and of a healthy pendulum."""
    folder = tmp_path_factory.mktemp("diagnose")
    law = ["--inject", "coulomb_friction@2:level=0.8"]
    made = ("3r", "arm.csv", ["--seed", "3", *law]), ("1r", "fine.csv", ["--duration", "8", "--seed", "1"])
    for robot, name, more in made:
        assert run(["simulate", robot, "-o", str(folder / name), *SENSORS, *more]) == 0
    return folder


def read(path: str | Path) -> Any:
    return strict(Path(path).read_text())


def causes(document: Any) -> list[tuple[str, str]]:
    return [(x["effect"], x["joint"]) for x in document["findings"] if x["role"] == "cause"]


@pytest.fixture(scope="module")
def arm(place: Path) -> tuple[int, Any]:
    """Exit code and document of the arm's diagnosis."""
    code = run(["diagnose", "3r", str(place / "arm.csv"), "-o", str(place / "arm")])
    return code, read(place / "arm" / "diagnosis.json")


@pytest.mark.slow
def test_injected_laws_are_named_and_modelled(place: Path, arm: tuple[int, Any]) -> None:
    code, found = arm
    assert sorted(path.name for path in (place / "arm").iterdir()) == FILES
    assert found["verdict"] == "named" and causes(found) == [("coulomb_friction", "joint_2")]
    assert code == (3 if found["flags"] else 0)
    level = found["findings"][0]["parameters"]["level"]
    assert level["value"] == pytest.approx(0.8, rel=0.05) and level["unit"] == "N.m"
    digest = sha256((place / "arm.csv").read_bytes()).hexdigest()
    assert digest in [entry["sha256"] for entry in found["inputs"]] and "3r" in [x["path"] for x in found["inputs"]]
    model = signid.load_model(place / "arm" / "model.json")
    (law,) = model.laws
    assert (law.effect.name, law.joints, law.parameters["level"]) == ("coulomb_friction", (1,), level["value"])
    urdf = (place / "arm" / "robot.urdf").read_text()
    changed = set(urdf.splitlines()) - set(signid.load_robot("3r").document.splitlines())
    changed.remove("<!-- written by signid -->")
    assert len(changed) == 1 and f'friction="{level["value"]!r}"' in changed.pop()
    before, after = (np.array(found["fit"][when]["held_out_rms"]) for when in ("before", "after"))
    assert after[1] < 0.2 * before[1] and np.all(after < 1.01 * before)


def test_the_extended_simulation_is_diagnosed_and_simulates(place: Path, arm: tuple[int, Any]) -> None:
    assert run(["diagnose", "arm/model.json", "arm.csv", "-o", "again"]) in (0, 3)
    assert causes(read("again/diagnosis.json")) == []
    assert run("simulate arm/model.json --duration 1 -o simulated.csv".split()) == 0


def test_json_is_the_file_and_the_same_every_time(capfd: pytest.CaptureFixture[str]) -> None:
    for name in ("one", "two"):
        capfd.readouterr()
        assert run(["diagnose", "1r", "fine.csv", "-o", name, "--json", "--seed", "4"]) == 0
        assert capfd.readouterr().out == Path(name, "diagnosis.json").read_text()
    found = read("one/diagnosis.json")
    assert found["seed"] == 4 and found["verdict"] == "nothing_missing"
    for name in FILES:
        assert Path("one", name).read_bytes() == Path("two", name).read_bytes(), name


def test_options_reach_the_library(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (place / "drive.toml").write_text("[joint.1]\nviscous_friction = 0.5\n")
    skip = "--skip viscous_friction,asymmetric_friction --skip quadratic_friction"
    command = f"diagnose 1r fine.csv {skip} --reference well.csv --cutoff 9 --actuators drive.toml --json"
    (place / "well.csv").write_text("\n".join((place / "fine.csv").read_text().splitlines()[:-9]) + "\n")
    before = sorted(place.iterdir())
    assert run(command.split()) in (0, 3)
    found = json.loads(capfd.readouterr().out)
    assert {"drive.toml", "fine.csv", "well.csv", "1r"} == {entry["path"] for entry in found["inputs"]}
    named = {x["effect"] for finding in found["findings"] for x in (finding, *finding["alternatives"])}
    assert not named & {"viscous_friction", "asymmetric_friction", "quadratic_friction"}
    assert found["cutoff"]["torque"] == pytest.approx(9, rel=0.1) and sorted(place.iterdir()) == before


@pytest.mark.slow
def test_signs_are_recovered_first(arm: tuple[int, Any]) -> None:
    code = run(["diagnose", "3r", "arm.csv", "--unsigned", "-o", "signless"])
    found = read("signless/diagnosis.json")
    assert sorted(path.name for path in Path("signless").iterdir()) == sorted([*FILES, "signed.csv", "signs.html"])
    assert causes(found)[0] == ("coulomb_friction", "joint_2") and code == (3 if found["flags"] else 0)
    assert set(found["signs"]["flags"]) <= set(found["flags"]) and len(found["signs"]["segments"]) > 5
    signed, recorded = pl.read_csv("signless/signed.csv"), pl.read_csv("arm.csv")
    for joint in found["joints"]:
        right = np.sign(signed[f"tau_{joint}"].to_numpy()) == np.sign(recorded[f"tau_{joint}"].to_numpy())
        assert np.mean(right) > 0.97


def test_a_saved_model_has_its_torque_constants(place: Path) -> None:
    (place / "constants.toml").write_text("[joint.2]\ntorque_constant = 4.5\n")
    (place / "known.json").write_text(json.dumps(signid.load_model("3r", "constants.toml").document()))
    constants = signid.load_model("known.json").robot.actuators.torque_constant
    np.testing.assert_array_equal(constants, [np.nan, 4.5, np.nan])


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("1r fine.csv", "add -o DIR"),
        ("1r none.csv -o bad", "none.csv"),
        ("1r fine.csv --held-out none.csv -o bad", "none.csv"),
        ("1r fine.csv --reference fine.csv -o bad", "its own reference"),
        ("1r fine.csv --skip magnetism -o bad", "there is no effect named 'magnetism'"),
        ("panda fine.csv -o bad", "panda_joint1"),
        ("none.json fine.csv -o bad", "none.json"),
        ("drive.json fine.csv --actuators drive.toml -o bad", "actuators itself"),
        ("1r fine.csv --cutoff -3 -o bad", "positive frequency"),
    ],
)
def test_bad_input_gives_one_sentence(command: str, words: str, capfd: pytest.CaptureFixture[str]) -> None:
    if command.startswith("drive.json"):
        signid.load_model("1r").save("drive.json")
        Path("drive.toml").write_text("[joint.1]\nviscous_friction = 0.5\n")
    assert run(["diagnose", *command.split()]) == 2
    out, err = capfd.readouterr()
    assert words in err and err.count("\n") == 1 and not out and not Path("bad").exists()
