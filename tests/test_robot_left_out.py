"""Notes on what a URDF shows and the model lacks: loops of closed linkages, and links that are only drawn."""

from __future__ import annotations

import pytest
from toys import LIMIT, PAIR, joint, link, toy

from signid.robot import load_robot

DRAWN = '<visual><geometry><mesh filename="package://none/x.stl"/></geometry></visual>'


def about(notes: tuple[str, ...], words: str) -> list[str]:
    return [note for note in notes if words in note]


@pytest.mark.parametrize("name", ["knee_loop", "LoopClosure", "four_bar_crank", "4bar", "fourbar_left", "knee_mimic"])
def test_names_of_closed_linkages(name: str) -> None:
    robot = toy(*PAIR, link("c"), joint(name, "b", "c"))
    [note] = about(robot.notes, "loops are missing")
    assert note.startswith(f"joint {name} is part of a closed linkage by its name; a URDF file is a tree")


def test_names_of_links_and_joints_that_follow_another() -> None:
    robot = toy(*PAIR, link("coupler"), joint("x", "b", "coupler"), link("d"), joint("closure_2", "b", "d"))
    [note] = about(robot.notes, "loops are missing")
    assert note.startswith("joint closure_2, link coupler are parts of closed linkages by name")
    follows = joint("finger_mimic", "b", "c", more=f'{LIMIT}<mimic joint="z"/>')
    assert not about(toy(*PAIR, link("c"), follows).notes, "loop")
    assert not about(toy(*PAIR).notes, "loop")


def test_joints_of_gazebo_alone_are_left_out() -> None:
    closing = '<gazebo><joint name="j_close" type="revolute"><parent>a</parent><child>b</child></joint></gazebo>'
    [note] = about(toy(*PAIR, closing).notes, "left out")
    assert "only a <gazebo> element states them: joints j_close" in note


def test_links_that_are_only_drawn() -> None:
    robot = toy(link("a", DRAWN), link("b", DRAWN), joint("z", "a", "b"), link("c"), joint("y", "b", "c"))
    assert about(robot.notes, "no mass and no inertia") == ["the shape of link b gives no mass and no inertia; "
                                                      "add an <inertial> there"]  # fmt: skip
    fixed = toy(link("a"), link("b"), joint("z", "a", "b"), link("c", DRAWN), joint("y", "b", "c", "fixed"))
    assert not about(fixed.notes, "no mass and no inertia"), "the body has a mass"


@pytest.mark.parametrize("name", ["3r", "panda", "ur5", "kinova", "anymal_c", "pr2", "talos", "solo12"])
def test_robots_without_loops_get_no_such_note(name: str) -> None:
    assert not about(load_robot(name).notes, "loops are missing")
