"""Roll-outs: the true model stays near, a model that lacks a law strays, and effects of recording laws are undone."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from arm import arm, harmonics
from numpy.testing import assert_allclose, assert_array_less

import signid
from signid.effects import EFFECTS
from signid.effects.base import RecordingLaw, Trial
from signid.errors import OptionError, RecordingError
from signid.model import Model, load_model, stated_inertials
from signid.regression.motion import Motion
from signid.regression.session import Options, prepare
from signid.simulation.plant import Simulation, simulate, track
from signid.simulation.rollout import RollOut, roll_out
from signid.types import Array, Law, Recording

ALL = (0, 1, 2)
USUAL = {"viscous_friction": 1.0, "coulomb_friction": 1.5, "armature": 0.2}
ROOT = Path(__file__).parents[1]


def law(name: str, *joints: int, **parameters: float) -> Law:
    return Law(EFFECTS[name], joints, parameters or EFFECTS[name].example)


@cache
def bare() -> Model:
    return Model(arm(), stated_inertials(arm()))


@cache
def usual() -> Model:
    drives = (Law(EFFECTS[key], (j,), EFFECTS[key].physical([x], {})) for key, x in USUAL.items() for j in ALL)
    return replace(bare(), laws=tuple(drives))


def more(*laws: Law) -> Model:
    return replace(usual(), laws=(*usual().laws, *laws))


def run(model: Model, seconds: float = 6.0) -> Simulation:
    return simulate(model, track(bare(), harmonics(seconds, 1)), seconds)


def recording(made: Simulation, noise: float = 0.0, every: int = 1, **columns: Array) -> Recording:
    rng = np.random.default_rng(0)
    tau = made.tau + noise * made.tau.std(0) * rng.standard_normal(made.tau.shape)
    table = {"t": made.t, "q": made.q, "tau": tau, **columns}
    return signid.read_recording({key: x[::every] for key, x in table.items()}, arm())


@cache
def healthy() -> Simulation:
    return run(usual(), 10.0)


def test_the_true_model_strays_by_integrated_noise_alone() -> None:
    found = roll_out(usual(), recording(healthy()))
    assert found.error.shape == (48, 500, 3) and found.unit == ("rad",) * 3 and found.notes == ()
    assert_array_less(found.rms(0.2), 2e-4)
    assert_array_less(found.rms(0.5), 1e-3)
    assert_array_less(roll_out(usual(), recording(healthy(), noise=0.02)).rms(0.5), 3e-3)


def test_a_model_that_lacks_friction_strays_at_that_joint() -> None:
    heard = recording(healthy(), noise=0.02)
    lacking = replace(
        usual(), laws=tuple(x for x in usual().laws if (x.effect.name, x.joints) != ("coulomb_friction", (1,)))
    )
    good, poor = roll_out(usual(), heard), roll_out(lacking, heard)
    for measure in (RollOut.rms, RollOut.median):
        assert measure(poor, 0.5)[1] > 10 * measure(good, 0.5)[1]
    document = json.loads(json.dumps(good.document(poor)))
    assert document["unit"] == ["rad"] * 3 and document["horizon"] == 0.5
    assert_allclose(document["after_rms"], good.rms(0.5))
    assert_allclose(document["before_rms"], poor.rms(0.5))


@pytest.mark.parametrize("integrator", ["semi-implicit", "rk4"])
@pytest.mark.parametrize("step", [5e-4, 2e-3])
def test_the_step_hardly_matters(integrator: str, step: float) -> None:
    found = roll_out(usual(), recording(healthy()), step=step, integrator=integrator, windows=12)
    assert found.step == pytest.approx(step)
    assert_array_less(found.rms(0.5), 2e-3)


ALONE = (
    "torque_gain torque_sign encoder_offset presliding_friction joint_elasticity backlash friction_drift load_friction"
)
TOGETHER = "time_delay torque_lag external_contact base_tilt"
LAWS = (
    *(law(name, 1) for name in ALONE.split()),
    *(law(name, *ALL) for name in TOGETHER.split()),
    law("channel_swap", 0, 1),
    law("payload", 2),
    law("torque_saturation", 1, limit=15.0),
)


@pytest.mark.slow_cases(but="elasticity|torque_gain|time_delay|payload")
@pytest.mark.parametrize("added", LAWS, ids=lambda x: x.effect.name)
def test_every_kind_of_law_is_rolled_out(added: Law) -> None:
    model = more(added)
    heard = recording(run(model))
    knowing, ignorant = (roll_out(m, heard, windows=24) for m in (model, usual()))
    assert_array_less(knowing.rms(0.2), 1e-3)
    assert knowing.rms(0.2).max() < 0.2 * ignorant.rms(0.2).max()


RECORDING = [x for x in LAWS if isinstance(x.effect, RecordingLaw)]


@pytest.mark.parametrize("added", RECORDING, ids=lambda x: x.effect.name)
def test_records_are_undone(added: Law) -> None:
    t, width = np.arange(0, 3, 1e-3), len(added.joints)
    torque = 10 * np.sin(2 * np.pi * np.array([1.0, 3.0, 8.0][:width]) * t[:, None] + np.arange(width))
    x = Trial(torque / 7, torque, t=t[:, None], dt=1e-3, torque=torque, joints=added.joints)
    q, tau = added.effect.recorded_q(x, **added.parameters), added.effect.recorded_torque(x, **added.parameters)
    written = Trial(q, torque, t=t[:, None], dt=1e-3, torque=tau, joints=added.joints)
    inner = slice(50, -50)
    assert_allclose(added.effect.acted_q(written, **added.parameters), torque / 7, atol=1e-12)
    assert_allclose(added.effect.acted_torque(written, **added.parameters)[inner], torque[inner], atol=1e-3)


CHAIN = (law("base_tilt", *ALL), law("payload", 2), law("encoder_offset", 1), law("torque_gain", 1),
         law("channel_swap", 0, 2), law("time_delay", *ALL))  # fmt: skip


def test_inverse_dynamics_give_the_recorded_torque() -> None:
    smooth = tuple(x for x in usual().laws if x.effect.name != "coulomb_friction")
    model = replace(usual(), laws=(*smooth, *CHAIN))
    made = run(model, 4.0)
    motion = Motion(arm(), made.t, made.q, made.true_v, made.true_a, recorded=made.tau)
    inner = slice(200, -200)
    assert_allclose(model.inverse(motion)[inner], made.tau[inner], atol=0.02)
    acted = model.acted(motion)
    assert acted.recorded is not None
    assert_allclose(acted.q, made.true_q, atol=1e-12)
    assert_allclose(acted.recorded[inner], made.applied[inner], atol=0.02)


def test_a_joint_without_torque_follows_its_measured_motion() -> None:
    made = healthy()
    columns = {f"{key}_{j + 1}": getattr(made, key)[:, j] for key in ("q", "tau") for j in ALL}
    del columns["tau_2"]
    found = roll_out(usual(), signid.read_recording({"t": made.t, **columns}, arm()), windows=12)
    assert np.isnan(found.rms(0.5)[1])
    assert_array_less(found.rms(0.5)[[0, 2]], 1e-3)
    assert found.document(found)["after_rms"][1] is None


def test_joints_that_the_recording_lacks_are_held() -> None:
    held = signid.load_robot("3r", lock={"joint_3": 0.0})
    model = Model(held, stated_inertials(held), tuple(law("armature", j, inertia=0.2) for j in (0, 1)))
    wide = load_model("3r")
    drives = tuple(law("armature", j, inertia=0.2) for j in ALL)
    wide = replace(wide, laws=(*drives, law("payload", 2), law("joint_coupling", 0, 2)))
    t = np.arange(0, 5, 2e-3)
    q = 0.5 * np.sin(2 * t)[:, None] * [1.0, -0.7]
    v, a = np.cos(2 * t)[:, None] * [1.0, -0.7], -2 * np.sin(2 * t)[:, None] * [1.0, -0.7]
    heard = signid.read_recording({"t": t, "q": q, "tau": model.inverse(Motion(held, t, q, v, a))}, held)
    alike = replace(wide, laws=drives)
    assert_allclose(roll_out(alike, heard).error, roll_out(model, heard).error, atol=1e-12)
    assert_array_less(roll_out(model, heard).rms(0.5), 1e-4)
    assert roll_out(wide, heard).notes == ("joint_coupling is left out: one of its joints is held",)
    assert roll_out(wide, heard).rms(0.5)[1] > 1e-3  # its payload is there
    with pytest.raises(RecordingError, match="lacks or holds;"):
        roll_out(model, signid.read_recording({"t": t, "q": np.c_[q, q[:, :1]], "tau": np.c_[q, q[:, :1]]}, wide.robot))


def test_impossible_roll_outs_are_refused() -> None:
    heard = recording(healthy())
    unsigned = replace(heard, signed=np.array([True, False, True]))
    for given, match in ((unsigned, "torque of j2 has no sign"), ([], "no recording"),
                         ([heard, recording(healthy(), every=2)], "roll out each by itself")):  # fmt: skip
        with pytest.raises((OptionError, RecordingError), match=match):
            roll_out(usual(), given)
    for options, match in (({"horizons": (0.0,)}, "longer than 0 s"), ({"horizons": ()}, "horizons are none"),
                           ({"windows": 0}, "at least one window"), ({"step": 0.0}, "positive step")):  # fmt: skip
        with pytest.raises(OptionError, match=match):
            roll_out(usual(), heard, **options)
    with pytest.raises(RecordingError, match="choose shorter horizons"):
        roll_out(usual(), heard, horizons=(20.0,))


def test_a_model_that_flies_apart_says_so() -> None:
    hollow = replace(usual(), inertials=1e-6 * usual().inertials, laws=())
    found = roll_out(hollow, recording(healthy()), windows=4)
    assert not np.isnan(found.error).any()
    assert np.isinf(found.rms(0.5)).any()


def test_a_ur10e_within_half_a_second(data: Path) -> None:
    folder = data / "ur10e_mamedov"
    robot = signid.load_robot(folder / "ur10e.urdf", actuators=ROOT / "robots" / "ur10e" / "actuators.toml")
    names = ("20_02_10_30sec_12harm", "20_02_12_50sec_12harm")
    learn, judge = (signid.read_recording(folder / f"identification_data__{name}.csv.gz", robot) for name in names)
    found = signid.identify(robot, [learn], held_out=[judge])
    after = roll_out(found.model, judge)
    assert_array_less(after.median(0.5), 0.03)
    before = roll_out(Model(found.robot, stated_inertials(found.robot)), judge)
    assert_array_less(20 * after.median(0.5), before.median(0.5))


def test_an_emps_within_half_a_second(data: Path) -> None:
    robot, folder = signid.load_robot("emps"), data / "emps_janot"
    learn, judge = (signid.read_recording(folder / f"emps_{name}.csv.gz", robot) for name in ("train", "pulses"))
    after = roll_out(signid.identify(robot, [learn], held_out=[judge]).model, judge)
    assert after.unit == ("m",) and after.rms(0.5)[0] < 0.002


def test_windows_keep_clear_of_gaps_and_of_each_other() -> None:
    made = healthy()
    q = made.q.copy()
    q[4000:4300] = np.nan
    found = roll_out(usual(), recording(made, q=q), windows=8)
    assert np.isfinite(found.error).all() and len(found.start) == 8
    assert not np.any((found.start < 4.3) & (found.start + 0.5 > 4.0))
    assert_array_less(0.5, np.diff(found.start))
    assert_array_less(found.rms(0.5), 1e-3)


def test_several_recordings_and_sessions() -> None:
    heard, other = recording(healthy()), recording(run(usual()), every=1)
    found = roll_out(usual(), [heard, other], windows=16)
    assert np.bincount(found.recording).tolist() == [10, 6]
    session = prepare(arm(), [heard], [other], Options(effects=tuple(USUAL)))
    assert_array_less(roll_out(usual(), session).rms(0.5), 1e-3)
    with pytest.raises(OptionError, match="use the same recordings for both models"):
        found.document(roll_out(usual(), other))
    with pytest.raises(OptionError, match="choose one from 0.001 to 0.5 s"):
        found.rms(0.7)
