"""Payload and tool in the files of Franka, Universal Robots and KUKA."""

from __future__ import annotations

import ast
import json
import re
from hashlib import sha256
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from exported import model_of
from numpy.testing import assert_allclose
from test_payload_model import BOX, ERRORS

import signid
from signid.cli import run
from signid.errors import OptionError, RobotError
from signid.model import Model, load_model
from signid.payload import with_payload
from signid.types import Array

BODY = pin.Inertia.FromDynamicParameters(BOX)
PLACES = {  # flange in the frame of the last joint, by hand from the descriptions
    "franka": pin.SE3(np.eye(3), np.array([0, 0, 0.107])),
    "ur": pin.SE3(pin.rpy.rpyToMatrix(-np.pi / 2, 0, 0), np.array([0, 0.0922, 0])),
}
PLACES["kuka"] = PLACES["ur"]


def arm(kind: str) -> Model:
    joints = [f"panda_joint{k}" for k in range(1, 8)]
    return load_model(signid.load_robot("panda", joints=joints)) if kind == "franka" else load_model("ur10")


def numbers(kind: str, text: str) -> pin.Inertia:
    """The body that a file states, in the flange frame."""
    if kind == "franka":
        read = json.loads(text)
        return pin.Inertia(read["mass"], np.array(read["centerOfMass"]), np.reshape(read["inertia"], (3, 3)).T)
    if kind == "ur":
        [call] = re.findall(r"^set_target_payload\((.*)\)$", text, re.MULTILINE)
        mass, centre, (xx, yy, zz, xy, xz, yz) = ast.literal_eval(f"[{call}]")
        return pin.Inertia(mass, np.array(centre), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    [line] = re.findall(r"^LOAD_DATA\[1\]=(.*)$", text, re.MULTILINE)
    mass, x, y, z, a, b, c, *moments = (float(part) for part in re.findall(r"[MXYZABC] ([-0-9.]+)", line))
    turn = turned(a, b, c)
    return pin.Inertia(mass, np.array([x, y, z]) / 1e3, turn @ np.diag(moments) @ turn.T)


def turned(a: float, b: float, c: float) -> Array:
    """Rotation of KUKA's angles [deg]: about Z, then about the new Y, then about the new X."""
    steps = zip((a, b, c), ([0, 0, 1], [0, 1, 0], [1, 0, 0]), strict=True)
    return np.linalg.multi_dot([pin.AngleAxis(np.radians(x), np.array(axis, float)).matrix() for x, axis in steps])


@pytest.mark.parametrize("kind", ["franka", "ur", "kuka"])
def test_the_body_comes_back(kind: str) -> None:
    made = signid.export(with_payload(arm(kind), BOX, ERRORS), kind)
    found, place = numbers(kind, made.text), PLACES[kind]
    assert_allclose(found.mass, 1.2)
    assert_allclose(found.lever, place.rotation.T @ (BODY.lever - place.translation), atol=1e-8)
    assert_allclose(found.inertia, place.rotation.T @ BODY.inertia @ place.rotation, atol=1e-8)
    assert_allclose(place.act(found).toDynamicParameters(), BOX, atol=1e-7)  # by the parallel axes of Pinocchio
    commented = made.text + made.beside.get("_load.h", "")
    for words in ("mass 1.200 +- 0.02 kg", "kg.m2", "flange frame", "SHA-256", *made.notes):
        assert words in commented


def test_the_header_of_libfranka_and_the_tool() -> None:
    made = signid.export(with_payload(arm("franka"), BOX), "franka", tool="panda_hand_tcp")
    read = json.loads(made.text)
    assert sorted(read) == ["centerOfMass", "color", "id", "inertia", "mass", "name", "transformation"]
    tool = pin.SE3(pin.rpy.rpyToMatrix(0, 0, -np.pi / 4), np.array([0, 0, 0.1034]))
    assert_allclose(np.reshape(read["transformation"], (4, 4)).T, tool.homogeneous, atol=1e-8)
    header = made.beside["_load.h"]
    assert re.findall(r"\{\{(.*)\}\}", header) == [str(read[key])[1:-1] for key in ("centerOfMass", "inertia")]
    assert "the model states no uncertainty of the payload" in header


def test_tools_of_ur_and_kuka() -> None:
    model = with_payload(arm("ur"), BOX)
    turn = pin.rpy.rpyToMatrix(np.pi / 2, 0, 0) @ pin.rpy.rpyToMatrix(0, 0, np.pi / 2)  # ee_link in tool0
    pose = ast.literal_eval(re.findall(r"^set_tcp\(p(.*)\)$", signid.export(model, "ur", tool="ee_link").text, re.M)[0])
    assert_allclose(pin.exp3(np.array(pose[3:])), turn, atol=1e-6)
    line = re.findall(r"^TOOL_DATA\[1\]=(.*)$", signid.export(model, "kuka", tool="ee_link").text, re.MULTILINE)[0]
    x, y, z, *angles = (float(part) for part in re.findall(r"[XYZABC] ([-0-9.]+)", line))
    assert_allclose([x, y, z], 0.0, atol=1e-6)
    assert_allclose(turned(*angles), turn, atol=1e-6)


@pytest.mark.parametrize("kind", ["franka", "ur", "kuka"])
@pytest.mark.parametrize("reason", ["as of a point mass", "not identifiable", "no body has its principal moments"])
def test_an_inertia_that_is_not_known_is_not_written(kind: str, reason: str) -> None:
    errors, load = ERRORS.copy(), BOX.copy()
    if reason == "not identifiable":
        errors[9, 9] = np.inf
    elif reason.startswith("no body"):
        load[9] += 0.1
    else:
        load, errors = load[:4], errors[:4, :4]
    made = signid.export(with_payload(arm(kind), load, errors), kind)
    assert [note for note in made.notes if reason in note and note.startswith("the inertia of the payload is left out")]
    if kind == "ur":
        assert re.search(r"^set_target_payload\(1\.2, \[[^]]*\]\)$", made.text, re.MULTILINE)
    else:
        assert_allclose(numbers(kind, made.text).inertia, 0.0, atol=1e-15)


def test_payloads_that_cannot_be_exported() -> None:
    lost = ERRORS.copy()
    lost[0, 0] = np.inf
    with pytest.raises(OptionError, match="are not identifiable"):
        signid.export(with_payload(arm("ur"), BOX, lost), "ur")
    with pytest.raises(RobotError, match="has a mass of 0 kg"):
        signid.export(model_of("ur10", "payload:mass=0,first_moment_x=0.1"), "ur")


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    with_payload(load_model("3r"), BOX, ERRORS).save("model.json")
    load_model("3r").save("bare.json")
    assert run(["export", "model.json", "--ur", "a.script", "--franka", "a.json", "--flange", "tool"]) == 0
    assert "ur: the payload is in the frame tool" in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.glob("a*")) == ["a.json", "a.script", "a_load.h"]
    assert sha256(Path("model.json").read_bytes()).hexdigest() in Path("a.script").read_text()
    for given, sentence in {
        ("bare.json", "--kuka", "k"): "has no payload to export; `signid payload` identifies one",
        ("model.json", "--kuka", "k"): "the flange frame of 3r is not known (none of link_3, tool has a usual name)",
        ("model.json", "--kuka", "k", "--flange", "base"): "--flange 'base' is no frame that is fixed to the last link",
        ("model.json", "--kuka", "k", "--flange", "tool", "--tool", "x"): "give one of link_3, tool",
        ("model.json", "--urdf", "k", "--flange", "tool"): "--flange and --tool belong to --franka, --ur and --kuka",
    }.items():
        assert run(["export", *given]) == 2
        assert sentence in " ".join(capsys.readouterr().err.split())
        assert not Path("k").exists()
