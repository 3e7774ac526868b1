"""The misfit of an identified model: learned on rows that took no part, and distinguished from what has changed."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from motions import FRICTION, fourier

import signid
from signid.diagnose.data.noise import Noise, noise_of_misfit
from signid.identify import Identification
from signid.model import Model, load_model
from signid.regression.factors import Misfit, read_misfit
from signid.types import Array, Robot

RATE, SECONDS = 100.0, 30.0
UNKNOWN = 0.35  # N.m, size of a torque that no law of the library has at joint 2
STATED = Path(signid.__file__).parents[1] / "robots" / "3r" / "robot.urdf"


@cache
def arm() -> Robot:
    return signid.load_robot(STATED)


def recording(seed: int, *, dry: float = 1.0, unknown: float = UNKNOWN) -> signid.Recording:
    """A motion whose second joint has a torque of position and velocity that the library lacks; dry friction times."""
    robot, t = arm(), np.arange(0, SECONDS, 1 / RATE)
    q, v, a = fourier(3, t, seed)
    model = Model(robot, stated(robot), ())
    torque = model.inverse(signid_motion(robot, t, q, v, a))
    level = FRICTION["coulomb_friction"] * np.array([1.0, dry, 1.0])
    torque += FRICTION["viscous_friction"] * v + level * np.sign(v) + FRICTION["torque_offset"]
    torque += FRICTION["armature"] * a
    torque[:, 1] += unknown * np.sin(3 * q[:, 1] + 2 * v[:, 1])
    torque += 0.01 * np.random.default_rng(seed).standard_normal(torque.shape)
    return signid.read_recording({"t": t, "q": q, "tau": torque}, robot)


def stated(robot: Robot) -> Array:
    return np.array([body.toDynamicParameters() for body in list(robot.model.inertias)[1:]])


def signid_motion(robot: Robot, t: Array, q: Array, v: Array, a: Array) -> Any:
    from signid.regression.motion import Motion

    return Motion(robot, t, q, v, a)


@cache
def known() -> Identification:
    return signid.identify(arm(), [recording(1), recording(2), recording(3)])


def test_identification_learns_what_its_laws_leave() -> None:
    found, misfit = known(), known().model.misfit
    assert misfit is not None and found.fit.refit
    assert np.all(misfit.size <= 1.05 * found.fit.held_out_rms)  # without rows near reversals
    assert 0.5 * UNKNOWN / np.sqrt(2) < misfit.size[1] < 1.2 * UNKNOWN and misfit.size[0] < 0.1 * UNKNOWN
    row = found.session.task.band.factor / found.session.task.band.rate
    assert np.all(misfit.length >= row) and misfit.length[1] > 1.2 * row


def test_the_misfit_is_in_the_file_of_the_model(tmp_path: Path) -> None:
    model = known().model
    again = load_model(model.save(tmp_path / "model.json"))
    assert again.misfit is not None and model.misfit is not None
    np.testing.assert_allclose(again.misfit.size, model.misfit.size, rtol=1e-3)
    np.testing.assert_allclose(again.misfit.length, model.misfit.length, rtol=1e-3)
    assert read_misfit(None, arm().joints) is None
    part = read_misfit({"cutoff": 5.0, "joints": {"joint_2": {"rms": 0.2, "length": 0.1}}}, arm().joints)
    assert part is not None and np.isnan(part.size[[0, 2]]).all() and part.size[1] == 0.2


def test_a_model_that_nothing_was_held_out_for_knows_no_misfit() -> None:
    short = recording(1).read()
    part = signid.read_recording({"t": short.t[:700], "q": short.q[:700], "tau": short.tau[:700]}, arm())
    found = signid.identify(arm(), [part])
    assert (found.model.misfit is None) == found.session.judges_itself


@pytest.mark.slow
def test_nothing_has_changed_on_another_motion() -> None:
    found = signid.diagnose(known().model, [recording(5), recording(6)])
    assert all(finding.law.joints == (1,) for finding in found.causes)  # where the model lacked a law from the start
    assert found.question == ("lacked" if found.causes else "changed")
    assert any("nothing has changed since the model was identified" in note for note in found.notes)


@pytest.mark.slow
def test_a_change_beyond_the_misfit_is_named() -> None:
    found = signid.diagnose(known().model, [recording(5, dry=2.5), recording(6, dry=2.5)])
    assert (found.verdict, found.question) == ("named", "changed")
    (cause,) = found.causes
    assert (cause.law.effect.name, cause.law.joints) == ("coulomb_friction", (1,))
    assert cause.probability > 0.9
    assert any("changed since the model was identified" in note for note in found.notes)


def test_a_wider_band_holds_more_of_the_misfit_and_rows_within_its_length_count_as_one() -> None:
    zero = np.zeros(2)
    noise = Noise(np.array([0.01, 0.01]), np.full((2, 4), 0.1), np.array([0.01, 0.01]), zero + 0.3, zero + 0.01, zero)
    band = cast(Any, SimpleNamespace(cutoff=8.0, rate=100.0, factor=5))
    now = noise_of_misfit(noise, Misfit(np.array([0.2, np.nan]), np.array([0.2, np.nan]), 2.0), band)
    assert now.floor == pytest.approx([0.4, 0.01]) and now.innovation == pytest.approx([0.4 * 2.0, 0.01])
    assert not now.coefficients.any() and not now.discrepancy.any() and now.saturated_floor[0] == now.floor[0]
