"""Validation of given models: rms, noise floor, R2 and roll-outs on identical rows, nothing fitted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import signid
from signid.effects import EFFECTS
from signid.errors import OptionError, RecordingError
from signid.identify import Identification
from signid.model import Model, stated_inertials, stated_laws
from signid.output.report.results.validation import validation_document
from signid.regression.session import Options
from signid.types import Array, Law, Recording, Robot
from signid.validate import Validation, validate

HERE = Path(__file__).parents[1] / "robots" / "3r"
SMOOTH = ("viscous_friction", "torque_offset", "armature")  # laws that do not jump where a joint reverses


@cache
def robot() -> Robot:
    return signid.load_robot("3r")


@cache
def described() -> Model:
    return signid.load_model("3r")


@cache
def recording(name: str = "held_out", unsigned: bool = False) -> Recording:
    return signid.read_recording(HERE / f"{name}.parquet", robot(), unsigned=unsigned)


@cache
def identified(*effects: str) -> Identification:
    options = Options(effects=effects) if effects else None
    return signid.identify(robot(), [recording("recording")], held_out=[recording()], options=options)


@cache
def both() -> Validation:
    return validate({"description": described(), "identified": identified().model}, recording())


def changed(**columns: Array) -> Recording:
    """The held-out recording with some columns replaced."""
    samples = recording().read()
    given = {f"{key}_{j + 1}": getattr(samples, key)[:, j] for key in ("q", "tau") for j in range(3)}
    return signid.read_recording({"t": samples.t, **given, **columns}, robot())


def test_the_rms_is_the_one_that_identify_holds_out() -> None:
    """Identify leaves rows near reversals out where a law jumps there; without such a law the rows are the same."""
    found = identified(*SMOOTH)
    given = validate(found.model, recording(), options=Options(cutoff=found.cutoff), rollout=False)
    assert given.cutoff == found.cutoff
    fit = given.models[0].fit
    assert_allclose(fit.held_out_rms, found.fit.held_out_rms, rtol=0, atol=1e-9)
    assert_allclose(fit.held_out_r2, found.fit.held_out_r2, rtol=0, atol=1e-9)
    jumps = identified()
    given = validate(jumps.model, recording(), options=Options(cutoff=jumps.cutoff), rollout=False)
    rms = given.models[0].fit.held_out_rms
    assert_allclose(rms[1], jumps.fit.held_out_rms[1], rtol=0, atol=1e-9)  # all its rows are far from reversals
    assert_allclose(rms, jumps.fit.held_out_rms, rtol=0.05)


def test_models_are_compared_on_the_same_rows() -> None:
    first, second = both().models
    assert (first.name, second.name) == ("description", "identified")
    assert_array_equal(first.t, second.t)
    assert_array_equal(np.isnan(first.residual), np.isnan(second.residual))
    assert_allclose(first.torque, second.torque, atol=1e-12)
    assert_array_equal(first.fit.noise_floor, second.fit.noise_floor)
    assert first.rollout is not None and second.rollout is not None
    assert_array_equal(first.rollout.start, second.rollout.start)
    alone = validate(identified().model, recording()).models[0]
    assert_array_equal(alone.fit.held_out_rms, second.fit.held_out_rms)


def test_figures_are_those_of_the_rows() -> None:
    for one in both().models:
        assert_allclose(one.fit.held_out_rms, np.sqrt(np.nanmean(one.residual**2, axis=0)))
        assert_allclose(one.fit.held_out_r2, 1 - np.nanmean(one.residual**2, axis=0) / np.nanvar(one.torque, axis=0))
        assert np.isnan(one.fit.train_rms).all() and one.fit.unit == ("N.m",) * 3
    first, second = both().models
    assert np.all(second.fit.held_out_rms < 0.1 * first.fit.held_out_rms) and np.all(second.fit.held_out_r2 > 0.99)
    assert np.all(second.fit.held_out_rms > second.fit.noise_floor)
    assert first.rollout is not None and second.rollout is not None
    assert np.all(second.rollout.rms(0.5) < 0.02 * first.rollout.rms(0.5))
    assert both().flags == () and "description predicts little of the torque of joint_1" in " ".join(both().notes)


def test_the_residual_is_the_missing_law() -> None:
    """The torque of a law that one of two models lacks is what their residuals differ by."""
    law = Law(EFFECTS["torque_offset"], (1,), {"offset": 0.25})
    model = identified().model
    found = validate([model, replace(model, laws=(*model.laws, law))], recording(), rollout=False)
    first, second = found.models
    assert (first.name, second.name) == ("3r", "3r (2)")
    counted = np.isfinite(first.residual[:, 1])
    assert_allclose((first.residual - second.residual)[counted, 1], 0.25, atol=1e-9)
    assert first.rollout is None


def test_a_joint_that_stands_still_does_not_count() -> None:
    samples = recording().read()
    rests = samples.t < samples.t[0] + 3.0
    q = np.where(rests, samples.q[np.argmin(rests), 0], samples.q[:, 0])
    whole, part = both().models[1], validate(identified().model, changed(q_1=q), rollout=False).models[0]
    early = part.t < samples.t[0] + 2.0
    assert np.isnan(part.residual[early, 0]).all() and np.isfinite(part.residual[early, 1:]).all()
    assert np.isfinite(whole.residual).all()
    still = validate(described(), changed(q_1=np.full(len(q), 0.3)), rollout=False)
    assert np.isnan(still.models[0].fit.held_out_rms[0]) and np.isfinite(still.models[0].fit.held_out_rms[1:]).all()
    assert any("joint_1 has no rows" in note for note in still.notes)


def test_a_joint_without_torque_has_no_rms() -> None:
    samples = recording().read()
    given = {f"q_{j + 1}": samples.q[:, j] for j in range(3)}
    some = signid.read_recording({"t": samples.t, **given, "tau_2": samples.tau[:, 1]}, robot())
    fit = validate(described(), some, rollout=False).models[0].fit
    assert_array_equal(np.isfinite(fit.held_out_rms), [False, True, False])


def test_a_wrong_sign_is_flagged_once() -> None:
    negated = changed(tau_2=-recording().read().tau[:, 1])
    found = validate({"description": described(), "identified": identified().model}, negated, rollout=False)
    assert len(found.flags) == 1 and "the torque of joint_2 has the wrong sign" in found.flags[0]


def test_models_of_other_joints_are_flagged() -> None:
    locked = signid.load_robot("3r", lock={"joint_3": 0.0})
    other = Model(locked, stated_inertials(locked), stated_laws(locked))
    found = validate({"whole": described(), "locked": other}, recording())
    assert [one.fit.joints for one in found.models] == [("joint_1", "joint_2", "joint_3"), ("joint_1", "joint_2")]
    assert len(found.flags) == 1 and "locked lacks or holds joint_3, which the recordings move" in found.flags[0]
    assert_array_equal(found.models[0].t, found.models[1].t)
    assert_array_equal(found.models[0].fit.noise_floor[:2], found.models[1].fit.noise_floor)
    with pytest.raises(OptionError, match="panda moves .*, the recordings joint_1, joint_2, joint_3; give a model"):
        validate({"panda": signid.load_model("panda")}, recording())


def test_other_torque_constants_are_flagged() -> None:
    def driven(constant: float) -> Robot:
        drives = robot().actuators
        return replace(robot(), actuators=replace(drives, torque_constant=np.array([np.nan, constant, np.nan])))

    samples = recording().read()
    columns = {f"q_{j + 1}": samples.q[:, j] for j in range(3)} | {"current_2": samples.tau[:, 1] / 4}
    read = signid.read_recording({"t": samples.t, **columns}, driven(4.0))
    models = {str(k): replace(described(), robot=driven(k)) for k in (4.0, 5.0)}
    found = validate(models, read, rollout=False)
    assert len(found.flags) == 1 and "5.0 states another torque constant of joint_2" in found.flags[0]
    assert_allclose(*(one.fit.held_out_rms[1] for one in found.models))


def test_numbers_that_make_no_sense_are_flagged() -> None:
    law = Law(EFFECTS["viscous_friction"], (1,), {"coefficient": np.nan})
    found = validate({"right": described(), "nan": replace(described(), laws=(law,))}, recording(), rollout=False)
    assert len(found.flags) == 1 and "nan predicts a torque of joint_2 that is not finite" in found.flags[0]
    right, wrong = (one.fit.held_out_rms for one in found.models)
    assert np.isnan(wrong[1]) and np.isfinite(right).all()
    assert_array_equal(right[[0, 2]], wrong[[0, 2]])
    light = replace(described(), inertials=described().inertials * np.array([-1.0, *[1.0] * 9]))
    found = validate({"light": light}, recording())
    assert found.models[0].rollout is None and np.isfinite(found.models[0].fit.held_out_rms).all()
    assert any("light cannot be simulated" in flag for flag in found.flags)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda: ([], recording()), "no model was given"),
        (lambda: (described(), []), "no recording was given"),
        (lambda: (described(), [recording(), recording()]), "holds the same samples as"),
    ],
)
def test_bad_inputs_are_refused(given: object, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        validate(*given())  # type: ignore[operator]


def test_signs_are_not_recovered_here() -> None:
    with pytest.raises(RecordingError, match="has no sign of the torque of joint_1, joint_2, joint_3"):
        validate(described(), recording(unsigned=True))
    bare = recording()
    bare = replace(bare, columns={**bare.columns, "tau": ("", "", "")})
    with pytest.raises(RecordingError, match="has no torque to validate a model on"):
        validate(described(), bare)


def test_a_drive_identified_on_one_motion_predicts_another(data: Path) -> None:
    """EMPS: identified on its training motion, validated on one with pulses of force added to the controller's."""
    folder = data / "emps_janot"
    drive = signid.load_robot(folder / "emps.urdf")
    train, pulses = (signid.read_recording(folder / f"emps_{name}.csv.gz", drive) for name in ("train", "pulses"))
    model = signid.identify(drive, [train]).model
    found = validate({"described": signid.load_model(folder / "emps.urdf"), "identified": model}, pulses)
    described, given = found.models
    assert found.flags == () and given.fit.unit == ("N",)
    assert given.fit.held_out_r2[0] > 0.99 and given.fit.held_out_rms[0] < 0.2 * described.fit.held_out_rms[0]
    assert given.rollout is not None and given.rollout.rms(0.5)[0] < 0.005


def test_whole_recordings_are_simulated() -> None:
    robot = signid.load_robot("emps")
    t = np.arange(0, 4, 1e-3)
    tau = 60 * np.sin(4 * t)
    still = signid.read_recording({"t": t, "q_1": 0.01 * np.sin(4 * t), "tau_1": tau}, robot)
    free = Model(robot, stated_inertials(robot))
    found = validate(free, still, horizon="whole")
    one = found.models[0]
    assert found.horizon == "whole" and one.rollout is None and one.whole is not None
    assert one.whole.seconds == pytest.approx(4 - 0.021) and one.whole.rms[0] > one.whole.motion[0]
    assert any("leaves the motion (joint_1" in note for note in found.notes)
    shown = validation_document(found)["models"][0]["rollout"]
    assert shown["horizon"] == "whole" and shown["rms"] == one.whole.rms.tolist() and shown["unit"] == ("m",)


def test_a_horizon_can_be_chosen() -> None:
    found = validate(described(), recording(), horizon=0.3)
    rolled = found.models[0].rollout
    assert rolled is not None and rolled.horizons == (0.3,) and found.horizon == 0.3
    for wrong in (0.0, -1.0, float("nan"), "all"):
        with pytest.raises(OptionError, match="is neither a time above 0 s nor 'whole'"):
            validate(described(), recording(), horizon=wrong)


def test_several_recordings_are_pooled() -> None:
    given = [recording("recording"), recording()]
    found = validate(described(), given, rollout=False)
    assert [file.role for file in found.inputs] == ["recording"] * 2
    one = found.models[0]
    assert set(one.recording.tolist()) == {0, 1}
    parts = [one.residual[one.recording == k] for k in (0, 1)]
    assert_allclose(one.fit.held_out_rms**2 * len(one.t), sum(np.sum(part**2, axis=0) for part in parts))
