"""The load of the last link from recordings without it and with it."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose

import signid
from benchmarks.arms import ARMS, Arm, load
from benchmarks.plants.bodies import Drives
from benchmarks.plants.faults import Fault
from benchmarks.plants.mujoco_ import Body, draw_motion, log, simulate
from signid.cli import run
from signid.errors import OptionError, RecordingError
from signid.payload import Payload, payload
from signid.types import TWO_SIDED, Array, Recording, Robot, pseudo_inertia

ARM, UR = ARMS[0], ARMS[2]
MASS, CENTRE = 1.2, np.array([0.03, -0.02, 0.08])
TURN = np.array([0.004, 0.003, 0.005])  # kg.m2 about the centre of mass


@cache
def robot(arm: Arm) -> Robot:
    return load(arm)


def fault(arm: Arm, mass: float) -> Fault:
    """Payload fault of the mass, with an inertia in proportion."""
    about = mass / MASS * np.diag(TURN) + mass * (CENTRE @ CENTRE * np.eye(3) - np.outer(CENTRE, CENTRE))
    numbers = {"mass": mass, **{f"first_moment_{k}": mass * c for k, c in zip("xyz", CENTRE, strict=True)}}
    names = ("xx", "xy", "yy", "xz", "yz", "zz")
    inertia = about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    numbers |= {f"inertia_{k}": float(x) for k, x in zip(names, inertia, strict=True)}
    return Fault("payload", None, MappingProxyType(numbers))


def columns(arm: Arm, mass: float, seed: int, noise: float = 0.02, friction: float = 1.0) -> dict[str, Array]:
    """A recording in MuJoCo, with a load or none, friction that has changed by a factor."""
    d = arm.drives
    rubs = [tuple(friction * x for x in some) for some in (d.viscous_friction, d.coulomb_friction)]
    body = Body(robot(arm).document, robot(arm).joints)
    faults = [fault(arm, mass)] if mass else []
    drives = Drives(d.armature, rubs[0], rubs[1], d.torque_offset)
    track = simulate(body, drives, draw_motion(arm.centre, seed), 20.0, arm.rate, faults)
    return log(track, seed, 17, noise)


@cache
def recording(arm: Arm, mass: float, seed: int, noise: float = 0.02, friction: float = 1.0) -> Recording:
    return signid.read_recording(columns(arm, mass, seed, noise, friction), robot(arm))


@cache
def weighed(seed: int, friction: float = 1.0) -> Payload:
    return payload(robot(UR), [recording(UR, 0.0, seed)], [recording(UR, MASS, seed + 20, friction=friction)])


@pytest.mark.slow
@pytest.mark.parametrize("friction", [1.0, 1.05])
def test_a_load_on_an_arm_of_six_joints_is_weighed(friction: float) -> None:
    held, errors = [], []
    for seed in range(6):
        found = weighed(seed, friction)
        mass, mass_std = found.mass
        errors.append(abs(mass / MASS - 1))
        assert np.abs(found.centre[0] - CENTRE).max() < 2e-3
        z = [(mass - MASS) / mass_std, *((found.centre[0] - CENTRE) / found.centre[1])]
        z += [*((found.inertia[0][[0, 2, 5]] - TURN) / found.inertia[1][[0, 2, 5]])]
        held += [abs(x) < 1.96 for x in z]
        assert np.all(np.linalg.eigvalsh(pseudo_inertia(found.inertial)) > 0)
        assert not found.flags
    assert np.mean(held) > 0.88
    assert max(errors) < 0.02


def test_without_noise_it_is_exact() -> None:
    sides = [[recording(ARM, mass, seed, noise=0.0)] for mass, seed in ((0.0, 1), (0.4, 2))]
    found = payload(robot(ARM), *sides)
    assert_allclose(found.mass[0], 0.4, rtol=0.02)
    assert_allclose(found.centre[0], CENTRE, atol=2e-3)


def test_no_load_is_no_load() -> None:
    found = payload(robot(ARM), [recording(ARM, 0.0, 1)], [recording(ARM, 0.0, 2)])
    assert found.mass[0] < 0.05
    assert any("no load is certain" in flag for flag in found.flags)


def test_unidentifiable_numbers_of_the_load_are_reported() -> None:
    upright = signid.load_robot("3r", joints=["joint_1"])  # turns about the vertical: gravity is not felt
    made = {mass: {k: v for k, v in columns(ARM, mass, 1).items() if k in ("t", "q_1", "tau_1")} for mass in (0.0, 0.4)}
    found = payload(upright, *([signid.read_recording(made[mass], upright)] for mass in (0.0, 0.4)))
    assert set(found.unidentified) >= {"mass", "centre of mass", "inertia"}
    assert any(
        "the mass and the centre of mass and the inertia of a load is not identifiable" in flag for flag in found.flags
    )
    assert np.isinf(found.mass[1])


def test_impossible_inputs_are_refused() -> None:
    one = recording(ARM, 0.0, 1)
    with pytest.raises(OptionError, match="no recording with the load was given"):
        payload(robot(ARM), [one], [])
    with pytest.raises(OptionError, match="same samples were given twice"):
        payload(robot(ARM), [one], [one])
    lost = signid.read_recording(columns(ARM, 0.4, 2), robot(ARM), unsigned=True)
    with pytest.raises(RecordingError, match="lacks signs of torque"):
        payload(robot(ARM), [one], [lost])


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    for name, mass, seed in (("recording", 0.0, 1), ("loaded", 0.4, 2)):
        pl.DataFrame(columns(ARM, mass, seed)).write_csv(f"{name}.csv")
    command = ["payload", "3r", "--without", "recording.csv", "--with", "loaded.csv"]
    assert run(command) == 0
    out = capfd.readouterr().out
    assert "3r: payload of link_3" in out and "centre of mass z" in out
    assert run([*command, "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["schema"] == "signid.payload/1" and document["link"] == "link_3"
    assert_allclose(document["mass"]["value"], 0.4, rtol=0.05)
    assert {file["role"] for file in document["inputs"]} >= {"recording, without the load", "recording, with the load"}
    assert run(["payload", "3r", "--without", "recording.csv"]) == 2
    assert capfd.readouterr().err.startswith("signid: no recording with the load was given")


@pytest.mark.slow
def test_the_load_of_a_real_arm(data: Path) -> None:
    """UR10e; the load was weighed, torque constants are known to some per cent."""
    from benchmarks.real_data import LOADED, UNLOADED, ur10e_model, ur10e_recording

    sides = [ur10e_recording(UNLOADED[0])], [ur10e_recording(LOADED)]
    found = payload(ur10e_model().robot, *sides)
    assert_allclose(payload(ur10e_model(), *sides).inertial, found.inertial)  # bodies of the robot itself cancel
    assert abs(found.mass[0] / 2.805 - 1) < 0.05
    assert abs(found.mass[0] - 2.805) < TWO_SIDED * found.mass[1] < 0.06 * 2.805  # constants are known to 3 %
    assert not found.flags


def test_the_load_is_reported_as_a_law_too() -> None:
    found = weighed(0)
    assert found.law.effect.name == "payload"
    assert found.law.parameters["mass"] == found.mass[0]
    model = signid.load_model("ur10")
    carrying = type(model)(model.robot, model.inertials, (*model.laws, found.law))
    heavier = carrying.bodies().inertias[6].mass - model.bodies().inertias[6].mass
    assert_allclose(heavier, found.mass[0])
