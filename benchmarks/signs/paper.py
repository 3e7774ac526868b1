"""The pendulum and the arm of Pennese and Vulcano: coefficients, recordings and published errors; the arm in PyBullet.

Robotics II project, Sapienza University of Rome, 2020. The recordings are noise-free torques of a model, stored with
nine digits. The torque of the same motions is also recomputed by MuJoCo in double precision. The printed table has 13
coefficients; ten combinations of them are identifiable from torque.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

import signid
from signid.regression.session import Options
from signid.types import BaseMap, Robot

from ..plants.bodies import Body, Drives
from ..plants.control import FUNDAMENTAL, Track, draw_motion, log
from ..plants.mujoco_ import build, inverse
from ..summary import data
from .trial import Array, Puzzle, Row, Target, Truth, attempt, planted

G, L2, L3, D2 = 9.81, 0.3, 0.2, 0.09  # gravity [m/s2], lengths [m]
COUNT = 13
PUBLISHED = (0.0113, 0.3040, 0.0005, 0.0702, 0.0003, 0.0675, 0.3741, 0.0702, 0.0354, 0.203, 4.9663, 2.2073, 2.2072)
DIGITS = (4, 4, 4, 4, 4, 4, 4, 4, 4, 3, 4, 4, 4)  # printed decimals
IDENTIFIABLE = (
    ("pi1 + pi3 + pi5", ((0, 1), (2, 1), (4, 1))),
    ("pi2 - pi3", ((1, 1), (2, -1))),
    ("pi4 - pi5", ((3, 1), (4, -1))),
    *((f"pi{k}", ((k - 1, 1),)) for k in (6, 7, 8, 9, 10)),
    ("pi11 + pi13", ((10, 1), (12, 1))),
    ("pi12", ((11, 1),)),
)
QUOTED = {  # errors of the paper's four estimates, quoted because the estimates are not in the data
    "the printed table, as printed": (2.9102, 3.7181, 2.9274, 3.1812),
    "the right 13": (1.541, 0.139, 1.481, 0.817),
    "the ten combinations": (0.0569, 0.0718, 0.0406, 0.0501),
}


@dataclass(frozen=True)
class Arm:
    """Masses [kg], centres of mass along the frames of Denavit and Hartenberg [m], inertias about them [kg.m2]."""

    masses: tuple[float, float] = (1.125, 0.75)  # links 2 and 3
    centre_2x: float = -0.15
    centre_2z: float = -0.06
    centre_3x: float = -0.1
    inertia_1y: float = 4.167e-3
    inertia_2: tuple[float, float, float] = (4.167e-4 * 1.125, 7.708e-3 * 1.125, 7.708e-3 * 1.125)
    inertia_3: tuple[float, float, float] = (4.167e-4 * 0.75, 3.542e-3 * 0.75, 3.542e-3 * 0.75)


@dataclass(frozen=True)
class Entry:
    """Printed and correct value of one coefficient."""

    name: str
    published: float
    right: float
    slipped: float  # value with mirrored centres of mass
    digits: int

    @property
    def wrong(self) -> bool:
        """Whether the printed number differs from the correct one in its last digit."""
        return abs(self.published - self.right) > 0.51 * 10.0**-self.digits

    @property
    def why(self) -> str:
        """Cause of a wrong entry, if known."""
        if not self.wrong:
            return ""
        if abs(self.published - self.slipped) <= 0.51 * 10.0**-self.digits:
            return "L + d for L - d"
        ten = abs(self.published - 10 * self.slipped) <= 0.51 * 10.0**-self.digits
        return "L + d for L - d, and the decimal point" if ten else "unknown"


def coefficients(arm: Arm, side: int = 1) -> Array:
    """The 13 coefficients [kg.m2, N.m] of an arm; side -1 mirrors the centres of mass."""
    (m2, m3), (xx2, yy2, zz2), (xx3, yy3, zz3) = arm.masses, arm.inertia_2, arm.inertia_3
    r2, r3 = L2 + side * arm.centre_2x, L3 + side * arm.centre_3x  # from the joint to the centre
    offset = D2 - side * arm.centre_2z
    return np.array(
        [
            arm.inertia_1y + m2 * offset**2 + m3 * D2**2,
            m2 * r2**2 + m3 * L2**2 + yy2,
            xx2,
            yy3 + m3 * r3**2,
            xx3,
            m3 * r3 * L2,
            zz2 + m2 * r2**2 + zz3 + m3 * (L2**2 + r3**2),
            m3 * r3**2 + zz3,
            m2 * r2 * offset + m3 * L2 * D2,
            m3 * r3 * D2,
            G * m2 * r2,
            G * m3 * r3,
            G * m3 * L2,
        ]
    )


def identifiable(thirteen: Sequence[float] | Array) -> Array:
    """Identifiable combinations (10,) [kg.m2, N.m] of all coefficients (13,) [kg.m2, N.m]."""
    return np.array([sum(side * thirteen[k] for k, side in terms) for _, terms in IDENTIFIABLE])


def entries() -> list[Entry]:
    """Entries of the printed and the correct table."""
    right, slipped = coefficients(Arm()), coefficients(Arm(), side=-1)
    rows = zip(PUBLISHED, right.tolist(), slipped.tolist(), DIGITS, strict=True)
    return [Entry(f"pi{k}", *row) for k, row in enumerate(rows, 1)]


def standard(arm: Arm) -> Array:
    """Standard parameters (30,) [kg, kg.m, kg.m2] of robots/3r; unidentifiable ones of link 1 are zero."""
    bodies = [np.zeros(10), np.zeros(10), np.zeros(10)]
    bodies[0][9] = arm.inertia_1y  # its axis of rotation is z there
    places = ((L2 + arm.centre_2x, 0.0, arm.centre_2z - D2), (L3 + arm.centre_3x, 0.0, 0.0))
    for k, (mass, centre, inertia) in enumerate(zip(arm.masses, places, (arm.inertia_2, arm.inertia_3), strict=True)):
        c = np.array(centre)
        about = np.diag(inertia) + mass * (c @ c * np.eye(3) - np.outer(c, c))
        bodies[k + 1][:] = [mass, *(mass * c), *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
    return np.concatenate(bodies)


def arm_map(base: BaseMap) -> Array:
    """Map (10, b) [units of the combinations over units of base] from base parameters of robots/3r to combinations.

    Raises:
        ArithmeticError: the base parameters belong to another arm.
    """
    values, wanted = _drawn(base)
    solution = np.linalg.lstsq(values, wanted, rcond=None)[0]
    if np.abs(values @ solution - wanted).max() > 1e-9:
        raise ArithmeticError("the base parameters belong to another arm")
    return np.asarray(solution.T)


def ten_of(base: BaseMap, value: Array, information: Array) -> Array:
    """Combinations (10,) [kg.m2, N.m] by weighted least squares, restricted to arms of this kind.

    Args:
        base: base map of robots/3r.
        value: estimate (b,) [units of base].
        information: information matrix (b, b) [1 over the square of these units].

    Raises:
        ArithmeticError: the base parameters belong to another arm.
    """
    _, size, rows = np.linalg.svd(_drawn(base)[0])
    such = rows[: np.sum(size > 1e-9 * size[0])].T  # (b, k) basis of the base parameters of these arms
    simple = such @ np.linalg.solve(such.T @ information @ such, such.T @ information @ value)
    return np.asarray(arm_map(base) @ simple)


def _drawn(base: BaseMap) -> tuple[Array, Array]:
    """Base parameters (60, b) and combinations (60, 10) of random arms; each is linear in the other."""
    rng, found = np.random.default_rng(0), []
    for _ in range(60):
        masses, a, b = rng.uniform(0.5, 2.0, 2), rng.uniform(1e-3, 1e-2, 3), rng.uniform(1e-3, 1e-2, 3)
        arm = Arm(tuple(masses), *rng.uniform(-0.2, 0.2, 3), rng.uniform(1e-3, 1e-2), tuple(a), tuple(b))
        found.append((base.combination @ standard(arm), identifiable(coefficients(arm))))
    values, wanted = (np.array(part) for part in zip(*found, strict=True))
    return values, wanted


def pendulum_map(base: BaseMap) -> Array:
    """Map (2, b) [N.m and kg.m2 over units of base] from base parameters of robots/1r to m g d and I + m d2."""
    rows = np.zeros((2, base.rank))
    rows[0, base.expressions.index("mz_1")], rows[1, base.expressions.index("Iyy_1")] = -G, 1.0
    return rows


TRUE_1R = np.array([24.525, 1.67085])  # N.m, kg.m2
TRUE_3R = identifiable(coefficients(Arm()))  # kg.m2, N.m


OPTIONS = Options(effects=(), derivatives="recorded", cutoff=np.inf)
PENDULUM = {"1dof_experiment_easy1": 1.6e-5, "1dof_experiment_easy2": 4.3e-2, "1dof_experiment1": 2.0e-6}
ARM = {"3dof_experiment123": 5.9e-2, "3dof_experiment456": 3.4e-5}
PAPER = {key.partition("_")[2]: x for key, x in (PENDULUM | ARM).items()}  # errors in their repository
HELD_OUT = "3dof_validation_trajectory"  # files 7, 8, 9: joints 1, 2, 3
EXACT = {"1R": 1e-12, "3R": 1e-10}  # upper bound on the error with recomputed torque
SAME = 1e-6  # upper bound on the distance from the signed estimate with stored torque [1]
SEARCH = 0.1  # upper bound on the search time [s]


def rows(tree: bool) -> Iterator[Row]:
    """Yield all five by the exact search, with stored and recomputed torque; with stored torque also by the tree."""
    for anew in (False, True):
        for one in puzzles(anew):
            most = {"error": EXACT[one.group], "samples": 1.0} if anew else {"off": SAME}
            yield attempt(one, target=Target(segments=1.0, **most, seconds=SEARCH))
            if tree and not anew:
                yield attempt(one, "tree")


def folder() -> Path:
    """Folder of the recordings."""
    return data() / "seed_penne"


def puzzles(anew: bool) -> Iterator[Puzzle]:
    """Yield the five recordings with stored torque or with torque recomputed from the motion."""
    robot = signid.load_robot("1r")
    for name in PENDULUM:
        other = "1dof_experiment1" if name != "1dof_experiment1" else "1dof_experiment_easy2"
        sources = [columns(robot, name, anew), columns(robot, other, True)]
        yield puzzle("1R", name, robot, sources, anew)
    robot = signid.load_robot("3r")
    for name in ARM:
        yield puzzle("3R", name, robot, [columns(robot, name, anew), held_out(robot)], anew)


def puzzle(group: str, name: str, robot: Robot, sources: list[dict[str, Array]], anew: bool) -> Puzzle:
    """Puzzle of one recording; another motion is held out."""
    n, at = len(robot.joints), {"1R": pendulum_map, "3R": arm_map}[group]

    def error(base: BaseMap, value: Array) -> float:
        true = TRUE_1R if group == "1R" else own if anew else TRUE_3R
        return float(np.linalg.norm(at(base) @ value - true))

    base = signid.inspect(robot, effects=()).base
    own = at(base) @ planted(robot)(base, ())
    torques = [np.column_stack([s[f"tau_{j + 1}"] for j in range(n)]) for s in sources]
    truths = tuple(Truth(s["t"], tau, tau) for s, tau in zip(sources, torques, strict=True))
    case = name.partition("_")[2] + (", anew" if anew else "")
    return Puzzle(group, case, robot, (sources[0],), (sources[1],), OPTIONS, None, truths, error)


def columns(robot: Robot, name: str, anew: bool) -> dict[str, Array]:
    """Columns of a recording; a stored sine gives the position, with zero velocity."""
    table = pl.read_csv(folder() / f"{name}.csv.gz")
    found = {key: table[key].to_numpy().astype(float) for key in table.columns}
    if "q_1" not in found:
        found |= {"q_1": np.arcsin(found["sin_q_1"]), "dq_1": np.zeros(len(table))}
    return torqued(robot, found) if anew else {k: x for k, x in found.items() if k != "sin_q_1"}


def held_out(robot: Robot) -> dict[str, Array]:
    """Held-out motion with its torque."""
    found: dict[str, Array] = {}
    for j in range(len(robot.joints)):
        table = pl.read_csv(folder() / f"{HELD_OUT}{j + 7}.csv.gz")
        found |= {"t": table["t"].to_numpy().astype(float)}
        found |= {f"{key}_{j + 1}": table[key].to_numpy().astype(float) for key in ("q", "dq", "ddq")}
    return torqued(robot, found)


def torqued(robot: Robot, motion: dict[str, Array]) -> dict[str, Array]:
    """Add the torque of MuJoCo's inverse dynamics in double precision to a motion."""
    n = len(robot.joints)
    model = build(Body(robot.document, robot.joints), Drives.none(n), frictionless=True)
    states = (np.column_stack([motion[f"{key}_{j + 1}"] for j in range(n)]) for key in ("q", "dq", "ddq"))
    torque = inverse(model, robot.joints, *states)
    kept = {key: x for key, x in motion.items() if key != "sin_q_1"}
    return kept | {f"tau_{j + 1}": torque[:, j] for j in range(n)}


MOTIONS, PERIODS = 4, 5
MIDDLE = (1.0, 4.0)  # range of used periods
CENTRE, RATE = (0.0, 0.3, 0.5), 50.0  # centre of the motions [rad], rate [Hz]
BITS, NOISE = 17, 0.02  # encoder bits per turn, torque noise over each joint's rms torque [1]
FILTERS = {"filtered": Options(effects=()), "unfiltered": Options(effects=(), cutoff=np.inf)}
TARGET = Target(segments=0.99, ratio=1.3)


def bullet_rows(motions: int = MOTIONS, workers: int = 2) -> Iterator[Row]:
    """Yield each motion with and without signid's filter; the next motion is held out."""
    robot = signid.load_robot("3r")
    with ProcessPoolExecutor(workers) as pool:
        tracks = list(pool.map(record, range(motions)))
    for name, options in FILTERS.items():
        for k in range(motions):
            yield attempt(bullet_puzzle(robot, f"motion {k + 1}, {name}", k, tracks, options), target=TARGET)


def record(seed: int) -> Track:
    """Simulate the true track in the middle periods of a motion under PD control."""
    from ..plants import pybullet_  # runs in a separate process

    robot, still = signid.load_robot("3r"), Drives.none(len(CENTRE))
    body = Body(robot.document, robot.joints)
    track = pybullet_.simulate(body, still, draw_motion(CENTRE, seed), PERIODS / FUNDAMENTAL, RATE)
    kept = slice(*(round(x / FUNDAMENTAL * RATE) for x in MIDDLE))
    return Track(*(x[kept] for x in track))


def bullet_puzzle(robot: Robot, name: str, k: int, tracks: Sequence[Track], options: Options) -> Puzzle:
    """Puzzle of motion k; the next motion is held out."""
    pair = (tracks[k], tracks[(k + 1) % len(tracks)])
    train, held_out = (logged(track, seed) for seed, track in enumerate(pair, k))
    truths = tuple(Truth(track.t, track.tau, track.tau) for track in pair)

    def error(base: BaseMap, value: Array) -> float:
        """Error of the ten combinations for links as simple as in the paper."""
        return float(np.linalg.norm(ten_of(base, value, found.known.estimate.information) - TRUE_3R))

    found = Puzzle("3R Bullet", name, robot, (train,), (held_out,), options, planted(robot), truths, error)
    return found


def logged(track: Track, seed: int) -> dict[str, Array]:
    """Columns of a recording: encoder counts and torque noise."""
    return log(track, seed, BITS, NOISE)
