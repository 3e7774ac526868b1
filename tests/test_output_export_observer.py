"""The momentum observer in generated C: its residual, what it learns, and contacts."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from signid.cli.run import run
from signid.effects.naming import parse_law
from signid.model import Model, load_model
from signid.output.export import export
from signid.output.export.code.languages import identifier
from signid.regression.motion import Motion
from signid.robot import configuration, load_robot
from signid.simulation.excite.families import rest_to_rest_motion

COMPILER = shutil.which("cc") or shutil.which("gcc")
STRICT = "-std=c99 -pedantic -O1 -Wall -Wextra -Wconversion -Wshadow -Werror".split()
STEP, QUIET, GAIN, SLOW = 1e-3, 8.0, 50.0, 0.01
LEARNED = 1.3 * QUIET + 1.5  # [s] with pauses of the motion
VISCOUS, COULOMB = 0.4, 0.5
DRIVER = """#include "arm.h"
#include <stdio.h>
int main(void)
{
    static NAME_observer o;
    double row[3 * COUNT + 1], contact[COUNT];
    NAME_observer_reset(&o);
    if (QUIET > 0.0) {
        NAME_observer_learn(&o, QUIET);
    }
    while (fread(row, sizeof(double), 3 * COUNT + 1, stdin) == 3 * COUNT + 1) {
        NAME_observer_step(&o, row, row + COUNT, row + 2 * COUNT, row[3 * COUNT]);
        for (int j = 0; j < COUNT; j++) {
            contact[j] = o.contact[j];
        }
        fwrite(o.residual, sizeof(double), COUNT, stdout);
        fwrite(o.threshold, sizeof(double), COUNT, stdout);
        fwrite(contact, sizeof(double), COUNT, stdout);
    }
    return 0;
}
"""
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")


class Seen(NamedTuple):
    """State of the observer after each row, (N, n) each."""

    residual: Any
    threshold: Any
    contact: Any


def rubbing(name: str, *more: str) -> Model:
    """Model of a robot with friction at every joint."""
    model = load_model(load_robot(name))
    texts = [
        f"{effect}@{joint}:{key}={x}"
        for joint in model.robot.joints
        for effect, key, x in (("viscous_friction", "coefficient", VISCOUS), ("coulomb_friction", "level", COULOMB))
    ]
    return replace(model, laws=tuple(parse_law(text, model.robot) for text in (*texts, *more)))


def moved(model: Model, seconds: float, seed: int = 3) -> tuple[Any, Any, Any]:
    """Position, velocity and torque (N, n) of a random motion at 1 kHz."""
    asked = rest_to_rest_motion(model.robot, seconds, STEP, seed)
    return asked.q, asked.v, model.inverse(Motion(model.robot, asked.t, asked.q, asked.v, asked.a))


def observed(model: Model, folder: Path, q: Any, v: Any, tau: Any, dt: Any = STEP, quiet: float = QUIET) -> Seen:
    """Run the compiled observer over rows."""
    made, n = export(model, "c", name="arm", functions=("observer",)), len(model.robot.joints)
    words = {"NAME": identifier(model.robot.name), "COUNT": str(n), "QUIET": repr(quiet)}
    driver = DRIVER
    for word, text in words.items():
        driver = driver.replace(word, text)
    for file, text in {"arm.c": made.text, "arm.h": made.beside[".h"], "run.c": driver}.items():
        (folder / file).write_text(text)
    subprocess.run([str(COMPILER), *STRICT, "arm.c", "run.c", "-lm", "-o", "run"], cwd=folder, check=True)
    rows = np.column_stack([q, v, tau, np.broadcast_to(dt, len(q))])
    done = subprocess.run([folder / "run"], input=rows.tobytes(), capture_output=True, check=True)
    return Seen(*np.frombuffer(done.stdout).reshape(len(q), 3, n).transpose(1, 0, 2))


def reference(model: Model, q: Any, v: Any, tau: Any, dt: Any) -> Any:
    """Residual (N, n) from the mass matrix, the Coriolis matrix and gravity of Pinocchio."""
    robot, bodies = model.robot, model.bodies()
    data, momentum, force = bodies.createData(), [], []
    for x, rate in zip(configuration(robot, q), v @ robot.drive.T, strict=True):
        pin.crba(bodies, data, x)
        mass = np.triu(data.M) + np.triu(data.M, 1).T
        momentum.append(mass @ rate)
        force.append(pin.computeCoriolisMatrix(bodies, data, x, rate).T @ rate)
        force[-1] = force[-1] - pin.computeGeneralizedGravity(bodies, data, x)
    p = np.array(momentum) @ robot.drive
    u = tau + np.array(force) @ robot.drive - VISCOUS * v - COULOMB * np.clip(v / SLOW, -1, 1)
    out = np.zeros_like(q)
    for k in range(1, len(q)):
        keep = np.exp(-GAIN * dt[k])
        out[k] = keep * out[k - 1] + (1 - keep) * ((u[k] + u[k - 1]) / 2 - (p[k] - p[k - 1]) / dt[k])
    return out


@pytest.mark.parametrize("name", ["3r", "panda"])
def test_the_residual_is_that_of_pinocchio_with_lost_rows_and_a_gap(name: str, tmp_path: Path) -> None:
    model = rubbing(name)
    q, v, tau = (x.copy() for x in moved(model, 1.2))
    tau[300:, 0] += 2.0  # contact
    dt = np.full(len(q), STEP)
    kept = np.ones(len(q), dtype=bool)
    kept[[200, 201, 500]] = False
    tau[200], v[201], dt[500] = np.nan, np.inf, np.nan
    dt[501], dt[700] = 2 * STEP, 0.05  # the time of the row with a bad dt; a gap
    found = observed(model, tmp_path, q, v, tau, dt, quiet=0.0)
    dt[202] = 3 * STEP
    parts = [np.flatnonzero(kept[:700]), np.arange(700, len(q))]
    expected = np.concatenate([reference(model, q[part], v[part], tau[part], dt[part]) for part in parts])
    assert_allclose(found.residual[kept], expected, atol=1e-9 * np.nanmax(np.abs(tau)))
    assert found.residual[499, 0] == pytest.approx(2.0, rel=0.05)  # what the drive gives against the contact
    assert np.isinf(found.threshold).all() and not found.contact.any()


@pytest.mark.parametrize(("name", "joint"), [("3r", 1), ("panda", 3)])
def test_a_push_is_a_contact_and_the_rest_is_not(name: str, joint: int, tmp_path: Path) -> None:
    model = rubbing(name)
    q, v, tau = moved(model, LEARNED + 10.0)
    t, rng = STEP * np.arange(len(q)), np.random.default_rng(1)
    push = (t > LEARNED + 5.0) & (t < LEARNED + 5.4)
    noisy = np.roll(tau, 2, axis=0) + 0.1 * COULOMB * np.sign(v) + rng.normal(0, 0.05, tau.shape)
    noisy[push, joint] += 3.0
    found = observed(model, tmp_path, q, v + rng.normal(0, 1e-3, v.shape), noisy)
    learned = np.isfinite(found.threshold).all(axis=1)
    assert 1.25 * QUIET < t[learned][0] < LEARNED and learned[t >= t[learned][0]].all()
    assert found.threshold[learned].max() < 2.5 and found.threshold[learned].min() > 0.1
    touched = t[found.contact.any(axis=1)]
    assert 0.004 < touched[0] - (LEARNED + 5.0) < 0.04 and LEARNED + 5.4 < touched[-1] < LEARNED + 5.7
    assert np.flatnonzero(found.contact.any(axis=0)).tolist() == [joint]
    assert found.residual[np.flatnonzero(push)[-1], joint] == pytest.approx(3.0, rel=0.1)


def test_laws_by_load_acceleration_and_direction_are_in_the_prediction(tmp_path: Path) -> None:
    pair = "joint_coupling@joint_2:partner=joint_3,inertia=0.05,viscous=0.1,coulomb=0.2"
    model = rubbing(
        "3r",
        "load_friction@joint_2:coefficient=0.2",
        "armature@joint_1:inertia=0.5",
        "asymmetric_friction@joint_1:viscous_positive=0.1,viscous_negative=0.3,coulomb_positive=0.2,coulomb_negative=0.4",
        "stribeck_friction@joint_3:level=0.3,velocity=0.2",
        pair,
    )
    q, v, tau = moved(model, 6.0)
    fast = (np.abs(v) > 10 * SLOW).all(axis=1) & (STEP * np.arange(len(q)) > 0.5)
    left = observed(model, tmp_path, q, v, tau, quiet=0.0).residual
    without = observed(rubbing("3r"), tmp_path, q, v, tau, quiet=0.0).residual
    assert np.sqrt(np.mean(left[fast] ** 2)) < 0.05 * np.sqrt(np.mean(without[fast] ** 2))


def test_the_command_writes_the_observer_without_allocation(tmp_path: Path) -> None:
    for folder, asked in (("a", ["--observer"]), ("b", ["--with", "observer"])):
        (tmp_path / folder).mkdir()
        assert run(["export", "panda", "--c", str(tmp_path / folder / "arm.c"), *asked]) == 0
    for name in ("arm.c", "arm.h", "arm_test.c"):
        text = (tmp_path / "a" / name).read_text()
        assert text == (tmp_path / "b" / name).read_text() and "panda_observer" in text
        assert "alloc" not in text.replace("without allocation", "") and "free(" not in text
    command = [str(COMPILER), *STRICT, "arm.c", "arm_test.c", "-lm", "-o", "arm"]
    subprocess.run(command, cwd=tmp_path / "a", check=True)
    out = subprocess.run([tmp_path / "a" / "arm"], capture_output=True, text=True, check=True).stdout
    assert out.splitlines()[-1].split() == ["observer", *["0"] * 7]  # one row alone
