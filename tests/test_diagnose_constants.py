"""Currents whose torque constants are estimated: intervals hold the true numbers, and no gain is a finding."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosed import DRIVES, STATED, Planted, fault, recorded, simulation

import signid
from signid.diagnose import Diagnosis
from signid.diagnose.data.estimated_gains import GainPrior, gain_prior, with_estimated_gains
from signid.effects import EFFECTS
from signid.types import TWO_SIDED, Law

CONSTANTS = np.array([5.0, 3.0, 0.5])  # [N.m/A]
SPRING = fault("spring", 2, stiffness=1.0, rest=0.2)
PAYLOAD = fault("payload", mass=0.2, first_moment_x=0.03, first_moment_y=0.0, first_moment_z=0.0)


@cache
def from_currents(*faults: Planted, seed: int = 0, known: int = 2, stated: tuple[str, ...] = ()) -> Diagnosis:
    """Diagnosis from signed currents of the 3R, of which one joint alone has a known constant."""
    model = simulation("3r", stated)
    constants = np.where(np.arange(3) == known, CONSTANTS, np.nan)
    robot = replace(model.robot, actuators=replace(model.robot.actuators, torque_constant=constants))
    recordings = []
    for columns in recorded("3r", *faults, seed=seed):
        moved = {key: x for key, x in columns.items() if not key.startswith("tau")}
        currents = {f"current_{j + 1}": columns[f"tau_{j + 1}"] / k for j, k in enumerate(CONSTANTS)}
        recordings.append(signid.read_recording(moved | currents, robot))
    return signid.diagnose(replace(model, robot=robot), recordings)


@pytest.mark.parametrize("seed", range(3))
def test_intervals_hold_the_true_numbers(seed: int) -> None:
    found, missed, count = from_currents(SPRING, seed=seed), list[str](), 0
    for finding in found.findings:
        name, joint = finding.law.effect.name, finding.law.joints[0]
        (key, value), *_ = finding.law.parameters.items()
        true = 1.0 if name == "spring" else getattr(DRIVES["3r"], name)[joint]
        missed += [f"{name} of {joint + 1}"] if abs(value - true) > TWO_SIDED * finding.std[key] else []
        count += 1
    assert count == 10 and len(missed) <= 1, missed  # of 95 % intervals


def test_intervals_are_as_wide_as_those_of_the_constants() -> None:
    found = from_currents(SPRING)
    assert any("unknown torque constants" in note for note in found.notes)
    wide = {x.law.joints[0]: x.std["level"] / x.law.parameters["level"] for x in found.findings if "level" in x.std}
    assert min(wide[0], wide[1]) > 0.01  # 2.5 and 1.5 %, beside .3 % of noise


def test_an_error_within_the_interval_of_a_constant_is_no_gain() -> None:
    for known in (1, 2):
        found = from_currents(SPRING, known=known)
        assert found.verdict == "named" and all(x.law.effect.name != "torque_gain" for x in found.findings)
        assert np.all(found.after.held_out_r2 > 0.997)


def test_a_load_has_its_rivals() -> None:
    """No payload, body or gain is certain beside the others."""
    found = from_currents(PAYLOAD, stated=STATED)
    loads = [x for x in found.findings if x.law.effect.name in ("payload", "link_inertia", "torque_gain")]
    assert loads
    for finding in loads:
        rivals = {x.law.effect.name for x in finding.alternatives} | {finding.law.effect.name}
        assert finding.probability <= 0.9 and rivals >= {"payload", "link_inertia", "armature", "torque_gain"}


def test_gains_widen_a_covariance_to_that_of_their_prior() -> None:
    """y = b + g with b known to .1 from other rows: at a fixed g, b has the slope -1."""
    prior = GainPrior(np.array([1]), np.array([[0.09]]), np.array([[0.09]]))
    posterior = np.array([[0.05, -0.04], [-0.04, 0.04]])
    widened = prior.widened(posterior, np.array([1]))
    assert widened == pytest.approx(np.array([[0.01 + 0.09, -0.09], [-0.09, 0.09]]))


def test_the_common_scale_is_no_gain_where_no_constant_is_known() -> None:
    model, own = simulation("3r", ()), np.diag([1e-4, 4e-4, 9e-4])
    gained, laws = with_estimated_gains(model, own + 0.04)
    assert gained.laws == laws and len(laws) == 3
    prior = gain_prior(enumerate(laws))
    assert np.diag(prior.covariance) == pytest.approx(np.diag(own) + 0.04)
    assert np.all(np.diag(prior.beside_bodies) < 2 * np.diag(own) + 1e-6)
    known = own.copy()
    known[0] = known[:, 0] = 0
    gained, laws = with_estimated_gains(
        replace(model, laws=(Law(EFFECTS["torque_gain"], (1,), {"error": 0.2}),)), known
    )
    assert [(law.joints, law.parameters["error"] > 0.1) for law in laws] == [((1,), True), ((2,), False)]
    assert gained.laws == laws and with_estimated_gains(model, None) == (model, ())
