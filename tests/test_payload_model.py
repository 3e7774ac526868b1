"""Models with a load: `payload` of a saved model, sums of loads, and their uncertainty."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import polars as pl
import pytest
from exported import model_of, states
from numpy.testing import assert_allclose
from test_payload import ARM, CENTRE, columns, recording, robot

import signid
from signid.cli import run
from signid.errors import OptionError
from signid.model import load_model
from signid.payload import Load, carried, payload, with_payload
from signid.types import Array


def body(mass: float, centre: Array, inertia: Array) -> Array:
    return np.asarray(pin.Inertia(mass, centre, inertia).toDynamicParameters())


BOX = body(1.2, CENTRE, np.array([[0.004, 0.0005, 0], [0.0005, 0.003, -0.0002], [0, -0.0002, 0.005]]))
ERRORS = np.diag(np.array([0.01, *[0.001] * 3, *[1e-4] * 6]) ** 2)


@pytest.mark.slow
def test_a_saved_model_weighs_as_its_description_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, mass, seed in (("bare", 0.0, 1), ("loaded", 0.4, 2)):
        pl.DataFrame(columns(ARM, mass, seed)).write_csv(f"{name}.csv")
    load_model(robot(ARM)).save("model.json")
    sides = ["--without", "bare.csv", "--with", "loaded.csv"]
    assert run(["payload", "model.json", *sides, "-o", "out"]) == 0
    found = payload(robot(ARM), [recording(ARM, 0.0, 1)], [recording(ARM, 0.4, 2)])
    model = load_model("out/model.json")
    loaded = carried(model)
    assert loaded is not None and (tmp_path / "out" / "payload.json").is_file()
    assert_allclose(loaded.inertial, found.inertial, rtol=1e-9)
    assert_allclose(loaded.covariance, found.covariance, rtol=1e-5, atol=1e-12)
    assert loaded.mass[1] == pytest.approx(found.mass[1], rel=1e-4)
    capfd.readouterr()
    assert run(["payload", "out/model.json", *sides, "-o", "out"]) == 2
    assert "is read by this command; give another name with -o" in capfd.readouterr().err
    assert run(["payload", "out/model.json", *sides, "-o", "twice"]) == 0
    twice = carried(load_model("twice/model.json"))
    assert twice is not None
    assert twice.mass == pytest.approx((2 * found.mass[0], np.sqrt(2) * found.mass[1]), rel=1e-4)


def test_the_torque_is_that_of_the_body(tmp_path: Path) -> None:
    model = with_payload(with_payload(load_model("ur10"), BOX, ERRORS), 0.5 * BOX, ERRORS)
    motion = states(model.robot)
    heavy = load_model("ur10").inertials.copy()
    heavy[-1] += 1.5 * BOX
    assert_allclose(model.inverse(motion), replace(load_model("ur10"), inertials=heavy).inverse(motion), atol=1e-9)
    assert [law.effect.name for law in model.laws].count("payload") == 1
    again = load_model(model.save(tmp_path / "model.json"))
    assert again.payload_covariance is not None
    assert_allclose(again.payload_covariance, 2 * ERRORS, rtol=1e-6)
    bare = with_payload(model, -1.5 * BOX - ERRORS[0], ERRORS)  # the mass that is left lies within its errors
    assert carried(bare) is None and bare.payload_covariance is None


def test_a_point_mass_has_no_inertia_about_its_centre() -> None:
    model = with_payload(load_model("3r"), np.array([0.3, 0.01, 0.0, 0.02]), np.eye(4) * 1e-6)
    loaded = carried(model)
    assert loaded is not None
    inertia, std = loaded.inertia
    assert_allclose(inertia, 0.0, atol=1e-15)
    assert np.all(np.isinf(std)) and np.isfinite(loaded.mass[1]) and np.all(np.isfinite(loaded.centre[1]))
    assert carried(load_model("3r")) is None
    assert carried(with_payload(model_of("3r", "payload:mass=0.3"), BOX, ERRORS)) is not None
    assert with_payload(model_of("3r", "payload:mass=0.3"), BOX, ERRORS).payload_covariance is None  # one is unknown


def test_an_identified_model_is_less_sure_of_its_last_link() -> None:
    fitted = signid.identify(robot(ARM), [recording(ARM, 0.0, 1)], held_out=[recording(ARM, 0.0, 2)]).model
    loaded = with_payload(fitted, BOX, ERRORS)
    assert fitted.covariance is not None and loaded.covariance is not None
    grown = loaded.covariance.matrix - fitted.covariance.matrix
    last = fitted.covariance.combination[:, 20:30]
    assert_allclose(grown, last @ ERRORS @ last.T, atol=1e-12)
    with pytest.raises(OptionError, match="the recordings have no position of joint_3"):
        some = {k: x for k, x in columns(ARM, 0.0, 1).items() if not k.endswith("_3")}
        payload(fitted, signid.read_recording(some, fitted.robot))


def test_impossible_loads_are_refused() -> None:
    with pytest.raises(OptionError, match=r"carries 0 kg, so 1\.2 kg cannot be taken off"):
        with_payload(load_model("3r"), -BOX)
    with pytest.raises(OptionError, match="variance that is not positive"):
        with_payload(load_model("3r"), BOX, 0 * ERRORS)
    with pytest.raises(OptionError, match=r"has 4 or 10 finite numbers .*, not shapes \(4,\) and \(10, 10\)"):
        with_payload(load_model("3r"), BOX[:4], ERRORS)


def test_a_load_in_another_frame() -> None:
    frame = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.5, 1.1), np.array([0.02, -0.1, 0.2]))
    seen = Load(BOX, ERRORS).seen_from(frame)
    assert_allclose(seen.inertial, frame.actInv(pin.Inertia.FromDynamicParameters(BOX)).toDynamicParameters())
    assert_allclose(seen.seen_from(frame.inverse()).covariance, ERRORS, atol=1e-12)
    slope = frame.rotation.T @ np.column_stack([-CENTRE, np.eye(3)]) / BOX[0]  # of first moment over mass
    assert_allclose(seen.centre[1], np.sqrt(np.diag(slope @ ERRORS[:4, :4] @ slope.T)), rtol=1e-4)
    lost = ERRORS.copy()
    lost[9, 9] = np.inf
    assert np.isfinite(Load(BOX, lost).seen_from(frame).centre[1]).all()
    assert np.isinf(Load(BOX, lost).seen_from(frame).inertia[1]).all()
