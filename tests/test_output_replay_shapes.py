"""Shapes of robots: from descriptions, capsules where these have none, and meshes that are too large."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from signid.output.replay.shapes import Triangles, between, box, capsule, cylinder, look, share, simplify
from signid.output.replay.track import axis, movers
from signid.robot import load_robot


def volume(mesh: Triangles) -> float:
    """Volume by the divergence theorem, positive if triangles face outwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def test_shapes_of_descriptions_and_without() -> None:
    boxes = look(load_robot("3r"))
    assert list(boxes.bodies) == [1, 2, 3] and boxes.notes == ()
    assert_allclose(volume(boxes.bodies[2]), 0.3 * 0.05 * 0.05)
    assert_allclose(boxes.bodies[2].vertices.mean(axis=0), (0.15, 0, -0.15))
    panda = look(load_robot("panda"))
    assert panda.notes == () and sum(len(shape.faces) for shape in panda.bodies.values()) > 100_000
    assert all(0.05 < np.ptp(shape.vertices, axis=0).max() < 0.7 for shape in list(panda.bodies.values())[:9])


def test_capsules_where_meshes_are_lost(tmp_path: Path) -> None:
    text = Path(load_robot("panda").path).read_text().replace("package://", "package://elsewhere/")
    (tmp_path / "lost.urdf").write_text(text)
    lost = look(load_robot(tmp_path / "lost.urdf"))
    assert lost.notes[0].startswith("meshes missing or unreadable") and lost.notes[1].startswith("drawn as capsules")
    assert len(lost.bodies) == 10 and all(volume(shape) > 0 for shape in lost.bodies.values())
    reach = np.ptp(np.concatenate([shape.vertices for shape in lost.bodies.values()]), axis=0)
    assert 0.2 < reach.max() < 1.5


def test_meshes_are_found_beside_in_packages_and_in_folders_named(tmp_path: Path) -> None:
    stl = tmp_path / "pack" / "meshes" / "a b.stl"
    stl.parent.mkdir(parents=True)
    normal = "facet normal 0 0 1\nouter loop\n{}\nendloop\nendfacet\n"
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    sides = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    faces = [normal.format("\n".join("vertex {} {} {}".format(*corners[k]) for k in side)) for side in sides]
    stl.write_text(f"solid a\n{''.join(faces)}endsolid a\n")
    near = "pack/meshes/a b.stl"
    for name in (f"package://{near}", near, near.replace(" ", "%20"), stl.as_uri(), str(stl)):
        for scale in ("1 1 1", "-2 1 1"):
            urdf = Path(load_robot("1r").path).read_text()
            mesh = f'<geometry><mesh filename="{name}" scale="{scale}"/></geometry>'
            start, _, rest = urdf.partition("<geometry>")
            (tmp_path / "meshed.urdf").write_text(start + mesh + rest.partition("</geometry>")[2])
            (shape, *_) = [x for x in look(load_robot(tmp_path / "meshed.urdf")).bodies.values() if len(x.faces) == 4]
            assert_allclose(volume(shape), 2 / 6 if scale[0] == "-" else 1 / 6)
    inside = load_robot(tmp_path / "meshed.urdf")
    assert look(inside, [tmp_path]).notes == ()


def test_solids_look_outwards() -> None:
    assert_allclose(volume(box(np.array([1, 2, 3.0]))), 6)
    assert_allclose(volume(cylinder(0.5, 2.0)), np.pi / 2, rtol=0.02)
    assert_allclose(volume(capsule(0.5, 0.0)), np.pi / 6, rtol=0.05)
    tube = between(np.array([1.0, 2, 3]), np.array([1.0, 2, 5]), 0.5)
    assert_allclose(volume(tube), np.pi / 2 + np.pi / 6, rtol=0.05)
    assert_allclose([tube.vertices.min(0), tube.vertices.max(0)], [(0.5, 1.5, 2.5), (1.5, 2.5, 5.5)], atol=0.02)


def test_large_meshes_are_thinned_and_keep_their_form() -> None:
    angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, 200, endpoint=False), np.linspace(0.01, np.pi - 0.01, 200))
    ring = np.sin(height)
    points = np.column_stack([x.ravel() for x in (ring * np.cos(angle), ring * np.sin(angle), np.cos(height))])
    i, j = (x.ravel() for x in np.meshgrid(np.arange(199), np.arange(200), indexing="ij"))
    a, b, c, d = 200 * i + j, 200 * i + (j + 1) % 200, 200 * (i + 1) + j, 200 * (i + 1) + (j + 1) % 200
    ball = Triangles(points, np.concatenate([np.column_stack([a, c, b]), np.column_stack([b, c, d])]))
    thin = simplify(ball, 5000)
    assert 2500 < len(thin.faces) <= 5000 and abs(volume(thin) / volume(ball) - 1) < 0.05
    assert simplify(ball, len(ball.faces)) is ball
    assert share([10, 500, 100], 200) == [10, 95, 95] and share([10, 20], 100) == [10, 20]


def test_mimic_and_held_joints_are_shown_with_their_leaders() -> None:
    robot = load_robot("panda", lock={"panda_joint4": 0.3})
    assert movers(robot, range(10)) == [-1, 0, 1, 2, 2, 3, 4, 5, 6, 6]
    body, along, slides = axis(robot, robot.joints.index("panda_finger_joint1"))
    assert (body, slides) == (8, True)
    assert_allclose(along, (0, 1, 0), atol=1e-12)
