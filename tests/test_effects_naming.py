"""Laws by the names of joints: what does not fit the robot gets a sentence."""

from __future__ import annotations

import pytest
from toys import CHAIN, toy

import signid
from signid.effects.naming import parse_law
from signid.errors import OptionError, RobotError


def test_a_pair_on_a_robot_of_one_joint() -> None:
    for text in ("channel_swap:partner=joint_1", "channel_swap@joint_1:partner=joint_1"):
        with pytest.raises(OptionError, match="none is named|couples two joints"):
            parse_law(text, signid.load_robot("1r"))


def test_a_partner_that_is_not_there() -> None:
    robot = toy(*CHAIN)
    assert parse_law("channel_swap:partner=y", robot).joints == (0, 1)
    for text in ("channel_swap:partner=elbow", "channel_swap@z:partner=elbow"):
        with pytest.raises(RobotError, match="elbow"):
            parse_law(text, robot)
