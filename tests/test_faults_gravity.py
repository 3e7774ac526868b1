"""Gravity that recordings show: a robot on its side, on a ceiling or on a slope, and torque without weight."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import polars as pl
import pytest
from toys import toy

import signid
from signid.check import Check, check
from signid.cli import run
from signid.types import Array, Recording, Robot

G, RATE, SECONDS = 9.81, 100.0, 16.0  # m/s2, Hz, s
SLOPE = (G * np.sin(np.pi / 6), 0.0, -G * np.cos(np.pi / 6))  # a mobile base on a slope of 30 degrees
VISCOUS, COULOMB, NOISE = 0.5, 0.6, 0.02  # N.m.s/rad, N.m, N.m
MOUNTED = {
    (0.0, -G, 0.0): "gravity acts along -y of {root} (0, -9.81, 0): the robot is mounted on its side;",
    (G, 0.0, 0.0): "gravity acts along x of {root} (9.81, 0, 0): the robot is mounted on its side;",
    (0.0, 0.0, G): "gravity acts along z of {root} (0, 0, 9.81): the robot hangs upside down;",
    SLOPE: "its base is inclined by 30 degrees;",
    (0.0, 0.0, 0.0): "the recorded torque carries no weight of the robot;",
}
LINK = (
    '<link name="l{k}"><inertial><origin xyz="{at}"/><mass value="{m}"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="j{k}" type="{kind}"><parent link="{parent}"/><child link="l{k}"/><origin xyz="{place}"/>'
    '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="99" velocity="9"/></joint>'
)


@cache
def scara() -> Robot:
    """Two joints turn about the vertical, so gravity shows in the force of the slide alone."""
    kinds = (("revolute", "0 0 0.3", 4.0), ("revolute", "0.4 0 0", 3.0), ("prismatic", "0.3 0 0", 1.5))
    parts = ['<link name="base"/>']
    for k, (kind, place, mass) in enumerate(kinds, 1):
        parent, at = f"l{k - 1}" if k > 1 else "base", "0 0 0.1" if kind == "prismatic" else "0.2 0 0"
        parts.append(LINK.format(k=k, kind=kind, place=place, parent=parent, at=at, m=mass))
    return toy(*parts, name=' name="scara"')


def moved(robot: Robot, gravity: tuple[float, ...] | Array, seed: int = 0, weight: Array | None = None) -> Recording:
    """A recording by Pinocchio's inverse dynamics under some gravity, with friction and noise.

    weight: (n,) [1] share of the weight that each joint's torque carries.
    """
    rng, n = np.random.default_rng(seed), len(robot.joints)
    t = np.arange(0, SECONDS, 1 / RATE)
    w = 2 * np.pi * np.array([1, 2, 3, 5]) / 8.0
    size, phase = rng.normal(size=(n, 4)) / [1, 2, 3, 5] / 1.5, rng.uniform(0, 2 * np.pi, (n, 4))
    angle = t[:, None, None] * w + phase
    q, v, a = (np.sum(size * x, axis=2) for x in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    q = q + rng.uniform(-0.6, 0.6, n)
    torque = []
    for field in (np.zeros(3), np.array(gravity)):
        model = robot.model.copy()
        model.gravity.linear = field
        data = model.createData()
        torque.append(np.array([pin.rnea(model, data, *x).copy() for x in zip(q, v, a, strict=True)]))
    tau = torque[0] + (torque[1] - torque[0]) * (1.0 if weight is None else weight)
    tau = tau + VISCOUS * v + COULOMB * np.sign(v) + NOISE * rng.normal(size=q.shape)
    columns = {"t": t}
    for j, joint in enumerate(robot.joints):
        columns |= {f"q_{joint}": q[:, j], f"tau_{joint}": tau[:, j]}
    return signid.read_recording(pl.DataFrame(columns), robot)


@cache
def seen(gravity: tuple[float, ...]) -> Check:
    """A check of a 3r that is described as upright, from a recording under some gravity."""
    robot = signid.load_robot("3r")
    return check(robot, moved(robot, gravity))


def gravity_flags(found: Check) -> list[str]:
    return [flag for flag in found.flags if "gravity" in flag or "weight" in flag]


@pytest.mark.parametrize("gravity", MOUNTED)
def test_gravity_is_named_in_words_with_the_option_that_states_it(gravity: tuple[float, ...]) -> None:
    [flag] = gravity_flags(seen(gravity))
    assert MOUNTED[gravity].format(root="base_link") in flag
    [fault] = [fault for fault in seen(gravity).faults.findings if fault.kind == "gravity"]
    assert [fault.measures[key] for key in "xyz"] == pytest.approx(gravity, abs=0.2)
    assert "state it with gravity=(" in flag and not [
        f for f in seen(gravity).faults.findings if f.kind in ("clock", "torque sign")
    ]


def test_the_right_gravity_is_no_flag_and_a_wrong_one_is_put_right() -> None:
    robot, upright = signid.load_robot("3r"), (0.0, 0.0, -G)
    assert gravity_flags(seen(upright)) == []
    wall = signid.load_robot("3r", gravity=(0, -G, 0))
    assert gravity_flags(check(wall, moved(robot, (0, -G, 0)))) == []
    [flag] = gravity_flags(check(wall, moved(robot, upright)))
    assert "gravity acts along -z of base_link (0, 0, -9.81): the robot stands upright;" in flag
    [flag] = gravity_flags(check(signid.load_robot("3r", gravity=(0, 0, 0)), moved(robot, upright)))
    assert "gravity=(0,0,-9.81)" in flag


@pytest.mark.slow_cases("-1$")
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("gravity", MOUNTED)
def test_links_with_errors_of_15_percent_do_not_hide_gravity(gravity: tuple[float, ...], seed: int) -> None:
    robot = signid.load_robot("3r")
    rng, model = np.random.default_rng(seed), robot.model.copy()
    for k in range(1, model.njoints):
        own, (mass, size) = model.inertias[k], np.exp(0.15 * rng.normal(size=2))
        model.inertias[k] = pin.Inertia(own.mass * mass, own.lever + 0.015 * rng.normal(size=3), own.inertia * size)
    found = check(replace(robot, model=model), moved(robot, gravity, seed + 1))
    [fault] = [fault for fault in found.faults.findings if fault.kind == "gravity"]
    assert [fault.measures[key] for key in "xyz"] == pytest.approx(gravity, abs=1.3)


def test_a_scara_shows_gravity_in_its_slide_and_on_a_wall_in_its_arms() -> None:
    robot = scara()
    assert gravity_flags(check(robot, moved(robot, (0, 0, -G)))) == []
    [flag] = gravity_flags(check(robot, moved(robot, (G, 0, 0))))
    assert "gravity acts along x of base (9.81, 0, 0)" in flag


def test_torque_of_one_joint_without_weight_is_named() -> None:
    robot = signid.load_robot("ur5")
    upright = (0.0, 0.0, -G)
    for share in (np.ones(6), np.array([1, 1, 0, 1, 1, 1])):
        flags = gravity_flags(check(robot, moved(robot, upright, weight=share)))
        assert ["the torque of elbow_joint carries no weight of the links" in flag for flag in flags] == [True] * (
            not share.all()
        )


def test_identification_uses_the_gravity_found_and_keeps_it(tmp_path: Path) -> None:
    robot = signid.load_robot("3r")
    found = signid.identify(robot, [moved(robot, (0, -G, 0))])
    assert "the model is identified with it" in found.flags[0]
    assert found.model.robot.model.gravity.linear.tolist() == [0, -G, 0]
    assert json.loads(found.model.save(tmp_path / "model.json").read_text())["gravity"] == [0, -G, 0]
    assert min(found.fit.held_out_r2) > 0.99
    stated = signid.identify(signid.load_robot("3r", gravity=(0, -G, 0)), [moved(robot, (0, -G, 0))])
    assert np.array_equal(stated.estimate.value, found.estimate.value) and gravity_flags(stated) == []  # type: ignore[arg-type]


@pytest.mark.parametrize("stated", [None, (0, 0, 0)])
def test_without_weight_friction_and_inertia_are_identified_and_masses_are_not(stated: tuple[int, ...] | None) -> None:
    robot = signid.load_robot("3r", gravity=stated)
    found = signid.identify(robot, [moved(robot, (0, 0, 0))])
    assert any("masses are not identifiable" in flag for flag in found.flags)
    assert not found.model.robot.model.gravity.linear.any() and min(found.fit.held_out_r2) > 0.99
    for joint in range(3):
        laws = {law.effect.name: law.parameters for law in found.model.laws if law.joints == (joint,)}
        assert laws["viscous_friction"]["coefficient"] == pytest.approx(VISCOUS, abs=0.05)
        assert laws["coulomb_friction"]["level"] == pytest.approx(COULOMB, abs=0.05)


@pytest.mark.slow
def test_a_diagnosis_finds_gravity_beside_the_other_laws() -> None:
    robot = signid.load_robot("3r")
    for gravity in ((0.0, -G, 0.0), (0.0, 0.0, 0.0)):
        found = signid.diagnose(signid.load_model(robot), [moved(robot, gravity)])
        first = found.findings[0]
        assert (first.law.effect.name, first.role, found.verdict) == ("gravity", "cause", "named")
        assert first.probability > 0.99 and dict(first.law.parameters) == dict(zip("xyz", gravity, strict=True))
        assert dict(first.stated) == {"x": 0.0, "y": 0.0, "z": -G}
        assert {finding.law.effect.name for finding in found.findings} == {
            *("gravity", "viscous_friction", "coulomb_friction")
        }
        assert found.model.robot.model.gravity.linear.tolist() == list(gravity) and found.gain.max() < 0.2
        assert any("masses are not identifiable" in flag for flag in found.flags) == (not any(gravity))


def test_a_diagnosis_may_not_name_gravity_that_is_excluded() -> None:
    robot = signid.load_robot("3r")
    with signid.time_limit(0.5):  # without gravity the search is long
        found = signid.diagnose(signid.load_model(robot), [moved(robot, (0.0, 0.0, 0.0))], skip=("gravity",))
    assert "gravity" not in {finding.law.effect.name for finding in found.findings}


def test_the_command_line_flags_gravity_with_exit_code_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = signid.load_robot("3r")
    log = tmp_path / "log.csv"
    one = moved(robot, (0, -G, 0))
    names = ["t", *one.columns["q"], *one.columns["tau"]]
    pl.DataFrame(dict(zip(names, one.table.read(names, 0, len(one)).T, strict=True))).write_csv(log)
    assert run(["check", "3r", str(log), "--json"]) == 3
    assert "the robot is mounted on its side" in " ".join(json.loads(capsys.readouterr().out)["flags"])
    run(["check", "3r", str(log), "--gravity", "0,-9.81,0", "--json"])
    assert "its side" not in capsys.readouterr().out
