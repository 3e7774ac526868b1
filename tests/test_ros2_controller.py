"""The ROS 2 controller of `robots/ros2_controller`, compiled with generated C against a stub of ros2_control."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signid.effects import EFFECTS
from signid.model import load_model
from signid.output.export import export
from signid.regression.motion import Motion
from signid.types import Law

HERE = Path(__file__).parent
SOURCES = HERE.parent / "robots" / "ros2_controller"
STRICT = "-O1 -Wall -Wextra -Wconversion -Wno-sign-conversion -Werror".split()


@pytest.mark.skipif(not (shutil.which("cc") and shutil.which("c++")), reason="no C and C++ compilers")
def test_the_controller_commands_the_torque_of_the_model(tmp_path: Path) -> None:
    model = load_model("3r")
    laws = (Law(EFFECTS["viscous_friction"], (1,), {"coefficient": 0.5}),)
    model = replace(model, laws=laws)
    made = export(model, "c", name="arm")
    for end, text in {".c": made.text, ".h": made.beside[".h"]}.items():
        (tmp_path / f"arm{end}").write_text(text)
    names = ["-DSIGNID_JOINTS=ROBOT_3R_JOINTS", "-Dsignid_inverse_dynamics=robot_3r_inverse_dynamics"]
    folders = [f"-I{folder}" for folder in (tmp_path, SOURCES, HERE / "ros2_stub")]
    sources = [SOURCES / "inverse_dynamics_controller.cpp", HERE / "ros2_stub" / "run.cpp"]
    for command in (
        ["cc", "-std=c99", *STRICT, "-c", "arm.c"],
        ["c++", "-std=c++17", *STRICT, *names, *folders, *map(str, sources), "arm.o", "-o", "run"],
    ):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    q, v = np.array([[0.3, -0.5, 0.7]]), np.array([[0.4, 0.2, -0.6]])
    state = np.stack([q[0], v[0]], axis=1).ravel()
    out = subprocess.run([tmp_path / "run", *map(repr, state.tolist())], capture_output=True, text=True, check=True)
    interfaces, torque = out.stdout.splitlines()
    assert interfaces.split()[:4] == ["joint_1/effort", "joint_2/effort", "joint_3/effort", "joint_1/position"]
    expected = model.inverse(Motion(model.robot, np.zeros(1), q, v, -2.0 * v))
    assert_allclose(np.array(torque.split(), dtype=float), expected[0], rtol=1e-9, atol=1e-9)
