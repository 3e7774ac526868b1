"""Run a demonstration: conceal laws, record, diagnose, and compare the findings with what was concealed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from ...diagnose import Diagnosis, Finding, diagnose
from ...effects.naming import law_name
from ...errors import readable
from ...model import Model, stated_inertials, stated_laws
from ...output.replay import Replay, replay
from ...recording import read_recording
from ...recording.formats import find_format
from ...regression.motion import Motion
from ...regression.session import Options
from ...robot import hold, resting
from ...robot.dynamics import joint_of_row, own_row
from ...simulation.excite import build_limits, excite
from ...simulation.plant import Sensors, record, simulate, track
from ...types import Array, Frozen, Law, Progress, Recording, Robot, Trajectory
from .conceal import conceal, weak_torque

RECORDINGS = ("recording.csv", "held_out.csv")  # training data, held-out data
PERIOD, PERIODS, HARMONICS = 8.0, 2, 8  # period of a motion [s], number of periods, harmonics
DURATION = PERIODS * PERIOD  # length of a recording [s]
RATE, BITS, NOISE = 250.0, 17, 0.01  # sampling rate [Hz], encoder bits, torque noise over rms torque
MARGIN = 0.7  # share of every limit that the motions use
COARSE = 10  # decimation of the motion that determines the size of the laws
FOUND, MINOR, RIVAL, MISSED = "found", "minor", "alternative", "missed"


class LawOutcome(NamedTuple):
    """Result for a concealed law."""

    law: Law
    kind: str  # found (as a cause), minor (a correction), alternative (to another law), or missed
    finding: Finding | None  # the matching finding, or the one with the matching alternative
    probability: float  # probability of the law

    @property
    def found(self) -> Finding | None:
        """The finding of the law itself, if there is one."""
        return self.finding if self.kind in (FOUND, MINOR) else None


@dataclass(frozen=True, eq=False)
class Story(Frozen):
    """A demonstration: concealed laws and the diagnosis of the recordings."""

    simulation: Model  # the diagnosed description
    concealed: tuple[Law, ...]
    files: Mapping[str, bytes]  # recordings by file name: training, held out
    result: Diagnosis
    replay: Replay
    seed: int

    @property
    def outcomes(self) -> tuple[LawOutcome, ...]:
        """Result for each concealed law."""
        return tuple(_outcome(law, self.result) for law in self.concealed)

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags of the diagnosis, and wrong findings."""
        return (*self.result.flags, *_misses(self.outcomes, self.result))


def demo(robot: Robot, folder: str | Path, *, seed: int = 0, progress: Progress | None = None) -> Story:
    """Record a robot with concealed laws, and diagnose its simulation.

    The longest limb moves, the other joints are held. The diagnosis uses only the description and the files of the
    recordings, which are named as if they lay in the folder. Nothing is written there.
    """
    report = progress or (lambda stage, share: None)
    report("planning motions", 0.0)
    arm = take_arm(robot)
    known = Model(arm, stated_inertials(arm), stated_laws(arm))
    motions = [_motion(known, 2 * seed + k) for k in range(len(RECORDINGS))]
    report("recording", 0.2)
    coarse = Motion(arm, *(getattr(motions[0], key)[::COARSE] for key in "tqva"))
    concealed = conceal(known, coarse, seed)
    true = replace(known, laws=(*known.laws, *concealed))
    drawn = zip(RECORDINGS, motions, strict=True)
    files = {name: _record(true, known, motion, name, 2 * seed + k) for k, (name, motion) in enumerate(drawn)}
    train, held_out = _read(files, arm, Path(folder))
    result = diagnose(
        known,
        [train],
        held_out=[held_out],
        options=Options(seed=seed),
        progress=lambda stage, share: report(stage, 0.3 + 0.6 * share),
    )
    report("drawing", 0.9)
    return Story(known, concealed, files, result, replay(known, held_out, result), seed)


def _motion(known: Model, seed: int) -> Trajectory:
    """A repeated random motion; repetition separates noise from physics."""
    robot, limits = known.robot, build_limits(known.robot, margin=MARGIN, torque=np.inf)
    drawn = excite(
        known, kind="random", duration=PERIOD, harmonics=HARMONICS, limits=limits, rate=RATE, seed=seed
    ).trajectory
    q, v, a = (np.vstack([x[:-1]] * (PERIODS - 1) + [x]) for x in (drawn.q, drawn.v, drawn.a))
    return Trajectory(robot.joints, np.arange(len(q)) / RATE, q, v, a)


def _record(true: Model, known: Model, motion: Trajectory, name: str, seed: int) -> bytes:
    """Content of a recording of the true robot, whose controller knows its description."""
    moved = simulate(true, track(known, motion), DURATION)
    columns = record(true.robot, moved, Sensors(RATE, BITS), seed=seed)
    return find_format(Path(name)).encode({**columns, **_noisy(true.robot, columns, seed)}, name)


def _noisy(robot: Robot, columns: Mapping[str, Array], seed: int) -> dict[str, Array]:
    """The torques with white noise, of at least the size for a weak joint."""
    names = [f"tau_{joint}" for joint in robot.joints]
    torque = np.column_stack([columns[name] for name in names])
    size = np.sqrt(np.mean(torque**2, axis=0))
    noise = np.maximum(size, weak_torque(robot, size)) * np.random.default_rng([seed, 3]).standard_normal(torque.shape)
    return dict(zip(names, (torque + NOISE * noise).T, strict=True))


def _read(files: Mapping[str, bytes], robot: Robot, folder: Path) -> list[Recording]:
    """Read recordings from their files, which get the paths that they will have in the folder."""
    found = []
    with TemporaryDirectory() as place:
        for name, content in files.items():
            path = Path(place, name)
            path.write_bytes(content)
            found.append(replace(read_recording(path, robot), path=readable(str(folder / name))))
    return found


def take_arm(robot: Robot) -> Robot:
    """Return the robot with all joints held except those of its longest limb without fingers.

    Fingers are the part of the limb after its last branching, if that is the shorter part.
    """
    at = {joint_of_row(robot.model, own_row(robot, j)): joint for j, joint in enumerate(robot.joints)}
    limb = max((_way(robot, i, at) for i in at), key=len)
    forks = [k for k, i in enumerate(limb, 1) if len(robot.model.children[i]) > 1]
    if forks and 2 * forks[-1] > len(limb):
        limb = limb[: forks[-1]]
    return hold(robot, resting(robot, but=[at[i] for i in limb]))


def _way(robot: Robot, last: int, at: Mapping[int, str]) -> list[int]:
    """Indices of the actuated joints from the base to the last one."""
    way = [last]
    while way[0]:
        way.insert(0, int(robot.model.parents[way[0]]))
    return [i for i in way if i in at]


def _misses(outcomes: tuple[LawOutcome, ...], result: Diagnosis) -> Iterator[str]:
    """Yield a sentence for each law that was missed or named without being concealed."""
    for law, kind, finding, probability in outcomes:
        concealed = f"{law_name(law, result.robot)} was concealed"
        if kind == MISSED:
            yield f"{concealed} and missed"
        if kind == RIVAL and finding is not None:
            beside = law_name(finding.law, result.robot)
            yield f"{concealed} and named only as an alternative to {beside}, with probability {probability:.3f}"
    for cause in result.causes:
        if not any(cause is outcome.finding for outcome in outcomes):
            yield f"{law_name(cause.law, result.robot)} was named but not concealed"


def _outcome(law: Law, result: Diagnosis) -> LawOutcome:
    for finding in result.findings:
        if _same(finding.law, law):
            return LawOutcome(law, FOUND if finding.role == "cause" else MINOR, finding, finding.probability)
    for finding in result.findings:
        for rival in finding.alternatives:
            if _same(rival.law, law):
                return LawOutcome(law, RIVAL, finding, rival.probability)
    return LawOutcome(law, MISSED, None, 0.0)


def _same(one: Law, other: Law) -> bool:
    return (one.effect.name, one.joints) == (other.effect.name, other.joints)
