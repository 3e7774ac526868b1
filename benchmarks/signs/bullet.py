"""The 3R arm in PyBullet without friction and rotors: the middle three of five periods of four motions."""

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
MIDDLE = (1.0, 4.0)  # range of used periods
CENTRE, RATE = (0.0, 0.3, 0.5), 50.0  # centre of the motions [rad], rate [Hz]
BITS, NOISE = 17, 0.02  # encoder bits per turn, torque noise over each joint's rms torque [1]
FILTERS = {"filtered": Options(effects=()), "unfiltered": Options(effects=(), cutoff=np.inf)}
TARGET = Target(segments=0.99, ratio=1.3)


def rows(motions: int = MOTIONS, workers: int = 2) -> Iterator[Row]:
    """Yield each motion with and without signid's filter; the next motion is held out."""
    robot = signid.load_robot("3r")
    with ProcessPoolExecutor(workers) as pool:
        tracks = list(pool.map(record, range(motions)))
    for name, options in FILTERS.items():
        for k in range(motions):
            yield attempt(puzzle(robot, f"motion {k + 1}, {name}", k, tracks, options), target=TARGET)


def record(seed: int) -> Track:
    """Simulate the true track in the middle periods of a motion under PD control."""
    from ..plants import pybullet_  # runs in a separate process

    robot, still = signid.load_robot("3r"), Drives.none(len(CENTRE))
    body = Body(robot.document, robot.joints)
    track = pybullet_.simulate(body, still, draw_motion(CENTRE, seed), PERIODS / FUNDAMENTAL, RATE)
    kept = slice(*(round(x / FUNDAMENTAL * RATE) for x in MIDDLE))
    return Track(*(x[kept] for x in track))


def puzzle(robot: Robot, name: str, k: int, tracks: Sequence[Track], options: Options) -> Puzzle:
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
