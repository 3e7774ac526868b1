"""Currents without signs whose torque constants are not known: found, or refused in a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from arm import arm
from motions import trial
from toys import LIMIT, joint, link, toy

import signid
from benchmarks.arms import ARMS, load
from benchmarks.plants.mujoco_ import Body, draw_motion, log, simulate
from signid.errors import InputError, OptionError, RecordingError
from signid.regression.session import Options, prepare
from signid.signs import Signs, prepare_and_recover, recover
from signid.types import Array, Recording, Robot

CONSTANTS = np.array([5.0, 3.0, 0.02])  # N.m/A
PENDULUM = (
    '<inertial><origin xyz="0 0 -0.5"/><mass value="4"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" '
    'izz="0.02"/></inertial>'
)


def stating(robot: Robot, known: Sequence[int]) -> Robot:
    """The robot with the torque constants of some joints."""
    constants = np.where(np.isin(range(len(robot.joints)), known), CONSTANTS[: len(robot.joints)], np.nan)
    return replace(robot, actuators=replace(robot.actuators, torque_constant=constants))


def heavier(robot: Robot, factor: float) -> Robot:
    """The robot with scaled inertials; 0: none."""
    model = robot.model.copy()
    for k in range(1, len(model.inertias)):
        scaled = factor * model.inertias[k].toDynamicParameters()
        model.inertias[k] = pin.Inertia.FromDynamicParameters(scaled) if factor else pin.Inertia.Zero()
    return replace(robot, model=model)


def currents(columns: dict[str, Array], n: int = 3) -> dict[str, Array]:
    """Absolute currents in place of torques."""
    others = {key: value for key, value in columns.items() if not key.startswith("tau_")}
    return others | {f"abs_current_{j + 1}": np.abs(columns[f"tau_{j + 1}"]) / CONSTANTS[j] for j in range(n)}


def made(robot: Robot, seed: int = 0, seconds: float = 12.0) -> dict[str, Array]:
    """Columns of a motion by formulas, with noise of 1 %."""
    motion = trial(robot, seed, seconds, 100.0)
    noise = np.random.default_rng(seed).standard_normal(motion.torque.shape)
    torque = motion.torque + 0.01 * np.sqrt(np.mean(motion.torque**2, axis=0)) * noise
    names = {"q": motion.q, "dq": motion.v, "ddq": motion.a, "tau": torque}
    return {"t": motion.t} | {f"{key}_{j + 1}": x[:, j] for key, x in names.items() for j in range(x.shape[1])}


def signs_of(robot: Robot, columns: dict[str, Array]) -> Signs:
    found = recover(prepare(robot, [signid.read_recording(columns, robot)], scaled=False)).signs
    assert found is not None
    return found


@cache
def planted() -> tuple[Robot, dict[str, Array]]:
    """The 3R arm in MuJoCo: its torques, 2 % of noise on them."""
    arm = ARMS[0]
    robot = load(arm)
    track = simulate(Body(robot.document, robot.joints), arm.drives, draw_motion(arm.centre, 0), 12.0, arm.rate)
    return robot, log(track, 0, 17, 0.02)


def share_right(signs: Signs, columns: dict[str, Array]) -> float:
    """Share of the segments whose sign is the torque's."""
    t, right = columns["t"], []
    for segment in signs.segments:
        torque = columns[f"tau_{segment.joint + 1}"][(t >= segment.start) & (t <= segment.end)]
        right.append(segment.sign == np.sign(np.sum(torque * np.abs(torque))))
    return float(np.mean(right))


@pytest.mark.parametrize("known", [(1,), (0, 2), ()])
def test_constants_of_a_plant_are_found(known: tuple[int, ...]) -> None:
    robot, columns = planted()
    found = signs_of(stating(robot, known), currents(columns))
    assert share_right(found, columns) == 1
    estimates = {gain.joint: (gain.value, gain.std) for gain in found.gains}
    assert list(estimates) == [name for j, name in enumerate(robot.joints) if j not in known]
    for j, name in enumerate(robot.joints):
        value, std = estimates.get(name, (CONSTANTS[j], 1.0))
        assert abs(value - CONSTANTS[j]) < 3 * std, name
        assert std < 0.3 * value or j in known
    assert any("inertials that the description states" in note for note in found.notes) == (not known)
    assert any("common uncertainty" in note for note in found.notes)
    assert any("known only roughly" in flag for flag in found.flags) == any(s > 0.1 * v for v, s in estimates.values())


def test_identification_goes_on_in_torques() -> None:
    robot, columns = planted()
    known, unknown = stating(robot, (0, 1, 2)), stating(robot, (1,))
    result = signid.identify(unknown, [signid.read_recording(currents(columns), unknown)])
    wanted = signid.identify(known, [signid.read_recording(currents(columns), known)])
    assert result.signs is not None
    assert [gain.joint for gain in result.signs.gains] == [robot.joints[0], robot.joints[2]]
    torque, true = result.recordings[0].read().tau, wanted.recordings[0].read().tau
    ratio = np.linalg.norm(torque, axis=0) / np.linalg.norm(true, axis=0)
    assert np.allclose(ratio, 1, atol=0.15)
    assert ratio[1] == 1
    assert np.allclose(result.fit.held_out_r2, wanted.fit.held_out_r2, atol=0.01)
    apart = np.abs(result.estimate.value - wanted.estimate.value)
    assert np.all(apart <= 3 * result.estimate.std)
    assert np.any(apart > 5 * wanted.estimate.std)  # had constants been taken to be exact


@pytest.mark.parametrize(("unit", "known"), [(1e-6, (1,)), (1e6, ())])
def test_the_unit_of_current_does_not_matter(unit: float, known: tuple[int, ...]) -> None:
    robot, columns = planted()
    amperes, other = currents(columns), currents(columns)
    other |= {f"abs_current_{j}": unit * other[f"abs_current_{j}"] for j in (1, 3)}
    one, scaled = (
        {g.joint: (g.value, g.std) for g in signs_of(stating(robot, known), c).gains} for c in (amperes, other)
    )
    for name in (robot.joints[0], robot.joints[2]):
        assert [unit * x for x in scaled[name]] == pytest.approx(one[name], rel=1e-6)


def test_signed_torque_of_one_joint_gives_the_scale_of_the_others() -> None:
    robot, columns = planted()
    mixed = currents(columns)
    del mixed["abs_current_2"]
    found = signs_of(stating(robot, ()), mixed | {"tau_2": columns["tau_2"]})
    assert found.hidden == (0, 2)
    assert [gain.value for gain in found.gains] == pytest.approx(CONSTANTS[[0, 2]], rel=0.15)


def test_no_description_is_needed_where_a_constant_is_known() -> None:
    columns = currents(made(arm()))
    gains = [signs_of(stating(heavier(arm(), factor), (1,)), columns).gains for factor in (1.0, 0.0)]
    assert gains[0] == gains[1]
    assert [gain.value for gain in gains[0]] == pytest.approx(CONSTANTS[[0, 2]], rel=0.03)


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_without_any_constant_the_description_gives_the_scale(factor: float) -> None:
    found = signs_of(stating(heavier(arm(), factor), ()), currents(made(arm())))
    assert [gain.value for gain in found.gains] == pytest.approx(factor * CONSTANTS, rel=0.06)
    assert all(0.05 < gain.std / gain.value < 0.3 for gain in found.gains)


def test_a_force_has_its_unit() -> None:
    robot = arm("prismatic")
    found = signs_of(stating(robot, (0, 2)), currents(made(robot)))
    (name, value, std, unit) = found.gains[0]
    assert (name, abs(value - CONSTANTS[1]) < 3 * std, unit) == ("j2", True, "N/A")
    assert any(" N/A (" in note for note in found.notes)


def refused(robot: Robot, *columns: dict[str, Array]) -> str:
    with pytest.raises(InputError) as caught:
        recover(prepare(robot, [signid.read_recording(c, robot) for c in columns], scaled=False))
    assert str(caught.value).count("\n") == 0
    return str(caught.value)


def test_nothing_gives_the_scale() -> None:
    message = refused(stating(heavier(arm(), 0.0), ()), currents(made(arm())))
    for word in ("j1, j2, j3", "no inertials", "torque_constant", "[N.m/A at the joint]", "actuators file"):
        assert word in message
    assert "N.m/A or N/A" in refused(stating(heavier(arm("prismatic"), 0.0), ()), currents(made(arm("prismatic"))))


def test_joints_that_share_nothing_do_not_give_the_scale() -> None:
    parts = (link("a"), link("b", PENDULUM), link("c", PENDULUM), joint("y", "a", "b"), joint("z", "a", "c"))
    robot = toy(*parts)
    columns = currents(made(robot), 2)
    message = refused(stating(heavier(robot, 0.0), (0,)), columns)
    assert "torque constant of z is not known" in message and "leave out the column of the current" in message
    found = signs_of(stating(robot, (0,)), columns)
    assert [gain.value for gain in found.gains] == pytest.approx(CONSTANTS[[1]], rel=0.06)
    assert any("also on the inertials" in note for note in found.notes)


def test_a_rotor_alone_does_not_give_the_scale() -> None:
    disc = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    robot = toy(link("a"), link("b", disc), joint("z", "a", "b", axis="0 0 1", more=LIMIT))
    message = refused(stating(robot, ()), currents(made(robot), 1))
    assert "z is not known" in message  # its armature explains what its inertia does


def test_recordings_that_disagree_are_refused() -> None:
    robot, columns = planted()
    torques = {key.replace("tau_", "abs_tau_"): np.abs(x) if "tau_" in key else x for key, x in columns.items()}
    message = refused(stating(robot, (0, 1)), currents(columns), torques, torques)
    assert f"lacks the torque constant of {robot.joints[2]}" in message


def test_currents_with_signs_are_as_good_as_those_without() -> None:
    """The third joint's constant, from signed currents and from their sizes."""
    robot, columns = planted()
    constants = {"tau_1": 5.0, "tau_2": 3.0, "tau_3": 2.0}
    signed = {key.replace("tau_", "current_"): x / constants.get(key, 1.0) for key, x in columns.items()}
    known = stating(robot, (0, 1))
    found = []
    for unsigned in (False, True):
        recording = signid.read_recording(signed, known, unsigned=unsigned)
        assert recording.scaled is not None and recording.scaled.tolist() == [True, True, False]
        assert recording.torque_per_unit.tolist() == [5.0, 3.0, 1.0]
        found.append(prepare_and_recover(known, [recording], options=Options()).gains)
    assert found[0] is not None and found[1] is not None
    [own], [other] = found[0].gains, found[1].gains
    assert own.joint == other.joint == robot.joints[2] and own.std <= 1.05 * other.std
    assert abs(own.value - 2.0) < 3 * own.std < 0.6


def lacking() -> tuple[Robot, Recording]:
    robot = stating(arm(), (0, 1))
    return robot, signid.read_recording(currents(made(arm(), seconds=3.0)), robot)


def test_only_recovery_takes_currents_without_a_constant() -> None:
    robot, recording = lacking()
    sentence = "records the current of j3, but its torque constant is not known; state torque_constant"
    with pytest.raises(RecordingError) as caught:
        prepare(robot, [recording])
    assert sentence in str(caught.value)
    prepare(robot, [recording], options=Options(), scaled=False)
    with pytest.raises(OptionError, match="has no sign"):
        signid.roll_out(signid.load_model("3r"), recording)


def test_a_constant_of_zero_is_no_constant() -> None:
    robot, columns = planted()
    zero = replace(robot, actuators=replace(robot.actuators, torque_constant=np.array([5.0, 0.0, np.nan])))
    with pytest.raises(RecordingError, match=robot.joints[1]):
        signid.read_recording(currents(columns), zero)
