"""The commands `signid simulate`, `excite` and `effects`."""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from strict_json import strict

import signid
from signid.cli import run
from signid.cli.commands.simulation import split_laws
from signid.effects import DRIVE_EFFECTS, EFFECTS
from signid.effects.naming import law_syntax, parse_law

LIGHT = "payload:mass=0.2,first_moment_x=0.02"
REAL = "--noise 0.01 --encoder-bits 17 --seed 3".split()


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Run every test in its own folder."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path


def printed(command: str, capfd: pytest.CaptureFixture[str], code: int = 0) -> Any:
    """JSON output of a command."""
    capfd.readouterr()
    assert run([*command.split(), "--json"]) == code, capfd.readouterr().err
    return strict(capfd.readouterr().out)


def columns(path: str) -> dict[str, np.ndarray]:
    text = Path(path).read_text().splitlines()
    rows = np.array([line.split(",") for line in text[1:]], float)
    return dict(zip(text[0].split(","), rows.T, strict=True))


def test_injected_laws_are_identified(capfd: pytest.CaptureFixture[str]) -> None:
    injected = ["--inject", "coulomb_friction@2:level=0.8", "--inject", "viscous_friction@joint_1:coefficient=0.4"]
    assert run(["simulate", "3r", "-o", "x.csv", "--inject", LIGHT, *injected, *REAL]) == 0
    out, err = capfd.readouterr()
    assert "coulomb_friction" in out and "injected" in out and out.endswith("written:\n  x.csv\n") and err == ""
    assert max(map(len, out.splitlines())) <= 100
    assert run(["identify", "3r", "x.csv", "-o", "result"]) in (0, 3)
    found = strict(Path("result/identification.json").read_text())
    base = {entry["expression"]: entry for entry in found["base_parameters"]}
    robot = signid.load_robot("3r")
    x = robot.model.inertias[3].mass * robot.model.inertias[3].lever[0]
    for name, value in {"mx_3": x + 0.02, "coulomb_friction_2": 0.8, "viscous_friction_1": 0.4}.items():
        assert base[name]["value"] == pytest.approx(value, abs=max(5 * base[name]["std"], 0.02 * value)), name
    assert run(["simulate", "result/model.json", "-o", "again.parquet", "--duration", "2"]) == 0


def test_the_json_output_is_correct(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "a.toml").write_text("[joint.2]\nviscous_friction = 0.3\n")
    pair = "joint_coupling@2:partner=joint_3,inertia=0,viscous=0.1,coulomb=0.05"
    command = f"simulate 3r -o x.csv --actuators a.toml --inject {pair} --inject base_tilt:x=0.1,y=0 --rate 100"
    found = printed(f"{command} --duration 3 --jitter 0.05 --drop-outs 0.05 --seed 4", capfd)
    table = columns("x.csv")
    assert (found["schema"], found["robot"], found["seed"]) == ("signid.simulation/1", "3r", 4)
    assert found["version"] == signid.__version__
    assert found["columns"] == list(table) and found["rows"] == len(table["t"]) < 300
    assert found["sensors"]["rate"] == 100 and found["sensors"]["jitter"] == 0.05
    rms = [np.sqrt(np.mean(table[f"tau_{joint}"] ** 2)) for joint in found["joints"]]
    assert np.allclose(found["torque_rms"], rms) and max(found["tracking_rms"]) < 0.05
    laws = [(x["effect"], x["joint"], x["injected"]) for x in found["effects"]]
    assert ("viscous_friction", "joint_2", False) in laws
    assert laws[-2:] == [("joint_coupling", "joint_2", True), ("base_tilt", None, True)]
    viscous = next(x for x in found["effects"] if x["effect"] == "viscous_friction" and x["joint"] == "joint_2")
    assert viscous["parameters"]["coefficient"] == {"value": 0.3, "unit": "N.m.s/rad"}
    coupling = found["effects"][-2]["parameters"]
    assert coupling["partner"]["value"] == "joint_3" and coupling["viscous"]["value"] == 0.1
    digest = {entry["path"]: entry["sha256"] for entry in found["inputs"]}
    assert digest["a.toml"] == sha256(Path("a.toml").read_bytes()).hexdigest() and "3r" in digest
    assert found["drive"]["kind"] == "closed loop" and len(found["drive"]["stiffness"]) == 3


def test_json_alone_writes_nothing(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert printed("simulate 1r --duration 1", capfd)["rows"] == 250
    assert printed("effects spring", capfd)["effects"][0]["name"] == "spring"
    assert not list(folder.iterdir())


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".parquet", ".npz"])
def test_the_same_seed_gives_the_same_bytes(suffix: str, capfd: pytest.CaptureFixture[str]) -> None:
    for name, seed in (("one", "3"), ("two", "3"), ("other", "4")):
        assert (
            run(["simulate", "1r", "-o", f"{name}{suffix}", "--duration", "1", "--noise", "0.1", "--seed", seed]) == 0
        )
    one, two, other = (Path(f"{name}{suffix}").read_bytes() for name in ("one", "two", "other"))
    assert one == two != other


def test_a_random_motion_is_from_rest_to_rest_within_limits() -> None:
    assert run("simulate ur5 -o x.csv --rate 1000 --duration 8".split()) == 0
    table, robot = columns("x.csv"), signid.load_robot("ur5")
    asked = np.column_stack([table[f"q_des_{joint}"] for joint in robot.joints])
    assert np.abs(np.diff(asked[:3], axis=0)).max() < 1e-4 and np.abs(np.diff(asked[-3:], axis=0)).max() < 1e-4
    assert (asked > robot.lower).all() and (asked < robot.upper).all()
    assert (np.abs(np.diff(asked, axis=0)) * 1000 < robot.velocity_limit).all()
    assert (np.ptp(asked, axis=0) > 0.2).all()


def test_joints_without_a_column_are_held(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    t = np.linspace(0, 2, 101)
    rows = [f"{5 + x},{0.2 * np.sin(2 * x)},{0.3 * np.sin(3 * x)}" for x in t]
    (folder / "m.csv").write_text("\n".join(["t,q_2,q_joint_3", *rows]))
    found = printed("simulate 3r --motion m.csv -o x.csv", capfd)
    assert found["joints"] == ["joint_2", "joint_3"] and found["duration"] == pytest.approx(2, abs=0.01)
    assert any("held fixed: joint_1 at 0 rad" in note for note in found["notes"])
    table = columns("x.csv")
    assert np.abs(table["q_joint_3"] - 0.3 * np.sin(3 * table["t"])).max() < 1e-3
    assert "q_joint_1" not in table and "tau_joint_2" in table


def test_a_recording_plays_back(capfd: pytest.CaptureFixture[str]) -> None:
    laws = ["--inject", "viscous_friction@1:coefficient=1.0", "--inject", "coulomb_friction@1:level=1.0"]
    assert run(["simulate", "1r", "-o", "x.csv", "--duration", "4", "--rate", "1000", *laws]) == 0
    assert run(["simulate", "1r", "--torque", "x.csv", "-o", "y.csv", "--rate", "1000", *laws]) == 0
    one, two = columns("x.csv"), columns("y.csv")
    assert list(two) == ["t", "q_joint_1", "tau_joint_1"]
    assert np.abs(one["q_joint_1"][:-1] - two["q_joint_1"]).max() < 5e-3 < np.ptp(two["q_joint_1"])
    found = printed("simulate 1r --torque x.csv", capfd)
    assert found["drive"] == {"kind": "open loop"} and found["tracking_rms"] is None


def test_controller_and_integrator_options_have_an_effect(capfd: pytest.CaptureFixture[str]) -> None:
    given = "simulate 3r --duration 1 --step 5e-4 --integrator rk4 --kp 200,300,40 --kd 5 --feed-forward 0.5"
    found = printed(given, capfd)
    assert found["drive"]["stiffness"] == [200, 300, 40] and found["drive"]["damping"] == [5, 5, 5]
    assert found["drive"]["feed_forward"] == 0.5 and found["step"] == 5e-4 and found["integrator"] == "rk4"
    stiff, soft = (printed(f"simulate 3r --duration 1 --bandwidth {x} --feed-forward 0", capfd) for x in (12, 3))
    assert np.all(np.array(stiff["tracking_rms"]) < np.array(soft["tracking_rms"]))
    assert any("--bandwidth" in note for note in soft["notes"])


def test_signs_can_be_left_out(capfd: pytest.CaptureFixture[str]) -> None:
    found = printed("simulate 3r --duration 1 --unsigned -o x.csv", capfd)
    assert "abs_tau_joint_1" in found["columns"] and columns("x.csv")["abs_tau_joint_1"].min() >= 0


def test_an_exciting_motion_is_followed(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    found = printed("excite 1r -o m.csv --duration 4 --harmonics 3 --velocity-scale 0.5 --seed 2", capfd)
    assert (found["schema"], found["purpose"], found["kind"]) == ("signid.excitation/1", "excite", "fourier")
    assert found["rows"] == 401 and found["flags"] == [] and found["seed"] == 2
    assert {"expression", "std", "relative_std"} == set(found["base_parameters"][0])
    assert max(found["use"]["velocity"]) <= 1
    table = columns("m.csv")
    assert list(table) == ["t", "q_joint_1", "dq_joint_1", "ddq_joint_1"]
    assert np.abs(table["dq_joint_1"]).max() <= 0.5 * 10
    assert run("simulate 1r --motion m.csv -o x.csv".split()) == 0
    assert run("excite 1r -o n.csv --duration 4 --harmonics 3 --velocity-scale 0.5 --seed 2".split()) == 0
    assert (folder / "m.csv").read_bytes() == (folder / "n.csv").read_bytes()
    assert "Least identifiable of" in capfd.readouterr().out


@pytest.mark.slow
def test_excitation_distinguishes_laws_or_says_that_it_cannot(capfd: pytest.CaptureFixture[str]) -> None:
    both = "viscous_friction@1:coefficient=1,spring@1:stiffness=5,rest=0.2"
    found = printed(f"excite 1r -o m.csv --duration 4 --harmonics 3 --separate {both}", capfd)
    assert found["purpose"] == "separate" and found["enough"] and not found["structural"]
    assert [law["effect"] for law in found["laws"]] == ["viscous_friction", "spring"]
    same = {
        "quadratic_friction@1,fluid_drag": "no motion",
        "payload,link_inertia@1": "no motion",
        "asymmetric_friction@1,coulomb_friction@1": "only if asymmetric_friction is true",
    }
    for laws, words in same.items():
        assert run(["excite", "1r", "-o", "n.csv", "--duration", "4", "--harmonics", "3", "--separate", laws]) == 3
        out, err = capfd.readouterr()
        assert words in err and "written" in out and Path("n.csv").is_file()


def test_commas_separate_laws_and_their_parameters() -> None:
    spring, tilt = "spring@2:stiffness=3,rest=0", "base_tilt:x=1,y=2"
    assert split_laws([f"{spring},{tilt}"]) == split_laws([spring, tilt]) == [spring, tilt]
    assert split_laws(["spring@2,payload"]) == ["spring@2", "payload"]


def test_effects_are_listed_and_read_back(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["effects"]) == 0
    out, robot = capfd.readouterr().out, signid.load_robot("3r")
    for effect in EFFECTS:
        text = law_syntax(effect)
        assert f"  {text}\n" in out or text in out.replace("\n", "")
        text = text.replace("[@JOINT]", "").replace("@JOINT", "@joint_1").replace("partner=JOINT", "partner=joint_2")
        law = parse_law(text, robot)
        stated = {key: value for key, value in effect.example.items() if key not in effect.optional}
        assert law.effect is effect and dict(law.parameters) == stated
    assert run(["effects", "stribeck_friction"]) == 0
    card = " ".join(capfd.readouterr().out.split())
    assert all(word in card for word in ("rad/s", "Automatica", "exp(", "--inject stribeck_friction@JOINT:level="))
    assert len(printed("effects", capfd)["effects"]) == len(EFFECTS.names) + len(DRIVE_EFFECTS.names)


@pytest.mark.slow
def test_every_effect_can_be_injected(capfd: pytest.CaptureFixture[str]) -> None:
    for effect in EFFECTS:
        text = law_syntax(effect).replace("[@JOINT]", "").replace("@JOINT", "@2").replace("partner=JOINT", "partner=3")
        given = ["--inject", text, "--inject", "armature@2:inertia=0.2", "--inject", "armature@3:inertia=0.2"]
        assert run(["simulate", "3r", "--json", "--duration", "0.5", *given]) == 0, text
        found = strict(capfd.readouterr().out)
        assert any(x["effect"] == effect.name and x["injected"] for x in found["effects"])


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("simulate 1r -o x.csv --duration 1 --rate 1", "1 s at 1 Hz are a single row"),
        ("excite 1r -o x.csv --separate viscous_friction@1", "does not name two laws"),
    ],
)
def test_useless_requests_are_refused(
    command: str, words: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(command.split()) == 2
    assert words in capfd.readouterr().err and not list(folder.iterdir())
