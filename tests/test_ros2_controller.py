"""The ROS 2 package `robots/ros2_controller`: its files, and its controller built by its CMake file without ROS.

`tests/ros2_stub` has the part of the interfaces of ROS 2 that the controller uses; `drive.cpp` there reads what to do.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml
from lxml import etree
from numpy.testing import assert_allclose

import signid
from signid.output.export.code.languages import identifier
from signid.regression.motion import Motion
from signid.types import Array

HERE = Path(__file__).parent
PACKAGE, STUB = HERE.parent / "robots" / "ros2_controller", HERE / "ros2_stub"
NAME = "signid_controller"
STRICT = "-O0 -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Werror"
LEVEL = 0.2  # Coulomb friction of joint_2 and joint_3 [N.m]
LAWS = ("viscous_friction@joint_2:coefficient=0.5", *(f"coulomb_friction@joint_{j}:level={LEVEL}" for j in (2, 3)))
MODEL = signid.load_model("3r").with_laws(*LAWS)
JOINTS, N = MODEL.robot.joints, 3
SUCCESS, FAILURE, ERROR = 97, 98, 99
AMENT = """
macro(pluginlib_export_plugin_description_file kind file)
  install(FILES ${{file}} DESTINATION share/${{PROJECT_NAME}})
endmacro()
macro(ament_export_targets name)
  install(EXPORT ${{name}} NAMESPACE ${{PROJECT_NAME}}:: DESTINATION share/${{PROJECT_NAME}}/cmake)
endmacro()
macro(ament_export_dependencies)
endmacro()
macro(ament_package)
endmacro()
add_library({name}::{name} INTERFACE IMPORTED)
target_include_directories({name}::{name} INTERFACE {stub})
set({name}_TARGETS {name}::{name})
"""


class Rows(NamedTuple):
    """Results of updates, by rows."""

    result: Array  # 0: OK
    allocations: Array  # up to a row
    q: Array
    v: Array
    tau: Array


def dependencies() -> list[str]:
    tree = etree.parse(PACKAGE / "package.xml")
    return [str(node.text) for node in tree.xpath("/package/buildtool_depend | /package/depend")]


def run(*command: object, **options: Any) -> str:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., list[str]]:
    """Program that drives the controller, built and installed by its CMake file: lines that a script prints."""
    if not all(map(shutil.which, ("cmake", "cc", "c++"))):
        pytest.skip("no cmake, or no C and C++ compilers")
    folder = tmp_path_factory.mktemp("ros2")
    for name in dependencies():
        place = folder / "share" / name
        place.mkdir(parents=True)
        (place / f"{name}Config.cmake").write_text(AMENT.format(name=name, stub=STUB))
    MODEL.save(folder / "model.json")
    options = [f"-DCMAKE_PREFIX_PATH={folder}", f"-DCMAKE_INSTALL_PREFIX={folder / 'install'}"]
    options += [f"-DCMAKE_{language}_FLAGS={STRICT}" for language in ("C", "CXX")]
    options += [f"-DSIGNID_MODEL={folder / 'model.json'}", f"-DSIGNID_COMMAND={sys.executable};-m;signid"]
    build = folder / "build"
    run("cmake", "-S", PACKAGE, "-B", build, *options, cwd=HERE.parent)
    run("cmake", "--build", build, "--target", "install")
    robot = identifier(MODEL.robot.name)
    names = [f"-Dsignid_{name}={robot}_{name}" for name in ("mass_matrix", "inverse_dynamics")]
    folders = [f"-I{place}" for place in (build, folder / "install" / "include" / NAME, STUB)]
    library = folder / "install" / "lib"
    linked = [f"-L{library}", f"-l{NAME}", f"-Wl,-rpath,{library}", "-o", folder / "drive"]
    sources = STUB / "drive.cpp", build / "arm.c"
    run("c++", "-std=c++17", "-O0", f"-DSIGNID_JOINTS={N}", *names, *folders, *sources, *linked)

    def lines(*script: object) -> list[str]:
        return run(folder / "drive", input=" ".join(map(str, script))).splitlines()

    lines.folder = folder  # type: ignore[attr-defined]
    return lines


def parameters(found: dict[str, Any], prefix: str = "") -> list[str]:
    """Words of parameters as rclcpp reads them from YAML: names joined by dots, one type for each list."""
    words: list[str] = []
    for key, value in found.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            words += parameters(value, f"{name}.")
            continue
        kinds = {str: "string", float: "number", int: "integer"}
        if isinstance(value, list):
            (kind,) = {kinds[type(item)] + "s" for item in value}
            words += ["parameter", name, kind, str(len(value)), *map(str, value)]
        else:
            words += ["parameter", name, kinds[type(value)], str(value)]
    return words


def configured(*, kp: float = 100.0, kd: float = 20.0, **further: Any) -> list[str]:
    """Words of the parameters that `signid export --ros` writes, and of gains."""
    written = yaml.safe_load(signid.export(MODEL, "ros").text)["/**"]["ros__parameters"]
    return parameters({**written, "kp": [kp] * N, "kd": [kd] * N, **further}) + ["init", "configure"]


def limited(**limits: float) -> dict[str, Any]:
    joints = {joint: {"effort_limit": limit} for joint, limit in limits.items()}
    return {"dynamics": {"joints": list(JOINTS), "joint": joints}}


def trajectory(*points: tuple[float, Sequence[Sequence[float]]], joints: Sequence[str] = JOINTS) -> list[object]:
    """Words of a trajectory: time, and positions, velocities and accelerations, of each point."""
    words: list[object] = ["trajectory", len(joints), *joints, len(points)]
    for time, numbers in points:
        words.append(time)
        for part in (*numbers, (), (), ())[:3]:
            words += [len(part), *part]
    return words


def state(q: Sequence[float], v: Sequence[float] = (0.0,) * N) -> list[object]:
    return ["state", *np.stack([q, v], axis=1).ravel().tolist()]


def rows(lines: Sequence[str]) -> Rows:
    table = np.array([line.split() for line in lines], dtype=float)
    states = table[:, 2 : 2 + 2 * N].reshape(-1, N, 2)
    return Rows(table[:, 0], table[:, 1], states[..., 0], states[..., 1], table[:, 2 + 2 * N :])


REST, GOAL = np.array([0.3, -0.5, 0.7]), np.array([0.8, 0.1, 0.2])
STARTED = [*configured(), *state(REST.tolist()), "activate"]


def test_the_package_has_the_parts_that_ros_asks_for() -> None:
    packages = pytest.importorskip("catkin_pkg.package")  # the reader that colcon uses
    package = packages.parse_package(str(PACKAGE / "package.xml"))
    package.validate()
    assert (package.name, package.package_format, package.get_build_type()) == (NAME, 3, "ament_cmake")
    assert package.version == signid.__version__
    plugin = etree.parse(PACKAGE / "plugin.xml").getroot()
    (offered,) = plugin
    assert (plugin.tag, plugin.get("path"), offered.tag) == ("library", NAME, "class")
    assert offered.get("type") == offered.get("name").replace("/", "::")
    source = (PACKAGE / "inverse_dynamics_controller.cpp").read_text()
    assert f"PLUGINLIB_EXPORT_CLASS({offered.get('type')}, {offered.get('base_class_type')})" in source
    written = yaml.safe_load((PACKAGE / "controllers.yaml").read_text())
    known = written["controller_manager"]["ros__parameters"]
    assert known["inverse_dynamics_controller"]["type"] == offered.get("name")
    panda = signid.load_robot(PACKAGE.parent / "panda" / "arm.urdf")
    own = written["inverse_dynamics_controller"]["ros__parameters"]
    assert len(own["kp"]) == len(own["kd"]) == len(panda.joints) and parameters(own)


@pytest.mark.slow
def test_the_build_installs_the_package(drive: Any) -> None:
    place = drive.folder / "install"
    assert yaml.safe_load((place / "share" / NAME / "arm.yaml").read_text()) == yaml.safe_load(
        signid.export(MODEL, "ros").text
    )
    for file in ("controllers.yaml", "plugin.xml", f"cmake/export_{NAME}.cmake"):
        assert (place / "share" / NAME / file).is_file()
    assert (place / "include" / NAME / "inverse_dynamics_controller.hpp").is_file()


def test_the_controller_commands_the_torque_of_the_model(drive: Any) -> None:
    q, v = REST, np.array([0.4, 0.2, -0.6])
    lines = drive(*configured(), "interfaces", *state(q.tolist(), v.tolist()), "activate", "update")
    assert lines[:2] == [str(SUCCESS)] * 2
    assert lines[2].split()[:5] == [*(f"{x}/effort" for x in JOINTS), "joint_1/position", "joint_1/velocity"]
    smooth = MODEL.without("coulomb_friction")  # v_ref = 0: no dry friction
    expected = smooth.inverse(Motion(MODEL.robot, np.zeros(1), q[None], v[None], -20.0 * v[None]))
    assert_allclose(rows(lines[4:]).tau, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"kp": -1.0}, "kp and kd need one number"),
        ({"friction_width": 0.0}, "friction_width is not above 0"),
        ({"dynamics": {"joints": ["joint_1"]}}, "load the arm.yaml"),
        (limited(joint_2=-3.0), "joint_2.effort_limit is not above 0"),
    ],
)
def test_wrong_parameters_are_refused(drive: Any, changes: dict[str, Any], reason: str) -> None:
    *_, said, result = drive(*configured(**changes))
    assert reason in said and result == str(FAILURE)


@pytest.mark.parametrize(("powers", "derivatives"), [((0, 0, 10, -15, 6), 2), ((0, 3, -2, 0, 0), 1)])
def test_the_robot_follows_a_trajectory_and_holds_its_end(drive: Any, powers: Sequence[int], derivatives: int) -> None:
    course, order = np.polynomial.Polynomial([0, *powers]), [2, 0, 1]  # share of the way, 0 to 1 s

    def point(t: float) -> tuple[float, list[list[float]]]:
        shares = [course(t), *(course.deriv(k)(t) for k in range(1, derivatives + 1))]
        numbers = [(k == 0) * REST + share * (GOAL - REST) for k, share in enumerate(shares)]
        return t, [part[order].tolist() for part in numbers]

    sent = trajectory(point(0.3), point(1.0), joints=[JOINTS[j] for j in order])
    found = rows(drive(*STARTED, "run", 200, *sent, "run", 1500)[3:])
    assert not found.result.any() and not found.allocations.any()
    t = np.clip((np.arange(len(found.q)) - 200) * 1e-3, 0, 1)[:, None]
    assert np.abs(found.q - (REST + (GOAL - REST) * course(t))).max() < 1.5e-3  # 1.1 of it the period
    assert np.ptp(found.q[:200], axis=0).max() < 1e-4
    assert np.abs(found.v[-100:]).max() < 1e-2


def test_positions_alone_are_passed_smoothly_and_a_new_trajectory_starts_where_the_old_one_is(drive: Any) -> None:
    passed = [(t, [REST + t * (GOAL - REST)]) for t in (0.0, 0.25, 0.5, 0.75, 1.0)]
    back = trajectory((0.5, [REST]))
    found = rows(drive(*STARTED, *trajectory(*passed), "run", 600, *back, "run", 700)[3:])
    assert np.abs(found.q[500] - (REST + GOAL) / 2).max() < 5e-3
    assert np.all((GOAL - REST) * found.v[300:580] > 0.5 * (GOAL - REST) ** 2)  # no stop on the way
    assert np.abs(np.diff(found.q, axis=0)).max() < 3e-3 and np.abs(np.diff(found.v, axis=0)).max() < 0.06
    assert np.abs(found.q[-1] - REST).max() < 5e-3


@pytest.mark.parametrize(
    ("sent", "reason"),
    [
        (trajectory((1.0, [GOAL]), joints=["joint_1", "joint_2", "elbow"]), "joint elbow is unknown"),
        (trajectory((1.0, [GOAL[:2]]), joints=JOINTS[:2]), "joint joint_3 is missing"),
        (trajectory((1.0, [GOAL]), joints=["joint_1", "joint_2", "joint_2"]), "joint joint_2 is named twice"),
        (trajectory((1.0, [GOAL]), (1.0, [REST])), "times do not increase from 0"),
        (trajectory((1.0, [GOAL[:2]])), "wrong number of positions"),
        (trajectory((1.0, [GOAL, GOAL * 0]), (2.0, [GOAL])), "wrong number of velocities"),
        (trajectory((1.0, [GOAL, GOAL])), "it does not end at rest"),
        (trajectory((1.0, [GOAL, (), GOAL])), "accelerations need velocities"),
        (trajectory((1.0, [GOAL * np.nan])), "positions are not finite"),
        (trajectory((0.0, [GOAL])), "its only point is at time 0"),
        (trajectory(), "it has no points"),
    ],
)
def test_trajectories_that_are_none_are_refused(drive: Any, sent: list[object], reason: str) -> None:
    *_, said, row = drive(*STARTED, *sent, "update")
    assert said == f"trajectory refused: {reason}"
    assert_allclose(rows([row]).tau, MODEL.gravity(REST[None]), atol=1e-9)


def test_commands_are_within_the_effort_limits(drive: Any) -> None:
    script = configured(kp=1e4, **limited(joint_2=1.5))
    found = rows(drive(*script, *state(REST.tolist()), "activate", *state((REST + 1).tolist()), "update")[3:])
    assert found.tau[0, 1] in (1.5, -1.5) and np.abs(found.tau[0, [0, 2]]).min() > 20  # no limit: no clamp
    written = rows(drive(*configured(kp=1e4), *state(REST.tolist()), "activate", *state(REST + 1), "update")[3:])
    assert_allclose(np.abs(written.tau[0]), MODEL.robot.effort_limit)  # as --ros writes them


@pytest.mark.parametrize("column", range(2 * N))
def test_nothing_is_commanded_from_a_state_that_is_no_number(drive: Any, column: int) -> None:
    broken = np.stack([REST, 0 * REST], axis=1).ravel()
    broken[column] = np.nan
    found = rows(drive(*STARTED, "update", "state", *broken, "update")[3:])
    assert found.result.tolist() == [0, 1]
    assert_allclose(found.tau[1], found.tau[0])


def test_a_controller_that_is_not_active_commands_nothing(drive: Any) -> None:
    sent = trajectory((1.0, [GOAL]))
    script = [*STARTED, *sent, "run", 5, *sent, "deactivate", *sent, *state(-REST), "activate", "update"]
    *_, stopped, refused, started, row = drive(*script)
    assert (stopped, started) == (str(SUCCESS),) * 2
    assert refused == "trajectory refused: the controller is not active"
    assert_allclose(rows([row]).tau, MODEL.gravity(-REST[None]), atol=1e-9)  # the position at activation is held
    *_, before, _, after = drive(*STARTED, "run", 3, "deactivate", "show")
    assert rows([before]).tau.any() and not rows([after]).tau.any()
    assert drive(*configured(), *state(REST * np.nan), "activate")[-1] == str(FAILURE)


def test_states_that_cannot_be_read_are_bridged_for_some_cycles_alone(drive: Any) -> None:
    found = rows(drive(*STARTED, "run", 5, "contended", 1, *["update"] * 12, "contended", 0, "update")[3:])
    assert found.result.tolist() == [0] * 15 + [1] * 2 + [0]
    assert not found.allocations.any()


def test_noise_of_a_standing_robot_does_not_switch_friction(drive: Any) -> None:
    quantum = 2 * np.pi / 2**17 / 1e-2  # [rad/s] of a 17-bit encoder, differentiated over 10 ms
    signs = np.random.default_rng(0).integers(-1, 2, (200, N))
    script = [word for sign in signs for word in (*state(REST, sign * quantum), "update")]
    found = rows(drive(*STARTED, *script)[3:])
    assert np.abs(np.diff(found.tau[:, 1:], axis=0)).max() < 0.1 * 2 * LEVEL  # damping alone
