"""Inverse dynamics as C99 and as Python over an array namespace: compiled, run, and compared with the model itself."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import signid
from signid.cli import run
from signid.effects import EFFECTS
from signid.effects.base import BodyLaw, TorqueLaw, Trial
from signid.effects.naming import law_at
from signid.errors import RobotError
from signid.model import Model, load_model
from signid.output.export import export
from signid.output.export.code.graph import Graph, unary, where
from signid.output.export.code.languages import identifier
from signid.output.export.code.program import program_of
from signid.regression.motion import Motion
from signid.robot import configuration, load_robot, robot_from_text
from signid.robot.dynamics import own_body
from signid.types import Law

ROOT = Path(__file__).parents[1]
COMPILER = shutil.which("cc") or shutil.which("gcc")
FURTHER = ("nonlinear", "forward", "jacobian", "payload", "observer")
BODY = (2.0, 0.1, 0.04, 0.16, 0.02, -0.002, 0.03, -0.008, -0.003, 0.04)  # of the written test program
WIDTH = 0.1  # [rad/s], and half of v as the desired velocity
STRICT = "-std=c99 -pedantic -O1 -Wall -Wextra -Wconversion -Wshadow -Werror".split()
LAWS = {
    "viscous_friction": {"coefficient": 0.4},
    "coulomb_friction": {"level": 0.3},
    "stribeck_friction": {"level": 0.2, "velocity": 0.3},
    "asymmetric_friction": EFFECTS["asymmetric_friction"].example,
    "load_friction": {"coefficient": 0.1},
    "gear_friction": EFFECTS["gear_friction"].example,
    "motor_friction": {"coefficient": 0.2, "inertia": 0.02, "viscous": 0.1, "coulomb": 0.3, "offset": 0.05},
    "position_friction": EFFECTS["position_friction"].example,
    "quadratic_friction": {"coefficient": 0.2},
    "cable_torque": EFFECTS["cable_torque"].example,
    "counterbalance": EFFECTS["counterbalance"].example,
    "torque_ripple": EFFECTS["torque_ripple"].example,
    "empirical": EFFECTS["empirical"].example,
    "armature": {"inertia": 0.02},
    "torque_offset": {"offset": 0.1},
    "spring": {"stiffness": 3.0, "rest": 0.2},
    "payload": {"mass": 0.7, "first_moment_x": 0.05, "first_moment_y": 0.0, "first_moment_z": 0.1},
    "base_tilt": {"x": 0.05, "y": -0.02},
}
MIMIC = """<robot name="9 bad*/ name"><link name="base"/>
<joint name="slide" type="prismatic"><origin xyz="0 0 .1" rpy=".3 .2 .1"/><axis xyz="0 .6 .8"/><parent link="base"/>
<child link="a"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
<link name="a"><inertial><origin xyz=".1 0 .2"/><mass value="2"/><inertia ixx=".02" iyy=".03" izz=".04" ixy=".001"
 ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><origin xyz="0 .2 .1" rpy="1.1 .2 .1"/><axis xyz=".6 0 .8"/><parent link="a"/>
<child link="b"/></joint>
<link name="b"><inertial><origin xyz=".1 .1 0"/><mass value="1"/><inertia ixx=".02" iyy=".03" izz=".04" ixy="0"
 ixz=".001" iyz="0"/></inertial></link>
<joint name="follow" type="revolute"><origin xyz=".3 0 0"/><axis xyz="0 1 0"/><parent link="b"/><child link="c"/>
<limit lower="-3" upper="3" effort="9" velocity="9"/><mimic joint="turn" multiplier="-.5" offset=".2"/></joint>
<link name="c"><inertial><origin xyz="0 0 .2"/><mass value=".5"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0"
 iyz="0"/></inertial></link></robot>"""


@cache
def identified() -> Model:
    """Model that `signid identify` writes for the 3r: armature, friction and offset of every joint are laws."""
    return signid.identify("3r", [ROOT / "robots" / "3r" / "recording.parquet"]).model


def a_model(name: str) -> Model:
    """Model of a robot by name, identified, of the mimic robot, or of the 3r with every law that code can hold."""
    if name == "identified":
        return identified()
    if name == "mimic":
        return load_model(robot_from_text(MIMIC, "urdf", "9 bad*/ name"))
    if name != "laws":
        return load_model(load_robot(name))
    model = load_model("3r")
    joint = {name: EFFECTS[name].scope == "joint" for name in LAWS}
    laws = [
        law_at(EFFECTS[name], model.robot, ("joint_2" if joint[name] else None), parameters)
        for name, parameters in LAWS.items()
        if EFFECTS[name].scope in ("joint", "tip", "robot")
    ]
    pair = law_at(
        EFFECTS["joint_coupling"], model.robot, "joint_2", {"partner": "joint_3", **EFFECTS["joint_coupling"].example}
    )
    return replace(model, laws=(*laws, pair))


def states(model: Model, count: int = 20) -> Motion:
    """Random states with speeds away from 0."""
    rng, n = np.random.default_rng(1), len(model.robot.joints)
    v = rng.uniform(0.2, 2, (count, n)) * rng.choice([-1, 1], (count, n))
    return Motion(model.robot, np.arange(count) * 1.0, rng.normal(size=(count, n)), v, rng.normal(size=(count, n)))


def compiled(model: Model, folder: Path) -> Path:
    """Write, compile and link the C code of a model and its test program."""
    made = export(model, "c", name="arm", functions=FURTHER)
    for end, text in {".c": made.text, **made.beside}.items():
        (folder / f"arm{end}").write_text(text)
    command = [str(COMPILER), *STRICT, "arm.c", "arm_test.c", "-lm", "-o", "arm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "arm"


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("name", ["1r", "3r", "identified", "ur5", "panda", "emps", "mimic", "laws"])
def test_the_c_code_agrees_with_the_model(name: str, tmp_path: Path) -> None:
    model = a_model(name)
    motion, n = states(model), len(model.robot.joints)
    lines = "\n".join(" ".join(map(repr, row.tolist())) for row in np.hstack([motion.q, motion.v, motion.a]))
    out = subprocess.run([compiled(model, tmp_path)], input=lines, capture_output=True, text=True, check=True).stdout
    found = {
        function: np.array([line.split()[1:] for line in out.splitlines() if line.split()[0] == function], dtype=float)
        for function in dict.fromkeys(line.split()[0] for line in out.splitlines())
    }
    expected = model.inverse(motion)
    assert_allclose(found["inverse_dynamics"], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    mass = found["mass_matrix"].reshape(-1, n, n)
    assert_allclose(mass, mass.transpose(0, 2, 1), atol=1e-9 * np.abs(mass).max())
    assert_allclose(found["laws"], expected - without_laws(model).inverse(motion), atol=1e-9 * np.abs(expected).max())
    weight = without_laws(model).inverse(replace(motion, v=0 * motion.v, a=0 * motion.a))
    assert_allclose(found["gravity"], weight, atol=1e-9 * np.abs(weight).max(initial=1e-3))
    if name != "laws":  # friction that depends on load is not linear in the acceleration
        change = model.inverse(replace(motion, a=motion.a + 1.0)) - expected
        assert_allclose(mass.sum(-1), change, atol=1e-8 * np.abs(change).max())
        assert_allclose(found["forward_dynamics"], motion.a, rtol=1e-8, atol=1e-8)
    bodies, scale = without_laws(model), np.abs(expected).max()
    bias = bodies.inverse(replace(motion, a=0 * motion.a))
    assert_allclose(found["nonlinear_effects"], bias, atol=1e-9 * scale)
    still = model.inverse(replace(motion, a=0 * motion.a))
    assert_allclose(np.einsum("kij,kj->ki", mass, found["forward_dynamics"]), expected - still, atol=1e-8 * scale)
    assert_allclose(found["tracking_torque"], expected + smoothing(model, motion), atol=1e-9 * scale)
    payload = law_at(EFFECTS["payload"], model.robot, None, dict(zip(EFFECTS["payload"].parameters, BODY, strict=True)))
    carried = replace(bodies, laws=(*bodies.laws, payload)).inverse(motion) - bodies.inverse(motion)
    assert_allclose(found["payload_torque"], carried, atol=1e-9 * np.abs(carried).max())
    tip = own_body(model.robot, n - 1) + 1
    rows = found["frame_jacobian"].reshape(-1, 6, n)
    for q, jacobian in zip(configuration(model.robot, motion.q), rows, strict=True):
        assert_allclose(jacobian, pinocchio_jacobian(model, q, tip), atol=1e-12)


def pinocchio_jacobian(model: Model, q: Any, joint: int) -> Any:
    """Jacobian (6, n) of the frame of a joint of the pin.Model at a configuration."""
    whole = model.robot.model
    data = whole.createData()
    pin.computeJointJacobians(whole, data, q)
    jacobian = pin.getJointJacobian(whole, data, joint, pin.LOCAL_WORLD_ALIGNED)
    return np.reshape(jacobian, (6, whole.nv)) @ model.robot.drive


def smoothing(model: Model, motion: Motion) -> Any:
    """Change of torque (N, n) by friction of a desired velocity, v / 2, from the columns of the laws."""
    load, desired = without_laws(model).inverse(motion), 0.5 * motion.v
    none, change = 0 * desired, np.zeros_like(desired)
    for law in (law for law in model.laws if isinstance(law.effect, TorqueLaw)):
        j = list(law.joints)

        def torque(v: Any, direction: Any, law: Law = law, j: list[int] = j) -> Any:
            view = Trial(motion.q[:, j], v[:, j], a=motion.a[:, j], load=load[:, j], direction=direction[:, j])
            columns = law.effect.columns(view, **law.effect.shape(law.parameters))
            return sum(map(np.multiply, law.effect.coefficients(law.parameters) or [1.0], columns))

        if law.effect.name == "joint_coupling":  # its dry friction is that of a sum of velocities
            before, after = (
                np.tanh(v[:, j].sum(1, keepdims=True) / w) for v, w in ((motion.v, 0.01), (desired, WIDTH))
            )
            change[:, j] += law.parameters["coulomb"] * (after - before)
        else:
            jump = torque(desired, np.tanh(desired / WIDTH)) - torque(desired, none)
            change[:, j] += torque(motion.v, none) + jump - torque(motion.v, np.sign(motion.v))
    return change


def without_laws(model: Model) -> Model:
    """The bodies alone, with the laws that change them, without armature."""
    laws = (law for law in model.laws if isinstance(law.effect, BodyLaw) and law.effect.name != "armature")
    return replace(model, laws=tuple(laws))


WRITTEN = [name for name in EFFECTS.names if isinstance(EFFECTS[name], TorqueLaw | BodyLaw)]


@pytest.mark.parametrize("name", WRITTEN)
def test_each_law_is_in_the_function_where_it_belongs(name: str) -> None:
    effect, model = EFFECTS[name], load_model("3r")
    where = None if effect.scope in ("tip", "robot") else "joint_2"
    law = law_at(
        effect, model.robot, where, {**({"partner": "joint_3"} if effect.scope == "pair" else {}), **effect.example}
    )
    model = replace(identified(), laws=(*identified().laws, law))
    motion = states(model)
    space: dict[str, Any] = {}
    made = export(model, "arrays")
    exec(made.text, space)
    if any(name in note for note in (*made.notes, *made.flags)):
        model = identified()
    expected, atol = model.inverse(motion), 1e-9 * np.abs(model.inverse(motion)).max()
    q, v, a = motion.q, motion.v, motion.a
    assert_allclose(space["inverse_dynamics"](q, v, a), expected, atol=atol)
    assert_allclose(space["laws"](q, v, a), expected - without_laws(model).inverse(motion), atol=atol)
    mass, rest = space["mass_matrix"](q), space["inverse_dynamics"](q, v, 0 * a)
    if name != "load_friction":
        assert_allclose(np.einsum("kij,kj->ki", mass, a) + rest, expected, atol=atol)
        bias = without_laws(model).inverse(replace(motion, a=0 * a))  # Coriolis torque and gravity
        laws = space["laws"](q, v, 0 * a)
        assert_allclose(np.einsum("kij,kj->ki", mass, a) + bias + laws, expected, atol=atol)


@pytest.mark.parametrize("name", ["3r", "panda", "mimic", "laws"])
def test_the_arrays_agree_with_the_model_in_any_shape(name: str) -> None:
    model = a_model(name)
    motion = states(model)
    space: dict[str, object] = {}
    exec(export(model, "arrays").text, space)
    got = space["inverse_dynamics"](motion.q[None], motion.v[None], motion.a[None])[0]  # type: ignore[operator]
    expected = model.inverse(motion)
    assert_allclose(got, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert space["mass_matrix"](motion.q).shape == (20, *2 * [len(model.robot.joints)])  # type: ignore[operator]
    assert space["gravity"](motion.q[0]).shape == motion.q[0].shape  # type: ignore[operator]


def test_jax_differentiates_the_arrays() -> None:
    jax = pytest.importorskip("jax", reason="jax is not installed (an optional test dependency)")
    jax.config.update("jax_enable_x64", True)
    model = a_model("3r")
    motion = states(model)
    space: dict[str, object] = {}
    exec(export(model, "arrays").text, space)
    inverse, mass = space["inverse_dynamics"], space["mass_matrix"]
    q, v, a = (jax.numpy.array(x[0]) for x in (motion.q, motion.v, motion.a))
    slope = jax.jacobian(lambda a: inverse(q, v, a, xp=jax.numpy))(a)  # type: ignore[operator]
    assert_allclose(slope, mass(motion.q[0]), atol=1e-9)  # type: ignore[operator]


def test_laws_that_code_cannot_hold_are_noted() -> None:
    model = load_model("3r")
    lagged = law_at(EFFECTS["torque_lag"], model.robot, "joint_2", EFFECTS["torque_lag"].example)
    sliding = law_at(EFFECTS["presliding_friction"], model.robot, "joint_1", {"level": 1.0, "distance": 0.01})
    made = export(replace(model, laws=(lagged, sliding)), "c")
    assert any("torque_lag" in note for note in made.notes)
    assert made.flags and all("presliding_friction of joint_1: " in flag for flag in made.flags)
    assert "torque_lag" in made.beside[".h"]


def test_graphs_fold_constants_and_share_nodes() -> None:
    graph = Graph()
    x, y = graph.variable("x"), graph.variable("y")
    assert (x * 0.0).value == 0 and (x * 1.0).number == x.number and (x + 0.0).number == x.number
    assert (x - x).value == 0 and x.__neg__().__neg__().number == x.number and (x + y).number == (y + x).number
    assert (2.0 * (3.0 * x)).number == (6.0 * x).number and unary("cos", graph.constant(0.0)).value == 1
    assert where(graph.constant(0.0), x, y).number == y.number


def test_the_program_of_a_pendulum_is_as_short_as_by_hand() -> None:
    program = program_of(load_model("1r"))
    used = program.graph.used(program.functions[0].outputs)
    assert sum(program.graph.nodes[k][0] not in ("variable", "constant") for k in used) <= 5


@pytest.mark.parametrize(("name", "plain"), [("3r", "robot_3r"), ("a-b c", "a_b_c"), ("*/", "robot"), ("ok", "ok")])
def test_names_become_identifiers(name: str, plain: str) -> None:
    assert identifier(name) == plain


def test_floating_bases_are_refused_in_one_sentence() -> None:
    model = a_model("3r")
    free = model.robot.model.copy()
    free.joints[1] = __import__("pinocchio").JointModelFreeFlyer()
    with pytest.raises((RobotError, ValueError)):
        program_of(replace(model, robot=replace(model.robot, model=free)))


def library(model: Model, folder: Path, **options: Any) -> tuple[Any, int]:
    """Functions of a model in a shared library: they take and return arrays; and the number of joints."""
    made, n = export(model, "c", name="arm", **options), len(model.robot.joints)
    (folder / "arm.c").write_text(made.text)
    (folder / "arm.h").write_text(made.beside[".h"])
    subprocess.run([str(COMPILER), "-O1", "-shared", "-fPIC", "arm.c", "-lm", "-o", "arm.so"], cwd=folder, check=True)
    whole = ctypes.CDLL(str(folder / "arm.so"))

    def call(function: str, *given: Any, size: int = n) -> Any:
        out = np.zeros(size)
        numbers = [ctypes.c_double(x) if np.isscalar(x) else np.ascontiguousarray(x, float) for x in (*given, out)]
        passed = [x.ctypes.data_as(ctypes.c_void_p) if isinstance(x, np.ndarray) else x for x in numbers]
        getattr(whole, f"{identifier(model.robot.name)}_{function}")(*passed)
        return numbers[-1]

    return call, n


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_friction_by_a_desired_velocity_does_not_chatter_at_rest(tmp_path: Path) -> None:
    model = a_model("laws")
    call, n = library(model, tmp_path)
    q, a, still, noise = 0.3 * np.ones(n), np.zeros(n), np.zeros(n), 1e-6 * np.ones(n)
    held, jumps = (
        np.ptp([call(name, q, v, a, *more) for v in (-noise, noise)], axis=0)
        for name, more in (("tracking_torque", (still, 0.05)), ("inverse_dynamics", ()))
    )
    assert jumps[1] > 1.0 and held.max() < 1e-4  # dry friction of joint_2 to both sides; viscous friction alone
    fast = 0.5 + noise
    assert_allclose(call("tracking_torque", q, fast, a, fast, 0.0), call("inverse_dynamics", q, fast, a), rtol=1e-12)
    assert np.isfinite(call("tracking_torque", q, still, a, still, 0.0)).all()


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_a_link_by_name_has_the_jacobian_and_the_payload(tmp_path: Path) -> None:
    model, link = load_model(load_robot("panda")), "panda_hand_tcp"
    call, n = library(model, tmp_path, functions=("jacobian", "payload"), link=link)
    motion, whole = states(model, 1), model.robot.model.copy()
    frame, q = whole.frames[whole.getFrameId(link)], configuration(model.robot, motion.q)[0]
    found = call("frame_jacobian", motion.q[0], size=6 * n).reshape(6, n)
    data = whole.createData()
    expected = pin.computeFrameJacobian(whole, data, q, whole.getFrameId(link), pin.LOCAL_WORLD_ALIGNED)
    assert_allclose(found, expected @ model.robot.drive, atol=1e-12)
    dynamics = [model.robot.drive @ x[0] for x in (motion.v, motion.a)]
    before = pin.rnea(whole, data, q, *dynamics)
    whole.inertias[frame.parentJoint] += frame.placement.act(pin.Inertia.FromDynamicParameters(np.array(BODY)))
    carried = model.robot.drive.T @ (pin.rnea(whole, whole.createData(), q, *dynamics) - before)
    assert_allclose(call("payload_torque", motion.q[0], motion.v[0], motion.a[0], BODY), carried, atol=1e-9)


@pytest.mark.parametrize(("name", "most"), [("ur5", 184), ("panda", 612), ("tiago_no_hand", 557), ("go2", 268)])
def test_the_mass_matrix_is_that_of_composite_bodies(name: str, most: int) -> None:
    program = program_of(load_model(load_robot(name)))
    matrix = next(function for function in program.functions if function.name == "mass_matrix")
    used = (program.graph.nodes[k][0] for k in program.graph.used(matrix.outputs))
    assert sum(operation not in ("variable", "constant", "negate") for operation in used) <= most


def test_comments_name_joints_links_laws_and_the_model(tmp_path: Path) -> None:
    model = identified()
    made = export(model, "c", functions=FURTHER)
    assert made == export(model, "c", functions=FURTHER)
    digest = sha256(model.save(tmp_path / "model.json").read_bytes()).hexdigest()
    header = made.beside[".h"]
    assert digest in header and "M(q) a + h(q, v) + laws(q, v, 0)" in header and "0 0 -9.81" in header
    assert "coulomb_friction of joint_2: level * sign(v); level = " in header
    for comment in ("joint_2 (link_2): motion", "joint_3 (link_3): mass matrix", "coulomb_friction of joint_1"):
        assert f"    /* {comment} */\n" in made.text
    assert "; /* angular velocity z, joint_3 */" in made.text and "; /* joint_2, joint_3 */" in made.text


def test_forward_dynamics_without_inertia_is_refused() -> None:
    model = load_model("3r")
    with pytest.raises(RobotError, match="not positive definite"):
        export(replace(model, inertials=0 * model.inertials), "c", functions=("forward",))


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (["--c", "3r.c"], "no digit at the beginning, and .c at the end; name it robot_3r.c"),
        (["--c", "two words.c"], "name it two_words.c"),
        (["--c", "arm.cpp"], "name it arm.c"),
        (["--c", "arm.c", "--with", "inverse"], "choose from nonlinear, forward, jacobian, payload, observer"),
        (["--c", "arm.c", "--with", "payload", "--link", "lnk_3"], "did you mean link_3"),
        (["--c", "arm.c", "--link", "link_3"], "add the function jacobian or payload"),
        (["--urdf", "arm.urdf", "--with", "forward"], "add --c FILE.c"),
        (["--urdf", "arm.urdf", "--observer"], "add --c FILE.c"),
    ],
)
def test_options_of_code_are_refused_in_one_sentence(
    options: list[str], fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["export", "3r", *options]) == 2
    assert fault in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_the_command_writes_all_files_or_none(tmp_path: Path) -> None:
    files = ["--c", str(tmp_path / "arm.c"), "--with", "forward, jacobian", "--arrays", str(tmp_path / "arm.py")]
    assert run(["export", "3r", *files]) == 0
    assert "robot_3r_frame_jacobian" in (tmp_path / "arm_test.c").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.c", "arm.h", "arm.py", "arm_test.c"]
    assert '#include "arm.h"' in (tmp_path / "arm.c").read_text()
