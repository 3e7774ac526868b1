"""Regression tests of diagnoses: a spring named as degrees, a contact as noise, worse joints as causes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from diagnosed import fault, look, named, read, recorded, simulation

import signid
from signid.errors import OptionError

CONTACT = fault("external_contact", force_x=3.0, force_y=-2.0, force_z=4.0, start=11.0, end=13.0)


@pytest.mark.slow
def test_a_spring_is_not_named_as_degrees() -> None:
    assert named(look("3r", fault("spring", 3, stiffness=0.5, rest=0.2))) == [("spring", (2,))]


def test_the_floor_is_noise_once_a_contact_is_named() -> None:
    found = look("3r", CONTACT)
    healthy = look("3r").after.irreducible_rms
    assert np.all(found.after.irreducible_rms < 2 * healthy) and found.tolerance < 0.03


@pytest.mark.slow
def test_causes_make_held_out_torque_better() -> None:
    planted = fault("crossed_torque", 2, partner="joint_3", amplitude=0.5, frequency=3.0)
    found = look("3r", planted, seconds=16.0)
    assert np.all(found.after.held_out_rms < 1.05 * found.before.held_out_rms) or not found.findings


def test_no_recording_gives_one_sentence() -> None:
    with pytest.raises(OptionError, match="at least one"):
        signid.diagnose(simulation("3r"), [])


def test_the_limit_of_a_drive() -> None:
    found = signid.diagnose(simulation("3r"), read("3r", recorded("3r", fault("torque_saturation", 2, limit=5.0))))
    assert named(found) == [("torque_saturation", (1,))]
    assert found.findings[0].law.parameters["limit"] == pytest.approx(5.0, rel=0.15)


@pytest.mark.slow
def test_intervals_include_unexplained_torque() -> None:
    spring, wave = fault("spring", 2, stiffness=1.0, rest=0.2), fault("velocity_wave", 2, amplitude=0.3, velocity=0.25)
    (alone,) = look("3r", spring).findings
    (beside,) = look("3r", spring, wave).findings
    assert all(beside.std[key] > 1.1 * alone.std[key] for key in alone.std)
    assert all(
        abs(beside.law.parameters[key] - x) < 3 * beside.std[key] for key, x in (("stiffness", 1.0), ("rest", 0.2))
    )


def test_unexplained_torque_becomes_empirical_torque(tmp_path: Path) -> None:
    planted = fault("velocity_wave", 2, amplitude=1.0, velocity=0.25)
    found = look("3r", planted)
    assert found.verdict == "unknown" and [one.joint for one in found.unexplained if one.modelled] == [1]
    assert [law.joints for law in found.model.laws if law.effect.name == "empirical"] == [(1,)]
    assert found.after.held_out_rms[1] < 0.9 * found.before.held_out_rms[1]
    text = found.model.document()
    (entry,) = [one for one in text["effects"] if one["effect"] == "empirical"]
    assert entry["joint"] == "joint_2" and set(entry["parameters"]) >= {"variable", "knot_1", "value_8"}
    (tmp_path / "model.json").write_text(json.dumps(text))
    assert signid.load_model(tmp_path / "model.json").document() == text


SKIPPED = ("spring", "torque_ripple", "counterbalance", "cable_torque", "link_inertia", "payload")


@pytest.mark.parametrize("seconds", [4.0, 6.0])
def test_what_the_rows_cannot_tell_is_undecided_and_changes_no_number(seconds: float) -> None:
    """The residual of joint_2 is seven times the noise; held-out rows confirm no other bodies."""
    planted = fault("spring", 2, stiffness=0.6, rest=0.2)
    found = look("3r", planted, motions=1, seconds=seconds, skip=SKIPPED)
    assert found.verdict == "undecided" and not found.causes
    assert found.before.train_rms[1] > 5 * found.before.irreducible_rms[1]
    assert any("of the torque of joint_2 unexplained" in flag for flag in found.flags)
    assert found.model.document() == simulation("3r").document()
    assert np.array_equal(found.after.held_out_rms, found.before.held_out_rms)
