"""Changes of a log that must not matter: `python -m benchmarks.logs [--only NAME] [--seeds N] [--json FILE]`.

Each log (simulated arms with known parameters, a servo arm, real recordings) is identified as it is and after each
change; the table shows the largest change of a number in standard deviations, beyond what the information that the
change took away explains. Target: none above 1, and 93 to 97 % of the 95 % intervals of simulated robots hold the
truth.
"""

from __future__ import annotations

import os
import tempfile
import xml.etree.ElementTree as xml
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
import polars as pl
from rich.console import Console

import signid
from signid.errors import SignidError
from signid.regression.session import prepare
from signid.types import TWO_SIDED, Array, Robot

from ..arms import ARMS, Arm, load, truth
from ..concealed_real.sets import TABLE, data
from ..plants.bodies import Drives
from ..plants.mujoco_ import Body, draw_motion, log, simulate
from ..servo.drive import Truth
from ..servo.plant import record
from ..servo.robots import benches, motion
from ..summary import command_line, frame, print_targets, write_json
from .changes import CHANGES, Change, Changed

SECONDS, NOISE, BITS = 20.0, 0.02, 17
UR5 = Arm(
    *("ur5", 6, 125.0, (0.0, -1.2, 1.2, -0.5, 0.5, 0.0)),
    Drives((1.0, 1.0, 0.8, 0.2, 0.2, 0.2), (5.0, 5.0, 3.0, 1.0, 0.8, 0.8), (6, 6, 4, 1.2, 1.0, 0.8), (0.1,) * 6),
)
REAL = ("ur10e", "emps", "tx40")


@dataclass(frozen=True)
class Numbers:
    """Numbers of a result by name, with standard deviations; flags and notes."""

    value: Mapping[str, float]
    std: Mapping[str, float]
    flags: tuple[str, ...] = ()


@dataclass(frozen=True)
class Subject:
    """A robot with its original log."""

    name: str
    document: Path  # URDF
    columns: Mapping[str, Array]
    truth: Mapping[str, float]  # by name; empty if unknown
    identify: Callable[[Robot, list[signid.Recording]], Numbers]
    drives: bool = False  # whether the log has commands and no torque
    joints: tuple[str, ...] | None = None
    actuators: Path | None = None


def of_torque(robot: Robot, recordings: list[signid.Recording]) -> Numbers:
    """Base parameters by least squares."""
    found = signid.identify(robot, recordings, method="wls")
    names = found.base.expressions
    value, std = (dict(zip(names, x.tolist(), strict=True)) for x in (found.estimate.value, found.estimate.std))
    return Numbers(value, std, found.flags)


def of_drives(robot: Robot, recordings: list[signid.Recording]) -> Numbers:
    """Numbers of the drives."""
    from signid.servo.identify import identify_servos

    found = identify_servos(robot, recordings)
    each = {(one.joint, name): x for one in found.joints for name, x in one.numbers.items() if x.value is not None}
    known = {f"{name} of {joint}": x for (joint, name), x in each.items() if x.std}
    return Numbers(
        {name: float(x.value or 0.0) for name, x in known.items()},
        {name: float(x.std or 0.0) for name, x in known.items()},
        found.flags,
    )


def simulated(arm: Arm, folder: Path, seed: int) -> Subject:
    """An arm in MuJoCo along a random motion, with noise and encoders."""
    robot = load(arm)
    track = simulate(Body(robot.document, robot.joints), arm.drives, draw_motion(arm.centre, seed), SECONDS, arm.rate)
    columns = log(track, seed, BITS, NOISE)
    session = prepare(robot, [signid.read_recording(columns, robot)])
    known = dict(zip(session.task.base.expressions, truth(arm, session).tolist(), strict=True))
    path = folder / f"{arm.robot}.urdf"
    path.write_text(robot.document, encoding="utf-8")
    return Subject(arm.robot, path, columns, known, of_torque, joints=robot.joints)


def servo_arm(folder: Path, seed: int) -> Subject:
    """A pendulum with a position drive in MuJoCo."""
    [bench] = benches(folder, ("pendulum",))
    command = motion(bench, seed, SECONDS, 100.0)
    columns = record(bench.urdf, Truth(bench.drives), command, 100.0, seed)
    known = {
        f"{name} of {joint}": float(getattr(drive, name))
        for joint, drive in bench.drives.items()
        for name in ("kp", "coulomb_friction", "armature", "delay")
    }
    return Subject("servo", bench.urdf, columns, known, of_drives, drives=True)


def real(name: str) -> Subject:
    """The first recording of a real set; its true parameters are unknown."""
    found = next(one for one in TABLE if one.name == name)
    robot = found.robot()
    recording = signid.read_recording(data() / found.folder / f"{found.a[0].file}.csv.gz", robot)
    samples = recording.read()
    inside = (samples.t >= found.a[0].start) & (samples.t <= found.a[0].end)
    columns = {"t": samples.t[inside]}
    for j, joint in enumerate(recording.joints):
        columns |= {f"q_{joint}": samples.q[inside, j], f"tau_{joint}": samples.tau[inside, j]}
    path = data() / found.folder / found.urdf
    return Subject(name, path, columns, {}, of_torque, actuators=found.actuators)


def subjects(folder: Path, names: tuple[str, ...], seed: int) -> dict[str, Callable[[], Subject]]:
    """Ways to make the robots of some names."""
    arms = {arm.robot: arm for arm in (*ARMS[:2], UR5)}
    made: dict[str, Callable[[], Subject]] = {name: partial(simulated, arm, folder, seed) for name, arm in arms.items()}
    made["servo"] = partial(servo_arm, folder, seed)
    made |= {name: partial(real, name) for name in REAL}
    return {name: made[name] for name in names if name in made}


NAMES = ("3r", "ur5", "panda", "servo", *REAL)
MOST, COVERAGE = 1.0, (93.0, 97.0)  # largest excess [standard deviations]; coverage [%]


@dataclass(frozen=True)
class Row:
    """One changed log of one robot."""

    robot: str
    change: str
    seed: int
    excess: float  # largest change of a number beyond lost information [standard deviations]; NaN if refused
    number: str  # the number that changed most
    width: float  # median ratio of the standard deviations, changed over original [1]
    held: int  # true numbers within their 95 % interval
    known: int  # true numbers
    flags: tuple[str, ...]  # flags that the original does not have
    refused: str = ""


def turned(text: str, angles: tuple[float, float, float]) -> tuple[str, Array]:
    """URDF whose base is turned, and gravity (3,) [m/s2] in its root link, so that the robot hangs as before."""
    robot, turn = xml.fromstring(text), pin.rpy.rpyToMatrix(*angles)
    children = {joint.find("child").get("link") for joint in robot.findall("joint")}  # type: ignore[union-attr]
    root = next(link.get("name") for link in robot.findall("link") if link.get("name") not in children)
    for joint in robot.findall("joint"):
        if joint.find("parent").get("link") == root:  # type: ignore[union-attr]
            origin = joint.find("origin")
            if origin is None:
                origin = xml.SubElement(joint, "origin")
            place, rpy = (np.array(origin.get(key, "0 0 0").split(), float) for key in ("xyz", "rpy"))
            origin.set("xyz", " ".join(map(repr, (turn @ place).tolist())))
            angle = pin.rpy.matrixToRpy(turn @ pin.rpy.rpyToMatrix(*rpy))
            origin.set("rpy", " ".join(map(repr, angle.tolist())))
    return xml.tostring(robot, encoding="unicode"), turn @ np.array([0, 0, -9.81])


def identified(subject: Subject, changed: Changed, folder: Path) -> Numbers:
    """Write the changed logs, read them as a user would, and identify."""
    path, gravity = subject.document, None
    if changed.turned:
        text, gravity = turned(path.read_text(encoding="utf-8"), changed.turned)
        path = folder / f"turned_{path.name}"
        path.write_text(text, encoding="utf-8")
    robot: Robot = signid.load_robot(path, joints=subject.joints, actuators=subject.actuators, gravity=gravity)
    where = None
    if changed.map:
        where = folder / "map.toml"
        where.write_text(changed.map, encoding="utf-8")
    recordings = []
    for k, columns in enumerate(changed.logs):
        table, file = pl.DataFrame(dict(columns)), folder / f"log_{k}.{changed.file}"
        table.write_parquet(file) if changed.file == "parquet" else table.fill_nan(None).write_csv(file)
        recordings.append(signid.read_recording(file, robot, columns=where))
    return subject.identify(robot, recordings)


def compare(subject: Subject, change: str, seed: int, before: Numbers, after: Numbers) -> Row:
    """Changes of the numbers, and how many intervals hold the truth."""
    both = [name for name in before.value if name in after.value and before.std[name] > 0]
    excess, ratio = {}, []
    for name in both:
        lost = np.sqrt(max(after.std[name] ** 2 - before.std[name] ** 2, 0.0))
        moved = abs(after.value[name] - before.value[name])
        excess[name] = max(moved - TWO_SIDED * lost, 0.0) / before.std[name]
        ratio.append(after.std[name] / before.std[name])
    worst = max(excess, key=lambda name: excess[name], default="")
    known = [name for name in after.value if name in subject.truth]
    held = sum(abs(after.value[name] - subject.truth[name]) <= TWO_SIDED * after.std[name] for name in known)
    flags = tuple(flag for flag in after.flags if flag not in before.flags)
    width = float(np.median(ratio)) if ratio else float("nan")
    return Row(subject.name, change, seed, excess.get(worst, float("nan")), worst, width, held, len(known), flags)


def rows(subject: Subject, changes: list[Change], seed: int, folder: Path) -> Iterator[Row]:
    """The original and each change of one robot's log."""
    original = identified(subject, Changed((dict(subject.columns),)), folder)
    yield compare(subject, "none", seed, original, original)
    for k, change in enumerate(changes):
        if subject.drives and not change.drives:
            continue
        try:
            changed = change.make(subject.columns, np.random.default_rng([seed, k]))
            yield compare(subject, change.name, seed, original, identified(subject, changed, folder))
        except SignidError as error:
            nan = float("nan")
            yield Row(subject.name, change.name, seed, nan, "", nan, 0, 0, (), str(error))


def main() -> None:
    """Run, print one table and the targets."""
    parser = command_line("logs", __doc__)
    parser.add_argument("--only", nargs="+", choices=NAMES, help="run only these robots")
    parser.add_argument("--changes", metavar="WORD", default="", help="only changes whose name has this word")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="logs of each simulated robot")
    options = parser.parse_args()
    names = tuple(options.only or (name for name in NAMES if name not in REAL or "SIGNID_DATA" in os.environ))
    changes = [change for change in CHANGES if options.changes in change.name]
    console, found = Console(), list[Row]()
    with tempfile.TemporaryDirectory() as place:
        for seed in range(options.seeds):
            for name, make in subjects(Path(place), names, seed).items():
                if name in REAL and seed:
                    continue
                with console.status(f"{name}, seed {seed}"):
                    found += rows(make(), changes, seed, Path(place))
    table = frame("largest change of a number, in standard deviations", ("change", *names))
    for change in ("none", *(change.name for change in changes)):
        table.add_row(change, *(_cell([r for r in found if (r.robot, r.change) == (name, change)]) for name in names))
    console.print(table)
    for row in found:
        if row.refused or row.excess > MOST:
            why = row.refused or f"{row.number}; flags: {'; '.join(row.flags) or 'none'}"
            console.print(f"{row.robot}, {row.change}: {why}", highlight=False, soft_wrap=True)
    silent = [row for row in found if row.excess > MOST and not row.flags]
    known = sum(row.known for row in found)
    share = 100 * sum(row.held for row in found) / max(known, 1)
    changed = (f"changes above {MOST:g} without a flag: {len(silent)} of {len(found)}", not silent)
    covered = (f"coverage {share:.1f} % of {known} (93 to 97 %)", not known or COVERAGE[0] <= share <= COVERAGE[1])
    met = print_targets(console, [changed, covered])
    write_json(options.json, {"rows": found})
    raise SystemExit(0 if met else 1)


def _cell(some: list[Row]) -> str:
    if not some:
        return ""
    if any(row.refused for row in some):
        return "refused"
    worst = max(row.excess for row in some)
    return f"{worst:.2f}" + ("*" if any(row.flags for row in some) else "")


if __name__ == "__main__":
    main()
