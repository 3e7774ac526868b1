"""MJCF of robots with a floating base, and copies of meshes beside it."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from exported import model_of
from lxml import etree

import signid
from signid.cli import run
from signid.errors import RobotError
from signid.output.export import export


@pytest.mark.parametrize("name", ["go2", "g1", "anymal_c"])
def test_a_floating_trunk_has_the_mass_matrix_of_pinocchio(name: str) -> None:
    robot = signid.load_robot(name)
    made = export(robot, "mjcf", floating=True)
    there = mujoco.MjModel.from_xml_string(made.text)
    stated = sum(float(x.get("value")) for x in etree.fromstring(robot.document.encode()).iter("mass"))
    assert there.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE and there.nv == 6 + robot.model.nv
    np.testing.assert_allclose(there.body_mass.sum(), stated, rtol=1e-9)
    free = pin.buildModelFromXML(robot.document, pin.JointModelFreeFlyer())
    data, state, q = free.createData(), mujoco.MjData(there), pin.neutral(free)
    q[7:] = np.random.default_rng(1).uniform(-1, 1, robot.model.nv)
    state.qpos[:] = there.qpos0
    names = [there.joint(k).name for k in range(1, there.njnt)]
    ids = [free.getJointId(joint) for joint in names]
    state.qpos[7:] = [q[free.joints[k].idx_q] for k in ids]
    mujoco.mj_forward(there, state)
    found, expected = np.zeros((there.nv, there.nv)), pin.crba(free, data, q)
    mujoco.mj_fullM(there, state, found)
    there_armature = np.diag(there.dof_armature)
    rows = [*range(6), *(free.joints[k].idx_v for k in ids)]
    expected = np.triu(expected) + np.triu(expected, 1).T - np.diag(free.armature)
    np.testing.assert_allclose(found - there_armature, expected[np.ix_(rows, rows)], atol=1e-7)
    assert any("floats" in note for note in made.notes)


def test_a_fixed_base_remains_the_default() -> None:
    there = mujoco.MjModel.from_xml_string(export("go2", "mjcf").text)
    assert there.nv == 12 and not (there.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any()


def test_a_tilt_belongs_to_a_fixed_base() -> None:
    made = export(model_of(signid.load_robot("go2"), "base_tilt:x=0.2,y=-0.1"), "mjcf", floating=True)
    assert mujoco.MjModel.from_xml_string(made.text).opt.gravity.tolist() == [0, 0, -9.81]
    assert any("base_tilt" in flag for flag in made.flags)


def test_a_base_without_mass_cannot_float() -> None:
    with pytest.raises(RobotError, match="the base of 3r has no mass, so it cannot float"):
        export("3r", "mjcf", floating=True)


def test_meshes_are_copied_beside_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["export", "go2", "--mjcf", str(tmp_path / "dog.xml"), "--copy-meshes"]
    assert run(command) == 3, "friction by motor torque"
    copies = sorted((tmp_path / "dog_meshes").iterdir())
    out = capsys.readouterr().out
    assert copies and all(str(path) in out for path in copies)
    text = (tmp_path / "dog.xml").read_text()
    files = [mesh.get("file") for mesh in etree.fromstring(text.encode()).iter("mesh")]
    assert {str(tmp_path / file) for file in files} == set(map(str, copies))
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    (tmp_path / "dog.xml").rename(moved / "dog.xml")
    (tmp_path / "dog_meshes").rename(moved / "dog_meshes")
    assert mujoco.MjModel.from_xml_path(str(moved / "dog.xml")).nmesh == len(files)


def test_foreign_files_are_not_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["export", "go2", "--mjcf", str(tmp_path / "dog.xml"), "--copy-meshes"]
    assert run(command) == 3 and run(command) == 3, "equal meshes are kept"
    first = sorted((tmp_path / "dog_meshes").iterdir())[0]
    for path in (tmp_path / "dog.xml", *sorted((tmp_path / "dog_meshes").iterdir())[1:]):
        path.unlink()
    first.write_bytes(b"another mesh")
    capsys.readouterr()
    assert run(command) == 2
    assert "move it, or give --mjcf another name" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == [tmp_path / "dog_meshes"] and first.read_bytes() == b"another mesh"
    assert list((tmp_path / "dog_meshes").iterdir()) == [first]


def test_meshes_and_file_appear_together_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "dog_meshes").write_text("a file")
    assert run(["export", "go2", "--mjcf", str(tmp_path / "dog.xml"), "--copy-meshes"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1 and not (tmp_path / "dog.xml").exists()
    (tmp_path / "dog_meshes").unlink()
    (tmp_path / "dog_test.c").mkdir()  # the C files cannot be written into the same folder
    command = ["export", "go2", "--mjcf", str(tmp_path / "dog.xml"), "--copy-meshes", "--c", str(tmp_path / "dog.c")]
    assert run(command) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["dog_test.c"]


def test_options_of_an_mjcf_need_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for option in ("--floating", "--copy-meshes"):
        assert run(["export", "3r", "--urdf", str(tmp_path / "a.urdf"), option]) == 2
        assert "add --mjcf FILE" in capsys.readouterr().err


def test_meshes_of_one_name_stay_apart(tmp_path: Path) -> None:
    from signid.output.export.mjcf import copied

    meshes = [{"name": str(k), "file": f"/{folder}/a.stl"} for k, folder in enumerate("xyx")]
    assert copied(meshes, "m") == {"m/a.stl": Path("/x/a.stl"), "m/a_2.stl": Path("/y/a.stl")}
    assert [mesh["file"] for mesh in meshes] == ["m/a.stl", "m/a_2.stl", "m/a.stl"]
