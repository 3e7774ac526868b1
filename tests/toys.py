"""Small robot descriptions, built from parts."""

from __future__ import annotations

from pathlib import Path

import pytest

from signid.errors import RobotError
from signid.robot import load_robot, robot_from_text
from signid.types import Robot

BODY = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
LIMIT = '<limit lower="-1" upper="2" effort="3" velocity="4"/>'


def link(name: str, body: str = BODY) -> str:
    return f'<link name="{name}">{body}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", more: str = LIMIT, axis: str = "0 1 0") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{more}</joint>'


def urdf(*parts: str, name: str = ' name="toy"') -> str:
    return f"<robot{name}>{''.join(parts)}</robot>"


def toy(*parts: str, name: str = ' name="toy"') -> Robot:
    return robot_from_text(urdf(*parts, name=name), "urdf", "file")


def refused(path: Path, content: str, says: str) -> None:
    """A description whose file is refused with these words."""
    path.write_text(content)
    with pytest.raises(RobotError, match=says):
        load_robot(path)


PAIR = (link("a"), link("b"), joint("z", "a", "b"))
CHAIN = (link("a"), link("b"), link("c"), joint("z", "a", "b"), joint("y", "b", "c"))
