"""Friction models beside each other: equations of BAM, recovery of each model from its own recordings, the output."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from bam_plant import Pendulum, commands
from servo_loops import pendulum
from servo_results import invented

from signid.cli import run
from signid.errors import OptionError
from signid.model import load_model, with_servos
from signid.servo.compare import compare_models
from signid.servo.friction_models import MODELS
from signid.servo.identify import FrictionModel, identify_servos
from signid.servo.plant import grids_of_arrays, roll_out
from signid.servo.plant.torque import gear_bound
from signid.servos import LOOP_NUMBERS, Servo
from signid.types import Array

RATE, SECONDS, NOISE = 100.0, 8.0, 2e-4  # [Hz], [s] of a recording, [rad]
PLAIN = Servo(kp=8.0, kd=0.1, armature=0.004, coulomb_friction=0.04)
STRIBECK = {"gear_exponent": 1.35, "gear_velocity": 0.3, "gear_level": 0.08}
LOADED = {"gear_exponent": 1.35, "gear_load": 0.12}
DIRECTED = {**STRIBECK, "gear_load": 0.2, "gear_external": 0.3, "gear_load_at_rest": 0.15, "gear_external_at_rest": 0.3}
TRUTHS: dict[str, dict[str, float]] = {
    "M1": {},
    "M2": STRIBECK,
    "M3": LOADED,
    "M5": DIRECTED,
    "M6": {**DIRECTED, "gear_quadratic_motor": 0.1, "gear_quadratic_external": 0.4},
}
LACKS = {
    "M1": (),
    "M2": ("M1", "M3", "PACE"),
    "M3": ("M1", "M2", "PACE"),
    "M5": ("M1", "M2", "M3", "M4", "PACE"),
    "M4": ("M1", "M2", "M3", "PACE"),
    "M6": ("M1", "M2", "M3", "M4", "M5", "PACE"),
    "PACE": ("M1", "M2", "M3", "M4", "M5", "M6"),
}


def measured(truth: Servo, seed: int) -> Array:
    """Positions (N,) [rad] of the closed loop of signid under `commands`."""
    u = commands(seed, SECONDS, RATE)
    t = np.arange(len(u)) / RATE
    grid = grids_of_arrays(("swing",), t, u[:, None], u[:, None], rate=RATE)[0]
    return roll_out(with_servos(load_model(pendulum()), {"swing": truth}), {"swing": truth}, grid)[:, 0]


def recorded(folder: Path, positions: dict[int, Array]) -> list[str]:
    """Recordings of positions by the seed of their commands."""
    for seed, q in positions.items():
        noisy = q + NOISE * np.random.default_rng(seed).standard_normal(len(q))
        table = {"t": np.arange(len(q)) / RATE, "q_swing": noisy, "q_des_swing": commands(seed, SECONDS, RATE)}
        pl.DataFrame(table).write_csv(folder / f"{seed}.csv")
    return [str(folder / f"{seed}.csv") for seed in positions]


def compared(files: list[str]) -> dict[str, FrictionModel]:
    """Friction models by name; the last file is held out."""
    found = identify_servos(pendulum(), files[:-1], held_out=files[-1:])
    return {one.name: one for one in compare_models(found, files[:-1], held_out=files[-1:]).friction_models}


def test_gears_have_the_bound_of_bam() -> None:
    bam = Pendulum(
        friction_base=0.0, friction_stribeck=0.08, load_motor=0.2, load_external=0.06, load_motor_stribeck=0.15,
        load_external_stribeck=0.045, motor_quad=0.1, external_quad=0.4,
    )  # fmt: skip
    p = np.array([TRUTHS["M6"].get(name, 0.0) for name in LOOP_NUMBERS])
    rng = np.random.default_rng(0)
    for motor, external, v in rng.uniform(-1.0, 1.0, (50, 3)).tolist():
        assert gear_bound.py_func(p, motor, -external, v) == pytest.approx(bam.bound(motor, external, v))


@pytest.mark.slow
@pytest.mark.parametrize("name", TRUTHS)
def test_a_model_is_recovered_and_has_the_evidence(name: str, tmp_path: Path) -> None:
    truth = PLAIN.with_(**TRUTHS[name])
    found = compared(recorded(tmp_path, {seed: measured(truth, seed) for seed in (1, 2, 3)}))
    evidence = {other: one.log_bayes_factor for other, one in found.items()}
    assert evidence[name] > max(evidence.values()) - 3, "models that contain it are not better"
    assert all(evidence[other] < evidence[name] - 20 for other in LACKS[name])
    assert found[name].rms[0] < 4e-4 and found[name].mean_absolute[0] < found[name].rms[0]
    for number in found[name].numbers["swing"].values():
        true = truth.damping if number.name == "damping" else getattr(truth, number.name)
        assert number.value is not None and number.std is not None
        assert abs(number.value - true) < 4 * number.std + 0.005 * abs(true), number.name
    assert np.isnan(found["identified"].probability)
    assert sum(one.probability for one in found.values() if one.name != "identified") == pytest.approx(1.0)
    if name == "M1":
        numbers = found["M6"].numbers["swing"]
        assert all(numbers[key].value is None for key in ("gear_level", "gear_load", "gear_quadratic_external"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["M4", "PACE"])
def test_a_plant_of_other_code_has_the_evidence_of_its_model(name: str, tmp_path: Path) -> None:
    """Explicit Euler with stops at .1 ms; what remains of the substeps of the fit lets M5 and M6 gain a little."""
    loads = {"load_motor": 0.12, "load_external": 0.12, "load_motor_stribeck": 0.12, "load_external_stribeck": 0.12}
    plant = Pendulum(friction_stribeck=0.08, **loads) if name == "M4" else Pendulum(encoder=0.03)
    found = compared(recorded(tmp_path, {s: plant.record(commands(s, SECONDS, RATE), RATE) for s in (1, 2, 3)}))
    evidence = {other: one.log_bayes_factor for other, one in found.items()}
    assert evidence[name] > max(evidence.values()) - 10
    assert all(evidence[other] < evidence[name] - 50 for other in LACKS[name])
    assert found[name].rms[0] < 0.6 * found["M1"].rms[0]
    values = {key: number.value for key, number in found[name].numbers["swing"].items()}
    if name == "PACE":
        assert values["encoder_offset"] == pytest.approx(0.03, abs=5e-4)
        assert "torque_offset" not in values
    else:
        assert (values["gear_load"], values["gear_load_at_rest"]) == pytest.approx((0.12, 0.12), abs=0.005)
        assert values["gear_level"] == pytest.approx(0.08, abs=0.005)


def test_the_table_is_on_the_terminal_on_the_page_and_in_the_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = recorded(tmp_path, {seed: measured(PLAIN.with_(**LOADED), seed) for seed in (1, 2)})
    out, arm = tmp_path / "out", tmp_path / "arm.urdf"
    arm.write_text(pendulum().document, encoding="utf-8")
    given = [str(arm), files[0], "--held-out", files[1], "--compare-models", "-o", str(out)]
    assert run(["identify", *given]) in (0, 3)
    shown = capsys.readouterr().out
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "N.m.s/rad" in page and not re.search(r"± \S+ (1|s)[,<]", page)
    assert re.search(r"\d mrad", shown)
    assert "Friction models" in shown and "Friction models" in page and "squares of the loads" in page
    models = json.loads((out / "identification.json").read_text(encoding="utf-8"))["servo"]["friction_models"]
    assert [one["model"] for one in models] == [model.name for model in MODELS]
    m3 = models[2]
    assert m3["held_out"] and m3["rms"][0] < 0.3 * models[0]["rms"][0] and m3["log_bayes_factor"] > 20
    assert m3["joints"]["swing"]["gear_load"]["value"] == pytest.approx(0.12, abs=0.002)


@pytest.mark.parametrize("start", [None, object()])
def test_other_recordings_are_refused(start: Any, tmp_path: Path) -> None:
    files = recorded(tmp_path, {1: measured(PLAIN, 1)})
    with pytest.raises(OptionError, match="other recordings than identify_servos"):
        compare_models(replace(invented(), robot=pendulum(), start=start), files)
