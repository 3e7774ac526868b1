"""A vertical arm of two links with position drives, in closed form: a second plant beside MuJoCo."""

from __future__ import annotations

from pathlib import Path

import numba
import numpy as np

from .drive import Array, Drive

GRAVITY = 9.81
MASS, LENGTH, CENTRE, INERTIA = (0.9, 0.5), 0.3, (0.17, 0.14), (6e-3, 3e-3)  # [kg], [m], [m], [kg.m2]

URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="{c[0]} 0 0"/><mass value="{m[0]}"/>
<inertia ixx="1e-4" iyy="{i[0]}" izz="{i[0]}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="{c[1]} 0 0"/><mass value="{m[1]}"/>
<inertia ixx="1e-4" iyy="{i[1]}" izz="{i[1]}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 -1 0"/>
<limit lower="-3" upper="3" velocity="20" effort="40"/></joint>
<joint name="elbow" type="revolute"><origin xyz="{l} 0 0"/><parent link="upper"/><child link="lower"/>
<axis xyz="0 -1 0"/><limit lower="-3" upper="3" velocity="20" effort="40"/></joint></robot>"""
COLUMNS = ("kp", "kd", "viscous_friction", "coulomb_friction", "armature", "effort_limit")


def write_arm(path: Path) -> None:
    """Write the description of the arm."""
    path.write_text(URDF.format(c=CENTRE, m=MASS, i=INERTIA, l=LENGTH), encoding="utf-8")


def positions(drives: list[Drive], command: Array, rate: float, step: float) -> Array:
    """Positions (N, 2) [rad] at the instants of the commands (N, 2), each held and acting after the delay."""
    numbers = np.array([[getattr(drive, name) for name in COLUMNS] for drive in drives])
    late = np.array([int(round(drive.delay / step)) for drive in drives])
    duty = np.array([drive.law == "duty" for drive in drives])
    return np.asarray(_roll(numbers, late, duty, command, int(round(1 / rate / step)), step))


@numba.njit(cache=False)  # type: ignore[untyped-decorator]
def _roll(numbers, late, duty, command, substeps, step):  # type: ignore[no-untyped-def]
    """Semi-implicit steps; dry friction is the impulse within its bounds that stops a joint."""
    kp, kd, viscous, dry, rotor, limit = numbers.T
    out, q, v = np.empty_like(command), command[0].copy(), np.zeros(2)
    first = MASS[0] * CENTRE[0] ** 2 + INERTIA[0] + MASS[1] * LENGTH**2
    second, cross = MASS[1] * CENTRE[1] ** 2 + INERTIA[1], MASS[1] * LENGTH * CENTRE[1]
    force, impulse = np.empty(2), np.empty(2)
    for k in range(len(command)):
        out[k] = q
        for s in range(substeps):
            for j in range(2):
                row = max((k * substeps + s - late[j]) // substeps, 0)
                spring = kp[j] * (command[row, j] - q[j])
                if duty[j]:
                    force[j] = min(max(spring, -limit[j]), limit[j]) - kd[j] * v[j]
                else:
                    force[j] = min(max(spring - kd[j] * v[j], -limit[j]), limit[j])
                force[j] -= viscous[j] * v[j]
            c1, c12, sine = np.cos(q[0]), np.cos(q[0] + q[1]), cross * np.sin(q[1])
            low = MASS[1] * GRAVITY * CENTRE[1] * c12
            bias0 = low + (MASS[0] * CENTRE[0] + MASS[1] * LENGTH) * GRAVITY * c1 - sine * v[1] * (2 * v[0] + v[1])
            bias1 = low + sine * v[0] ** 2
            couple = second + cross * np.cos(q[1])
            m00, m11 = first + second + 2 * cross * np.cos(q[1]) + rotor[0], second + rotor[1]
            p0 = m00 * v[0] + couple * v[1] + step * (force[0] - bias0)
            p1 = couple * v[0] + m11 * v[1] + step * (force[1] - bias1)
            for _ in range(20):  # momentum less friction: each joint in turn, as Gauss and Seidel
                for j in range(2):
                    free = (p0 - couple * v[1]) if j == 0 else (p1 - couple * v[0])
                    impulse[j] = min(max(free, -step * dry[j]), step * dry[j])
                    v[j] = (free - impulse[j]) / (m00 if j == 0 else m11)
            q += step * v
    return out
