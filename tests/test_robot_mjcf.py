"""Models that MuJoCo compiles from MJCF: dynamics against MuJoCo, springs, meshes, and limits of work."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import signid
from signid.errors import RobotError
from signid.model import stated_laws
from signid.robot import configuration, hold, load_robot, robot_from_text
from signid.types import Array, Robot

mujoco = pytest.importorskip("mujoco")

ARM = """<mujoco model="arm"><compiler angle="radian"/><worldbody>
<body name="upper" pos="0 0 0.5"><inertial pos="0 0 -0.2" mass="2" diaginertia="0.02 0.02 0.002"/>
  <joint name="shoulder" axis="0 1 0" range="-2 2"/><geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03"/>
  <body name="lower" pos="0 0 -0.4"><inertial pos="0 0 -0.15" mass="1" diaginertia="0.01 0.01 0.001"/>
    <joint name="elbow" axis="0 1 0" range="-2 2"/></body></body></worldbody></mujoco>"""
WORLD = '<worldbody><light pos="0 0 2"/><geom name="floor" type="plane" size="1 1 0.1"/></worldbody>'
SHAPES = '<geom type="box" size=".1 .2 .05" pos=".1 0 .2"/><geom type="capsule" fromto="0 0 0 .1 .2 .3" size=".04"/>'


def corners(scale: float) -> bytes:
    """STL of a tetrahedron."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * scale
    faces = [points[list(face)] for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    return bytes(80) + struct.pack("<I", 4) + b"".join(struct.pack("<12fH", *[0] * 3, *x.ravel(), 0) for x in faces)


def world(bodies: str, before: str = "", after: str = "", angle: str = "radian") -> str:
    return f'<mujoco><compiler angle="{angle}"/>{before}<worldbody>{bodies}</worldbody>{after}</mujoco>'


SCENES: dict[str, dict[str, str | bytes]] = {
    "include beside a world": {"m.xml": f'<mujoco><include file="arm.xml"/>{WORLD}</mujoco>', "arm.xml": ARM},
    "include after a world": {"m.xml": f'<mujoco>{WORLD}<include file="arm.xml"/></mujoco>', "arm.xml": ARM},
    "two defaults, nested classes, childclass": {
        "m.xml": world(
            f'<body name="a" childclass="arm"><joint class="servo"/>{SHAPES}'
            f'<body pos="0 0 1"><joint axis="1 0 0"/>{SHAPES}'
            f'<body childclass="fine" pos="0 1 0"><joint axis="1 1 0"/>{SHAPES}</body></body></body>',
            before='<default><joint stiffness="2"/><default class="arm"><joint damping="1" armature=".005"/>'
            '<default class="fine"><joint damping=".25"/><geom density="300"/></default></default></default>'
            '<default><default class="servo"><joint damping="0.6" armature="0.03" frictionloss=".1"/></default>'
            "</default>",
        )
    },
    "frames and replicate": {
        "m.xml": world(
            f'<frame pos="0 0 1" euler="0 .5 0"><body name="a"><frame pos=".1 0 0" quat="1 1 0 0"><joint name="j"/>'
            f"{SHAPES}</frame></body></frame>"
            f'<replicate count="3" offset="0 .4 0" euler="0 0 .3"><body name="f" pos="1 0 0"><joint axis="0 1 0"/>'
            f"{SHAPES}</body></replicate>"
        )
    },
    "free base, mocap and fixed bodies": {
        "m.xml": world(
            f'<body name="stand" pos="3 0 0"><geom size=".1"/><body pos="0 0 1" euler="30 0 0"><joint axis="1 0 0"/>'
            f'{SHAPES}</body></body><body mocap="true" pos="1 1 1"><geom size=".1"/></body>'
            f'<body name="trunk" pos="0 0 1" euler="10 20 30"><freejoint/>{SHAPES}<body pos=".2 0 0">'
            f'<joint axis="0 1 0"/>{SHAPES}<body name="foot" pos="0 0 -.3"><geom size=".05"/></body></body></body>',
            angle="degree",
        )
    },
    "ball joint held": {
        "m.xml": world(
            f'<body><joint axis="0 1 0"/>{SHAPES}<body pos="0 0 1"><joint type="ball"/>{SHAPES}'
            f'<body pos=".1 0 0"><joint axis="1 0 0"/>{SHAPES}</body></body></body>'
        )
    },
    "springs, references, slides and several joints": {
        "m.xml": world(
            f'<body pos="0 0 1" quat=".8 0 .6 0"><joint axis="1 2 0" pos=".1 .2 .3" ref=".3" stiffness="30"'
            f' springref=".2" damping="2"/><joint type="slide" axis="0 1 1" ref=".1" stiffness="5" springref="-.1"/>'
            f'<joint axis="0 0 -1" pos="0 .1 0" range="-1 1"/>{SHAPES}<body pos="0 .3 0"><joint axis="1 0 0" ref="-.4"'
            f' pos="0 0 .2" springref="1.2" stiffness="1"/>{SHAPES}</body></body>'
        )
    },
    "degrees, sequences and full inertia": {
        "m.xml": world(
            '<body euler="10 20 30"><joint axis="0 1 0" range="-90 90" springref="30" stiffness="3" ref="15"/>'
            '<inertial pos=".1 .2 .3" mass="2" fullinertia=".3 .4 .5 .01 .02 -.03"/>'
            '<body pos="0 0 .5" euler="40 -50 60"><joint axis="0 0 1"/><inertial pos="0 .1 0" quat=".5 .5 .5 .5"'
            ' mass="1" diaginertia=".1 .2 .25"/></body></body>',
            before='<compiler eulerseq="ZYx"/><option gravity="1 2 -3"/>',
            angle="degree",
        )
    },
    "inertia from geometry": {
        "m.xml": world(
            f'<body><joint axis="0 1 0"/><inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>{SHAPES}'
            f'<geom type="mesh" mesh="part" euler=".3 .2 .1"/></body>',
            before='<compiler inertiafromgeom="true" meshdir="parts"/>'
            '<asset><mesh file="part.stl" scale="1 2 .5"/></asset>',
        ),
        "parts/part.stl": corners(0.2),
    },
    "balanced inertia and total mass": {
        "m.xml": world(
            '<body><joint axis="0 1 0"/><inertial pos=".1 0 0" mass="3" diaginertia="1 1 3"/></body>',
            before='<compiler balanceinertia="true" settotalmass="7"/>',
        )
    },
    "attached models": {
        "m.xml": world(
            f'<body name="z"><joint axis="0 1 0"/>{SHAPES}<attach model="hand" body="upper" prefix="left_"/></body>'
            '<frame pos="0 0 2"><attach model="hand" body="lower" prefix="right_"/></frame>',
            before='<asset><model name="hand" file="arm.xml"/></asset>',
        ),
        "arm.xml": ARM,
    },
    "mimic joints with references": {
        "m.xml": world(
            f'<body name="a"><joint name="j" axis="0 1 0" ref=".2" damping="1"/>{SHAPES}<body pos="0 0 1">'
            f'<joint name="k" axis="1 0 0" ref="-.1" stiffness="4" springref=".5" damping="2"/>{SHAPES}</body></body>',
            after='<equality><joint joint1="k" joint2="j" polycoef=".3 -2 0 0 0"/></equality>',
        )
    },
    "flags": {"m.xml": world(ARM[ARM.index("<body") : ARM.index("</worldbody>")].replace('axis="0 1 0"',
              'axis="0 1 0" stiffness="3" damping="2"'),
              before='<option><flag gravity="disable" spring="disable" damper="disable"/></option>')},
}  # fmt: skip


def written(files: dict[str, str | bytes], folder: Path) -> Path:
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return folder / "m.xml"


def passive(robot: Robot, q: Array, v: Array) -> Array:
    """Torque (n,) of the stated springs and dampers on the joints."""
    torque = np.zeros(len(robot.joints))
    for law in stated_laws(robot):
        (j,), numbers = law.joints, law.parameters
        if law.effect.name == "spring":
            torque[j] -= numbers["stiffness"] * (q[j] - numbers["rest"])
        elif law.effect.name == "viscous_friction":
            torque[j] -= numbers["coefficient"] * v[j]
    return torque


def compare(robot: Robot, theirs: object) -> None:
    """Mass matrix, bias and passive torque at random states, with free and ball joints at their initial pose."""
    moving = [i for i in range(theirs.njnt) if theirs.jnt_type[i] >= 2]
    places, rows = theirs.jnt_qposadr[moving], theirs.jnt_dofadr[moving]
    data, rng, mine = mujoco.MjData(theirs), np.random.default_rng(0), robot.model.createData()
    drive = robot.drive
    for _ in range(5):
        q, v = rng.normal(size=(2, len(robot.joints)))
        data.qpos[:], data.qvel[:] = theirs.qpos0, 0
        data.qpos[places], data.qvel[rows] = drive @ q + robot.rest, drive @ v
        mujoco.mj_forward(theirs, data)
        mass = np.zeros((theirs.nv, theirs.nv))
        for k in range(theirs.nv):
            mujoco.mj_mulM(theirs, data, mass[k], np.eye(theirs.nv)[k])
        at = configuration(robot, q)
        upper = np.triu(pin.crba(robot.model, mine, at))
        whole = drive.T @ (upper + np.triu(upper, 1).T) @ drive + np.diag(robot.actuators.armature)
        np.testing.assert_allclose(whole, drive.T @ mass[np.ix_(rows, rows)] @ drive, atol=1e-10)
        bias = drive.T @ pin.rnea(robot.model, mine, at, drive @ v, np.zeros(robot.model.nv))
        np.testing.assert_allclose(bias, drive.T @ data.qfrc_bias[rows], atol=1e-10)
        theirs_passive = drive.T @ (data.qfrc_spring + data.qfrc_damper)[rows]
        np.testing.assert_allclose(passive(robot, q, v), theirs_passive, atol=1e-10)


@pytest.mark.parametrize("scene", SCENES)
def test_dynamics_are_those_of_mujoco(scene: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo logs its warnings there
    path = written(SCENES[scene], tmp_path)
    robot, theirs = load_robot(path), mujoco.MjModel.from_xml_path(str(path))
    compare(robot, theirs)
    compare(robot_from_text(robot.document, "mjcf", robot.name), theirs)


def test_a_scene_is_the_robot_that_it_includes(tmp_path: Path) -> None:
    robot = load_robot(written(SCENES["include beside a world"], tmp_path))
    assert robot.links == ("upper", "lower") and [body.mass for body in robot.model.inertias][1:] == [2, 1]
    assert robot.notes == () and robot.lower.tolist() == [-2, -2]


def test_scenes_of_mujoco_itself() -> None:
    """The files that MuJoCo ships: one with meshes for mass, and one without moving joint beside free bodies."""
    found = sorted((Path(mujoco.__file__).parent / "testdata").glob("*.xml"))
    for path in found:
        theirs = mujoco.MjModel.from_xml_path(str(path))
        if np.any(theirs.jnt_type >= 2):
            compare(load_robot(path), theirs)
        else:
            with pytest.raises(RobotError, match="no moving joint"):
                load_robot(path)


def test_springs_are_laws_and_gravity_compensation_is_a_note(tmp_path: Path) -> None:
    text = world(
        '<body><joint name="j" axis="0 1 0" stiffness="30" springref="0.2"/>'
        '<inertial pos="0.2 0 0.1" mass="2" diaginertia="0.02 0.02 0.02"/><body name="c" pos=".3 0 0" gravcomp="1">'
        '<joint name="k" axis="0 1 0"/><inertial pos="0.2 0 0" mass="1" diaginertia="0.02 0.02 0.02"/></body></body>'
    )
    robot = robot_from_text(text, "mjcf", "x")
    assert robot.springs == {"j": (30.0, 0.2)}
    assert [note.split()[0] for note in robot.notes] == ["gravcomp", "joint"]
    model = signid.load_model(robot)
    (spring,) = [law for law in model.laws if law.effect.name == "spring"]
    assert spring.joints == (0,) and dict(spring.parameters) == {"stiffness": 30.0, "rest": 0.2}
    model.save(tmp_path / "model.json")
    assert "spring" in [law.effect.name for law in signid.load_model(str(tmp_path / "model.json")).laws]
    exported = signid.export(model, "mjcf").text
    again = robot_from_text(exported, "mjcf", "x")
    assert again.springs == {"j": (30.0, 0.2)}
    assert hold(robot, {"j": 0.1}).springs == {}


def test_identify_says_that_it_fits_no_springs(tmp_path: Path) -> None:
    text = ARM.replace('name="shoulder"', 'name="shoulder" stiffness="3"')
    (tmp_path / "arm.xml").write_text(text)
    t = np.arange(0, 4, 0.01)
    columns = {f"{key}_{j + 1}": np.sin((3 + j) * t) for key in ("q", "tau") for j in range(2)}
    robot = load_robot(tmp_path / "arm.xml")
    result = signid.identify(robot, [signid.read_recording({"t": t, **columns}, robot)])
    assert any("no springs are fitted" in flag and "shoulder" in flag for flag in result.flags)


def test_meshes_that_are_missing_cost_their_mass_and_a_note(tmp_path: Path) -> None:
    body = f'<body name="a"><joint axis="0 1 0"/>{SHAPES}<geom type="mesh" mesh="part"/></body>'
    text = world(body, before='<asset><mesh name="part" file="part.stl"/></asset>')
    path = written({"m.xml": text}, tmp_path)
    lost = load_robot(path)
    assert any("mass of the meshes of a is not computed" in note for note in lost.notes)
    (tmp_path / "part.stl").write_bytes(corners(0.3))
    whole = load_robot(path)
    assert whole.notes == lost.notes[:1] and whole.model.inertias[1].mass > lost.model.inertias[1].mass
    assert "part.stl" not in whole.document
    (tmp_path / "part.stl").write_bytes(corners(0.3)[:120])
    with pytest.raises(RobotError, match="MuJoCo cannot compile it: .*STL") as caught:
        load_robot(path)
    assert "\n" not in str(caught.value)


def test_meshes_and_models_are_read_below_the_folder_only(tmp_path: Path) -> None:
    (tmp_path / "robot").mkdir()
    (tmp_path / "part.stl").write_bytes(corners(0.3))
    (tmp_path / "arm.xml").write_text(ARM)
    body = '<body name="a"><joint axis="0 1 0"/><geom type="mesh" mesh="part"/></body>'
    asset = '<asset><mesh file="part.stl"/></asset><compiler meshdir=".."/>'
    robot = load_robot(written({"m.xml": world(body, before=asset)}, tmp_path / "robot"))
    assert robot.model.inertias[1].mass == 0 and any("mass of the meshes of a" in note for note in robot.notes)
    asset = '<asset><model name="arm" file="../arm.xml"/></asset>'
    with pytest.raises(RobotError, match="outside the folder"):
        load_robot(written({"m.xml": world('<attach model="arm" prefix="b"/>', before=asset)}, tmp_path / "robot"))


def nested(element: str, depth: int, inside: str) -> str:
    return element * depth + inside + f"</{element.split()[0][1:].rstrip('>')}>" * depth


BOMBS: dict[str, tuple[dict[str, str | bytes], str]] = {
    "includes": (
        {
            "m.xml": world(f"<body><joint/>{SHAPES}</body>", after='<include file="s0.xml"/>'),
            **{
                f"s{k}.xml": "<mujocoinclude>" + f'<include file="s{k + 1}.xml"/>' * 10 + "</mujocoinclude>"
                for k in range(9)
            },
            "s9.xml": "<mujocoinclude><default/></mujocoinclude>",
        },
        "more than 500 files",
    ),
    "replicated bodies": (
        {"m.xml": world(nested('<replicate count="1000">', 6, f"<body><joint/>{SHAPES}</body>"))},
        "more than 1000 bodies",
    ),
    "replicated geometry": (
        {"m.xml": world("<body><joint/>" + nested('<replicate count="900">', 3, SHAPES) + "</body>")},
        "more than 100000 elements",
    ),
    "attached models": (
        {
            f"{'m' if k == 0 else f'm{k}'}.xml": world(
                "".join(f'<attach model="n" body="b" prefix="p{i}_"/>' for i in range(10))
                + f'<body name="b">{SHAPES}</body>',
                before=f'<asset><model name="n" file="m{k + 1}.xml"/></asset>' if k < 6 else "",
            )
            for k in range(7)
        },
        "more than 1000 bodies",
    ),
    "included depth": (
        {
            "m.xml": world("<body>" * 200 + '<include file="m1.xml"/>' + "</body>" * 200),
            **{
                f"m{k}.xml": "<mujocoinclude>"
                + "<body>" * 200
                + f'<include file="m{k + 1}.xml"/>'
                + "</body>" * 200
                + "</mujocoinclude>"
                for k in range(1, 9)
            },
            "m9.xml": "<mujocoinclude/>",
        },
        "depth",
    ),
    "models in a circle": (
        {"m.xml": world('<attach model="n" prefix="p"/>', before='<asset><model name="n" file="m.xml"/></asset>')},
        "includes itself",
    ),
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_work_is_bounded_before_it_begins(bomb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("signid.robot.mjcf.restricted", lambda *_: pytest.fail("MuJoCo was started"))
    files, sentence = BOMBS[bomb]
    with pytest.raises(RobotError, match=sentence):
        load_robot(written(files, tmp_path))


def test_an_end_of_the_compiler_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "ends.py").write_text("import os; os._exit(134)")
    monkeypatch.setattr("signid.robot.sandbox.__file__", str(tmp_path / "ends.py"))
    with pytest.raises(RobotError, match="MuJoCo cannot compile it: it needs too much time or memory"):
        robot_from_text(ARM.replace("shoulder", "another"), "mjcf", "x")
