"""No file makes signid run code, download, or read files that do not belong to it."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bad_input import BOMB, INERTIAL, JOINT, LINKS
from swing import csv, swing
from toys import refused

import signid
from signid.errors import RecordingError
from signid.output.export import export
from signid.robot.locate import find_mesh
from signid.robot.sandbox import may_read
from signid.simulation.excite.limits import build_collision, build_limits

HERE = Path(__file__).parents[1]
SECRET = "<robot name='secret'/>"
NEVER = {
    "eval",
    "exec",
    "compile",
    "__import__",
    "pickle",
    "marshal",
    "shelve",
    "dill",
    "joblib",
    "cloudpickle",
}
NETWORK = {"socket", "urllib.request", "http", "requests", "httpx", "ftplib", "asyncio", "aiohttp", "pooch"}
ASKED = {"gallery.py", "live.py"}  # signid data, which is asked to download; the replay, served to this machine alone
HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def mentioned(path: Path) -> set[str]:
    """Modules that are imported, and plain names that are called."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            found.add(node.func.id)
    return found


def test_no_module_evaluates_or_unpickles_and_one_downloads() -> None:
    for path in (HERE / "signid").rglob("*.py"):
        found = mentioned(path)
        assert not found & NEVER, path
        yaml = {name for name in found if name.startswith("yaml")}
        assert yaml in (set(), {"yaml", "yaml.safe_dump"}), f"{path}: YAML is written, not read"
        assert {path.parent.name, path.name} & ASKED or not found & NETWORK, path


def test_commands_open_no_connection(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(csv(swing()))
    program = """if 1:
        import sys
        def watch(event, given):
            if event.startswith("socket.") and event not in ("socket.__new__", "socket.gethostname"):
                raise SystemExit(f"tried {event}")
        sys.addaudithook(watch)
        from signid.cli import run
        for command in ("inspect 3r", "identify 1r r.csv -o out", "replay 1r r.csv --html r.html", "data"):
            assert run(command.split()) in (0, 3), command
    """
    there = {**os.environ, "PYTHONPATH": str(HERE)}
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=there, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "r.html").is_file()


@pytest.mark.parametrize("name", ["r.urdf", "r.xacro", "r.xml"])
@pytest.mark.parametrize("entity", ["SYSTEM 'secret.xml'", "SYSTEM 'http://127.0.0.1:9/'", "'aaaaaaaaaa'"])
def test_entities_are_refused(name: str, entity: str, tmp_path: Path) -> None:
    (tmp_path / "secret.xml").write_text(SECRET)
    tag = "mujoco" if name == "r.xml" else "robot"
    refused(tmp_path / name, f"<!DOCTYPE r [<!ENTITY a {entity}>]><{tag}>&a;</{tag}>", "DOCTYPE")
    refused(tmp_path / name, BOMB, "DOCTYPE")


def test_includes_stay_beside_the_description(tmp_path: Path) -> None:
    inside, outside = tmp_path / "inside", tmp_path / "outside.xml"
    inside.mkdir()
    outside.write_text("<mujocoinclude/>")
    for name in ("../outside.xml", str(outside)):
        refused(inside / "r.xml", f'<mujoco><include file="{name}"/></mujoco>', "outside the folder")
    refused(inside / "r.xml", '<mujoco><include file="bomb.xml"/></mujoco>', "cannot be read")
    (inside / "bomb.xml").write_text(BOMB)
    refused(inside / "r.xml", '<mujoco><include file="bomb.xml"/></mujoco>', "DOCTYPE")


def test_meshes_stay_where_they_belong(tmp_path: Path) -> None:
    package = tmp_path / "arm"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    for path in (tmp_path / "secret.stl", package / "meshes/a.stl", package / "urdf/b.stl"):
        path.write_text("solid")
    description = str(package / "urdf/r.urdf")
    outside = ["package://arm/../secret.stl", "package://../secret.stl", "package:///secret.stl"]
    outside += [
        "../../secret.stl",
        str(tmp_path / "secret.stl"),
        f"file://{tmp_path}/secret.stl",
        "%2e%2e/%2e%2e/secret.stl",
    ]
    assert not any(find_mesh(name, description) for name in outside)
    assert find_mesh("package://arm/meshes/a.stl", description)
    assert find_mesh("b.stl", description)
    assert not find_mesh("../meshes/a.stl", description)
    (package / "package.xml").write_text("<package/>")
    assert find_mesh("../meshes/a.stl", description)
    assert find_mesh(str(tmp_path / "secret.stl"), description, [tmp_path])
    assert not find_mesh("x" * 9999, description) and not find_mesh("a\0b", description)


def test_no_mesh_from_outside_is_exported_or_collided_with(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    triangle = np.eye(3, dtype=np.float32)
    for path in (tmp_path / "a.stl", inside / "a.stl"):
        path.write_bytes(bytes(80) + (1).to_bytes(4, "little") + bytes(12) + triangle.tobytes() + bytes(2))
    for name, found in (("../a.stl", False), (str(tmp_path / "a.stl"), False), ("a.stl", True)):
        shape = f'<geometry><mesh filename="{name}"/></geometry>'
        links = LINKS.replace("</link>", f"<visual>{shape}</visual><collision>{shape}</collision></link>")
        (inside / "r.urdf").write_text(f'<robot name="r">{links}{JOINT}</robot>')
        model = signid.load_model(inside / "r.urdf")
        assert ("<mesh" in export(model, "mjcf").text) == found
        _, note = build_collision(model.robot, build_limits(model.robot), 0.01)
        assert ("is not found" in note) != found


def test_paths_are_checked_as_written(tmp_path: Path) -> None:
    assert may_read(tmp_path / "a/../b", [tmp_path])
    assert not may_read(tmp_path / "a/../../b", [tmp_path])
    assert not may_read(str(tmp_path) + "2/b", [tmp_path])


def test_robots_without_end_are_refused(tmp_path: Path) -> None:
    links = "".join(f'<link name="l{k}">{INERTIAL}</link>' for k in range(20_001))
    joints = "".join(
        JOINT.replace('"j"', f'"j{k}"').replace('"a"', f'"l{k}"').replace('"b"', f'"l{k + 1}"') for k in range(20_000)
    )
    refused(tmp_path / "r.urdf", f'<robot name="r">{links}{joints}</robot>', "more than 1000 links")
    bodies = '<body><joint type="hinge"/></body>' * 2000
    refused(tmp_path / "r.xml", f"<mujoco><worldbody>{bodies}</worldbody></mujoco>", "more than 1000 bodies")


def test_archives_of_objects_stay_closed(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "sprung"),)

    np.savez(tmp_path / "r.npz", t=np.arange(3.0), q_1=np.array([Trap()], object), allow_pickle=True)
    np.save(tmp_path / "r.npy", np.array([Trap()], object), allow_pickle=True)
    for name in ("r.npz", "r.npy"):
        with pytest.raises(RecordingError):
            signid.read_recording(tmp_path / name, signid.load_robot("1r"))
    assert not (tmp_path / "sprung").exists()


def test_words_among_the_numbers_of_a_body_are_refused(tmp_path: Path) -> None:
    inertial = '<inertial pos="joint 0 0.1" mass="2" diaginertia="0.1 0.1 0.1"/>'
    body = f'<body name="a">{inertial}<joint name="j" axis="0 1 0"/></body>'
    refused(tmp_path / "r.xml", f"<mujoco><worldbody>{body}</worldbody></mujoco>", "MuJoCo cannot compile it: .*'pos'")


@pytest.mark.parametrize("wrong", ["nan 0 -9.81", "inf 0 0", "0 -9.81", "0 0 0 1", "down", "nan 1", "0 inf"])
def test_numbers_of_a_model_are_numbers(wrong: str, tmp_path: Path) -> None:
    bodies = "".join(f'<body><joint name="{x}"/><geom size="0.1" type="sphere"/></body>' for x in "jk")
    for option in (f'<option gravity="{wrong}"/>', f'<equality><joint joint1="j" joint2="k" polycoef="{wrong}"/>'):
        end = "</equality>" if "equality" in option else ""
        if not end or "nan" in wrong or "inf" in wrong:
            text = f"<mujoco><worldbody>{bodies}</worldbody>{option}{end}</mujoco>"
            refused(tmp_path / "r.xml", text, "expected a finite number|MuJoCo cannot compile it: .*'gravity'")
