"""The 3R arm in PyBullet, without friction and rotors: four motions, five periods each, of which three are used."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import signid
from signid.regression.session import Options
from signid.types import BaseMap, Robot

from ..plants.bodies import Body, Drives
from ..plants.control import FUNDAMENTAL, Track, draw_motion
from ..plants.record import log
from .coefficients import TRUE_3R, ten_of
from .row import Row, Target
from .trial import Puzzle, attempt, planted
from .truth import Array, Truth

MOTIONS, PERIODS = 4, 5
MIDDLE = (1.0, 4.0)  # periods that are used
CENTRE, RATE = (0.0, 0.3, 0.5), 50.0  # rad, Hz
BITS, NOISE = 17, 0.02  # of the encoders a turn; of torque, as a share of each joint's rms value
FILTERS = {"filtered": Options(effects=()), "unfiltered": Options(effects=(), cutoff=np.inf)}
TARGET = Target(segments=0.99, ratio=1.3)


def rows(motions: int = MOTIONS, workers: int = 2) -> Iterator[Row]:
    """Each motion, with and without signid's filter, judged by the next one."""
    robot = signid.load_robot("3r")
    with ProcessPoolExecutor(workers) as pool:
        tracks = list(pool.map(record, range(motions)))
    for name, options in FILTERS.items():
        for k in range(motions):
            yield attempt(puzzle(robot, f"motion {k + 1}, {name}", k, tracks, options), target=TARGET)


def record(seed: int) -> Track:
    """What truly happens in the middle periods of a motion under PD control."""
    from ..plants import pybullet_  # a process of its own

    robot, still = signid.load_robot("3r"), Drives.none(len(CENTRE))
    body = Body(robot.document, robot.joints)
    track = pybullet_.simulate(body, still, draw_motion(CENTRE, seed), PERIODS / FUNDAMENTAL, RATE)
    kept = slice(*(round(x / FUNDAMENTAL * RATE) for x in MIDDLE))
    return Track(*(x[kept] for x in track))


def puzzle(robot: Robot, name: str, k: int, tracks: Sequence[Track], options: Options) -> Puzzle:
    """Motion k, judged by the next."""
    pair = (tracks[k], tracks[(k + 1) % len(tracks)])
    learn, judge = (logged(track, seed) for seed, track in enumerate(pair, k))
    truths = tuple(Truth(track.t, track.tau, track.tau) for track in pair)

    def error(base: BaseMap, value: Array) -> float:
        """Of the ten combinations, links being as simple as in the paper."""
        return float(np.linalg.norm(ten_of(base, value, found.known.estimate.information) - TRUE_3R))

    found = Puzzle("3R Bullet", name, robot, (learn,), (judge,), options, planted(robot), truths, error)
    return found


def logged(track: Track, seed: int) -> dict[str, Array]:
    """As a recording has it: counts of the encoders, noise on torque."""
    return log(track, seed, BITS, NOISE)
