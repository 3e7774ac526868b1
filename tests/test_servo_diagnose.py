"""Diagnosis of position drives: faults that signid's own closed loop has, healthy robots, twins, bad input."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from servo_loops import pendulum_log

import signid
from signid.cli import run
from signid.effects.bodies import point_inertia
from signid.errors import SignidError
from signid.model import Model, load_model, with_servos
from signid.output.report.layout import thousandths
from signid.servo.diagnose import ServoDiagnosis, diagnose_servos
from signid.servo.diagnose.closed_loop import LINEAR, ClosedLoop
from signid.servo.diagnose.hypotheses import HYPOTHESES
from signid.servo.fit.normal import joined_bodies
from signid.servo.plant import grids_of_arrays
from signid.servo.search.data import position_noise
from signid.servos import Servo
from signid.toml_json import check_schema

STATED = Servo(kp=20.0, kd=0.8, delay=0.02, coulomb_friction=0.2, viscous_friction=0.1, armature=0.02)
RATE, SECONDS = 100.0, 14.0
FAULTS = {
    "servo_gain": STATED.with_(kp=26.0),
    "servo_damping": STATED.with_(kd=1.4),
    "command_delay": STATED.with_(delay=0.032),
    "effort_limit": STATED.with_(effort_limit=14.0),
    "dead_band": STATED.with_(dead_band=0.03),
    "profile_limit": STATED.with_(profile_speed=1.2),
    "load_friction": STATED.with_(load_friction=0.15),
    "coulomb_friction": STATED.with_(coulomb_friction=0.9),
    "torque_offset": STATED.with_(torque_offset=1.0),
}


def commands(seed: int) -> tuple[Any, Any]:
    """Stamps (N,) [s] and commands (N,) [rad] with steps."""
    t, rng = np.arange(int(RATE * SECONDS)) / RATE, np.random.default_rng(seed)
    waves = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) / (1 + f) for f in (0.3, 0.7, 1.3, 2.1))
    steps = np.repeat(rng.uniform(-0.5, 0.5, len(t) // 70 + 1), 70)[: len(t)]
    return t, 0.4 * np.asarray(waves) + np.where((t % 4) > 2.5, steps, 0.0)


def record(path: Path, servo: Servo, seed: int = 1) -> Path:
    """A recording of the 1r with this drive."""
    return pendulum_log(path, servo, *commands(seed), seed)


def simulation() -> Model:
    """The 1r with the stated drive."""
    model = load_model("1r")
    return with_servos(model, {model.robot.joints[0]: STATED})


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording of each fault, and of the stated drive."""
    folder = tmp_path_factory.mktemp("servo")
    for name, servo in {"healthy": STATED, **FAULTS}.items():
        record(folder / f"{name}.csv", servo)
    return folder


@cache
def diagnosed(path: Path) -> ServoDiagnosis:
    return diagnose_servos(simulation(), str(path))


def test_a_healthy_robot_is_silent(files: Path) -> None:
    found = diagnosed(files / "healthy.csv")
    assert found.verdict == "nothing_missing" and not found.findings and not found.flags
    assert found.after.held_out_rms[0] < 6e-4


@pytest.mark.parametrize("effect", FAULTS)
def test_a_fault_is_named_first_with_its_number(effect: str, files: Path) -> None:
    found = diagnosed(files / f"{effect}.csv")
    first, joint = found.causes[0], found.model.robot.joints[0]
    assert found.verdict == "named" and first.effect == effect and first.joint == joint
    law = next(law for law in HYPOTHESES if law.effect == effect)
    number = law.numbers[0]
    assert getattr(found.model.servos[joint], number) == pytest.approx(getattr(FAULTS[effect], number), rel=0.03)
    assert found.after.held_out_rms[0] < 0.2 * found.before.held_out_rms[0]
    assert first.held_out_gain > 0.9


def test_damping_and_viscous_friction_are_twins(files: Path) -> None:
    found = diagnosed(files / "servo_damping.csv")
    (first,) = found.causes
    rival = next(rival for rival in first.alternatives if rival.effect == "viscous_friction")
    assert rival.probability == pytest.approx(first.probability, rel=0.3) and "drive off" in rival.separating_motion
    assert any("viscous_friction" in flag for flag in found.flags)


def test_the_stated_number_stands_beside_the_found_one(files: Path) -> None:
    found = diagnosed(files / "servo_gain.csv")
    number = found.causes[0].parameters["kp"]
    assert number.stated == 20.0 and number.value == pytest.approx(26.0, rel=0.01) and number.std and number.unit
    assert not any(rival.effect == "register_gain" for rival in found.causes[0].alternatives)
    rms = [thousandths(float(each.whole_rms[0])) for each in (found.rollout_before, found.rollout_after)]
    assert f"{rms[0]} → {rms[1]} mrad rms, whole recordings" in signid.report(found)


def test_a_gain_of_a_power_of_two_may_be_a_register(tmp_path: Path) -> None:
    found = diagnose_servos(simulation(), str(record(tmp_path / "a.csv", STATED.with_(kp=10.0))))
    first = found.causes[0]
    assert {first.effect, *(x.effect for x in first.alternatives)} >= {"servo_gain", "register_gain"}


def test_skipped_effects_are_not_named(files: Path) -> None:
    skip = ["servo_gain", "register_gain"]
    found = diagnose_servos(simulation(), str(files / "servo_gain.csv"), skip=skip)
    assert not {*skip} & {finding.effect for finding in found.findings}


def test_bad_input_is_refused_in_a_sentence(files: Path, tmp_path: Path) -> None:
    gain, off = str(files / "servo_gain.csv"), str(record(tmp_path / "off.csv", STATED.with_(kp=0.02, kd=0.0)))
    others = [law.effect for law in HYPOTHESES if law.effect != "servo_gain"]
    for model, path, options, words in (
        (simulation(), gain, {"skip": ["nonsense"]}, "no effect"),
        (simulation(), off, {"skip": others}, "does not follow its command"),
        ("1r", gain, {}, "no drive"),
    ):
        with pytest.raises(SignidError, match=words):
            diagnose_servos(model, path, **options)


def test_noise_of_positions_is_at_least_a_step_of_the_encoder() -> None:
    rng, t = np.random.default_rng(0), np.arange(4000) / 100
    q = np.sin(t)[:, None]
    (noisy,) = grids_of_arrays(["j"], t, q + 1e-3 * rng.standard_normal(q.shape), q)
    assert position_noise([noisy])[0] == pytest.approx(1e-3, rel=0.1)
    tick = 2 * np.pi / 4096
    (rough,) = grids_of_arrays(["j"], t, np.round(q / tick) * tick, q)
    assert position_noise([rough])[0] == pytest.approx(tick / np.sqrt(12), rel=0.3)


def test_the_command_line_routes_servo_recordings(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    simulation().save("model.json")
    given = ["diagnose", "model.json", str(files / "servo_gain.csv")]
    assert run([*given, "-o", "out"]) == 0
    document = json.loads(Path("out/diagnosis.json").read_text())
    check_schema(document, "diagnosis")
    assert document["findings"][0]["effect"] == "servo_gain" and document["fit"]["after"]["unit"] == ["rad"]
    again = load_model("out/model.json").servos
    assert next(iter(again.values())).kp == pytest.approx(26.0, rel=0.01)
    first = {path.name: path.read_bytes() for path in Path("out").iterdir()}
    assert {"diagnosis.json", "model.json", "report.html"} <= set(first)
    assert run([*given, "-o", "out"]) == 0
    assert {path.name: path.read_bytes() for path in Path("out").iterdir()} == first
    capsys.readouterr()
    for words, said in (
        ([*given, "--reference", str(files / "healthy.csv")], "--reference"),
        (["diagnose", "1r", given[-1]], "no drive"),
    ):
        assert run([*words, "--json"]) == 2 and said in capsys.readouterr().err


def test_a_mismatch_without_its_law_says_where_it_is_and_what_was_tried(files: Path) -> None:
    path = str(files / "profile_limit.csv")
    found = diagnose_servos(simulation(), path, skip=["profile_limit", *(law.effect for law in HYPOTHESES[2:8])])
    (left,) = found.unexplained
    assert left.region.split()[0] in ("lowest", "middle", "highest") and left.region_rms >= left.rms > 5e-3
    assert "profile_limit" not in left.tried and all(part <= 1 for part in left.tried.values())
    assert list(left.tried.values()) == sorted(left.tried.values(), reverse=True)
    if found.causes:
        assert all(one.probability < 0.95 for one in found.causes)
        assert any("remains, so another law is missing" in flag for flag in found.flags)


def test_the_worst_recording_stands_for_time(tmp_path: Path) -> None:
    drives = {"a": STATED, "b": FAULTS["torque_offset"], "c": STATED}
    paths = [str(record(tmp_path / f"{name}.csv", servo, seed)) for seed, (name, servo) in enumerate(drives.items())]
    every = [*(law.effect for law in HYPOTHESES), "payload"]
    found = diagnose_servos(simulation(), paths[:2], held_out=paths[2:], skip=every)
    (left,) = found.unexplained
    assert found.verdict == "unknown" and left.variable == "time" and left.region == f"recording {paths[1]}"
    assert left.region_rms > 1.3 * left.rms and not left.tried


@pytest.mark.parametrize("name", ["1r", "3r"])
def test_courses_with_a_body_are_those_of_the_robot_that_carries_it(name: str) -> None:
    model = load_model(name)
    joints, t = model.robot.joints, np.arange(300) / RATE
    q = 0.5 * np.sin(t[:, None] * np.arange(1.0, 1.0 + len(joints)))
    servos = dict.fromkeys(joints, STATED)
    loop = ClosedLoop(
        with_servos(model, servos), grids_of_arrays(joints, t, q, q), range(len(joints)), [*servos.values()], 0.8
    )
    body = (0.7, 0.05, -0.02, 0.11)
    exact, found = joined_bodies(loop._along([*body, *point_inertia(body[0], body[1:])])), loop.bodies(body)
    for key in LINEAR:
        assert getattr(found, key) == pytest.approx(getattr(exact, key), rel=1e-9, abs=1e-9)
    key = "wave" if name == "1r" else "bias"  # gravity of a single joint is a wave
    assert np.abs(getattr(found, key) - getattr(loop.bodies(None), key)).max() > 0.1
