"""Torque, gravity, mass matrix and simulated motion of a model for arrays of states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from servo_loops import SWING, driven, pendulum

import signid
from signid.effects import EFFECTS
from signid.effects.base import TorqueLaw
from signid.errors import OptionError
from signid.model import Model, load_model
from signid.robot import configuration
from signid.types import Array, Law, Trajectory

ACTING = {"external_contact": {"start": 0.1, "end": 0.3}, "stribeck_friction": {"velocity": 1.0}}  # in this motion
INSTANT = [e for e in EFFECTS if isinstance(e, TorqueLaw) and not e.memory]


def model_of(name: str) -> Model:
    lock = {"panda_finger_joint1": 0.02} if name == "panda" else {}
    return load_model(signid.load_robot(name, lock=lock))


def states(model: Model, *batch: int) -> Array:
    return np.random.default_rng(0).normal(size=(3, *batch, len(model.robot.joints)))


@pytest.mark.parametrize("name", ["3r", "panda", "emps"])
def test_batches_equal_pinocchio_row_by_row(name: str) -> None:
    model = Model(model_of(name).robot, model_of(name).inertials)
    whole, drive = model.robot.model, model.robot.drive
    q, v, a = states(model, 2, 3)
    found, gravity, mass = model.torque(q, v, a), model.gravity(q), model.mass_matrix(q)
    assert found.shape == gravity.shape == q.shape and mass.shape == (*q.shape, q.shape[-1])
    data = whole.createData()
    for row in np.ndindex(2, 3):
        at = configuration(model.robot, q[row])
        assert_allclose(found[row], pin.rnea(whole, data, at, drive @ v[row], drive @ a[row]) @ drive, atol=1e-10)
        assert_allclose(gravity[row], pin.computeGeneralizedGravity(whole, data, at) @ drive, atol=1e-10)
        upper = np.triu(np.array(pin.crba(whole, data, at)))
        assert_allclose(mass[row], drive.T @ (upper + np.triu(upper, 1).T) @ drive, atol=1e-10)
        for method, given in (("torque", (q, v, a)), ("gravity", (q,)), ("mass_matrix", (q,))):
            single = getattr(model, method)(*(x[row] for x in given))
            assert_allclose(single, getattr(model, method)(*given)[row], atol=1e-12)
    assert model.torque(q[0, :0]).shape == (0, q.shape[-1])


def test_the_mass_matrix_holds_every_inertia() -> None:
    model = model_of("3r").with_laws("armature@2:inertia=.3", "payload:mass=1", "joint_coupling@2:partner=3,inertia=.1")
    q, v, a = states(model, 5)
    inertial = np.einsum("...ij,...j->...i", model.mass_matrix(q), a)
    assert_allclose(model.torque(q, v, a) - model.torque(q, v), inertial, atol=1e-10)
    assert_allclose(model.torque(q), model.gravity(q), atol=1e-10)
    sprung = model.with_laws("spring@2:stiffness=8,rest=.3", "torque_offset@1:offset=.5")
    held = np.stack([np.full(5, 0.5), 8 * (q[:, 1] - 0.3), np.zeros(5)], axis=1)
    assert_allclose(sprung.torque(q) - sprung.gravity(q), held, atol=1e-10)


@pytest.mark.parametrize("effect", INSTANT, ids=lambda e: e.name)
def test_a_simulation_under_the_torque_of_a_motion_follows_it(effect: Any) -> None:
    joints = {"pair": (1, 2), "robot": (0, 1, 2)}.get(effect.scope, (1,))
    numbers = {**effect.example, **ACTING.get(effect.name, {})}
    plain = model_of("3r").with_laws(*(f"armature@{j}:inertia=1" for j in (1, 2, 3)))
    model = Model(plain.robot, plain.inertials, (*plain.laws, Law(effect, joints, numbers)))
    t = np.linspace(0, 0.4, 401)
    phase = np.add.outer(2 * t, [-0.4, 0.1, 0.6])
    q, v, a = 0.4 * np.sin(phase), 0.8 * np.cos(phase), -1.6 * np.sin(phase)
    torque = model.torque(q, v, a, t)
    follows, strays = (np.abs(x.simulate(t, q[0], v[0], torque=torque).q - q).max() for x in (model, plain))
    assert follows < 0.1 * strays


def test_simulations_of_a_batch_equal_those_of_the_room() -> None:
    model = model_of("3r").with_laws("coulomb_friction@2:level=1.5", "backlash@1", "armature@1:inertia=.2")
    t, rng = np.linspace(0, 0.5, 26), np.random.default_rng(0)
    q, torque = rng.normal(size=(2, 1, 3)), rng.normal(size=(2, 26, 3))
    found = model.simulate(t, q, torque=torque[:, None])
    assert found.q.shape == found.v.shape == found.torque.shape == (2, 1, 26, 3)
    for k in range(2):
        one = signid.simulate(model, signid.simulation.plant.Torques(t, torque[k], q[k, 0], np.zeros(3)), 0.502)
        assert_allclose(found.q[k, 0], one.true_q[:501:20], atol=1e-9)
        assert_allclose(found.v[k, 0], one.true_v[:501:20], atol=1e-9)
    with pytest.raises(OptionError, match=r'backlash of joint_1 depends on the past.*without\("backlash"\)'):
        model.torque(q)
    assert model.without("backlash").torque(q).shape == q.shape


def test_commands_are_followed_as_by_the_simulation_of_drives() -> None:
    model = driven(pendulum(), {"swing": SWING})
    t = np.arange(0, 2, 0.01)
    u = (0.5 * np.sin(4.4 * t) + 0.2 * np.sin(12 * t))[:, None]
    room = signid.simulate_servos(model, Trajectory(("swing",), t, u, np.gradient(u, t, axis=0), 0 * u))
    found = model.simulate(t, u[0], room.v[0], commands=u)
    assert np.abs(found.q[:-1] - room.q[:: round(0.01 / 1e-3)][: len(t) - 1]).max() < 4e-3 < np.ptp(room.q) / 100
    with pytest.raises(OptionError, match=r"^simulate: torque and commands both"):
        model.simulate(t, u[0], torque=u, commands=u)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda m: m.torque(np.zeros(2)),
            r"torque: q has the shape \(2,\); give \(..., 3\), the joints joint_1, joint_2",
        ),
        (lambda m: m.gravity([[0, 0, np.nan]]), r"gravity: q is nan at \[0, 2\]; give finite numbers"),
        (lambda m: m.mass_matrix("home"), "mass_matrix: q is no array of numbers"),
        (lambda m: m.torque(np.zeros(3), None), "torque: v is no array of numbers"),
        (lambda m: m.torque(np.zeros((4, 3)), np.zeros((5, 3))), r"q \(4, 3\), v \(5, 3\), a \(\) differ"),
        (lambda m: m.torque(np.zeros((4, 3)), t=[0, 1]), r"t is not one number or an array \(4,\)"),
        (lambda m: m.simulate([0, 1], np.zeros(3), torque=np.zeros(3)), r"torque has the shape .*give \(..., 2, 3\)"),
        (lambda m: m.simulate([0, 1], np.zeros(3), commands=np.zeros((2, 3))), "joint_1 of the model has no position"),
        (lambda m: m.simulate([1, 0], np.zeros(3)), "does not increase"),
        (lambda m: m.with_laws("spring@9"), "has no joint '9'"),
        (lambda m: m.without("spring"), "the model has no law 'spring'; it has none"),
    ],
)
def test_wrong_arguments_are_one_sentence(call: Callable[[Model], Any], said: str) -> None:
    with pytest.raises(signid.SignidError, match=said):
        call(model_of("3r"))
