"""Command: `python -m benchmarks.servo [truth coverage real models] [--seeds 1 2] [--json F]`."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from signid.recording import read_recording
from signid.robot import load_robot
from signid.servo.compare import compare_models
from signid.servo.diagnose import diagnose_servos
from signid.servo.identify import FrictionModel, ServoIdentification, identify_servos
from signid.types import Robot

from ..summary import command_line, frame, print_targets, write_json
from .coverage import Interval, cases, intervals
from .identified import KNOWN_LOAD, NUMBERS, Row, Trial, run
from .robots import Bench, benches, data_folder

WORST = {"kp": 0.03, "damping": 0.03, "coulomb_friction": 0.03, "armature": 0.05, "delay": 3e-4}
MEDIAN = {"kp": 0.01, "damping": 0.01, "coulomb_friction": 0.01, "armature": 0.02, "delay": 3e-4}
LAWS = ("effort", "duty")
SIDES = 1.96  # standard deviations of a 95 % interval
COVERED: dict[str, Callable[[Interval], object]] = {
    "": lambda row: row.number,
    "bits": lambda row: row.case.bits,
    "command": lambda row: row.case.kind,
    "rate": lambda row: row.case.rate,
    "plant": lambda row: row.case.plant,
    "saturated": lambda row: row.case.limited,
}  # what intervals are grouped by
WIDTH = 150  # of the tables
XL330 = ("lift_and_drop", "sin_sin", "sin_time_square", "up_and_down")
HELD = ("sin_time_square", "up_and_down")  # of these, at both gains
MAUICV = (("chirp", "prbs_small", "square_large", "square_small", "step_large", "triangle"), ("prbs_large", "ramp"))
SO101 = (
    *("center_workspace", "diagonal_sweep", "oscillation_low_freq"),
    *("reaching_points", "symmetric_motion", "triangle_wave"),
)
SO101_HELD = ("wave_motion", "staircase_motion", "velocity_ramp")
SO101_NAMES = {"shoulder_pan": "Rotation", "shoulder_lift": "Pitch", "elbow_flex": "Elbow"}
SO101_NAMES |= {"wrist_flex": "Wrist_Pitch", "wrist_roll": "Wrist_Roll", "gripper": "Jaw"}
SO101_JOINTS = {"joints": SO101_NAMES}  # signs and zeros are those of the description, as far as the load shows them


def main() -> int:
    """Run the parts that were asked for; return 1 if a target is missed."""
    parser = command_line("servo", __doc__)
    parser.add_argument("parts", nargs="*", default=["truth", "coverage", "real", "models"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--robots", nargs="+", default=["pendulum", "go2_leg", "so101"])
    given, console, kept, met = parser.parse_args(), Console(width=WIDTH), dict[str, object](), True
    with tempfile.TemporaryDirectory() as place:
        found = benches(Path(place), tuple(given.robots))
        if "truth" in given.parts:
            free = _trials(found, given.seeds, Path(place), None)
            clipped = [t for law in LAWS for t in _trials(found, given.seeds[:2], Path(place), law)]
            met &= show_truth(console, free, clipped)
            kept["truth"] = [asdict(row) for trial in (*free, *clipped) for row in trial.rows]
        if "coverage" in given.parts:
            held, kept["coverage"] = show_coverage(console, given.seeds, Path(place))
            met &= held
        if "real" in given.parts:
            kept["real"] = show_real(console, Path(place))
        if "models" in given.parts:
            kept["models"] = show_models(console, Path(place))
    write_json(given.json, kept)
    return 0 if met else 1


def _trials(found: Sequence[Bench], seeds: Sequence[int], folder: Path, law: str | None) -> list[Trial]:
    return [run(bench, seed, folder, law) for bench in found for seed in seeds]


def show_truth(console: Console, free: Sequence[Trial], clipped: Sequence[Trial]) -> bool:
    """Errors and coverage of unsaturated and saturated drives."""
    rows = [row for trial in free for row in trial.rows if row.load > KNOWN_LOAD]
    hard = [row for trial in clipped for row in trial.rows if row.load > KNOWN_LOAD]
    table = frame(
        "MuJoCo, truth known: relative error (delay: s)",
        ["number", "median", "worst", "coverage", "of", "clipped: median", "worst"],
    )
    for name in NUMBERS:
        some, more = ([row for row in each if row.number == name] for each in (rows, hard))
        if some or more:
            table.add_row(name, *_errors(some), _coverage(some), str(len(some)), *_errors(more))
    console.print(table)
    everything = [row.covered for row in rows if row.covered is not None]
    named = [true == law for trial in clipped for true, law in trial.laws]
    targets = [
        (f"{name}: median {_median(rows, name):.4f} (target {MEDIAN[name]:g}), worst {_worst(rows, name):.4f} "
         f"(target {WORST[name]:g})", _median(rows, name) <= MEDIAN[name] and _worst(rows, name) <= WORST[name])
        for name in MEDIAN
    ]  # fmt: skip
    share = float(np.mean(everything)) if everything else 0.0
    targets.append((f"coverage {share:.2f} of {len(everything)} intervals (target .93 to .97)", 0.93 <= share <= 0.97))
    targets.append(
        (f"law of saturated drives: {sum(named)} of {len(named)} (target 9 of 10)", sum(named) >= 0.9 * len(named))
    )
    seconds = [trial.seconds for trial in free]
    console.print(f"processor seconds a robot: {min(seconds):.1f} to {max(seconds):.1f}", highlight=False)
    return print_targets(console, targets)


def show_coverage(console: Console, seeds: Sequence[int], folder: Path) -> tuple[bool, list[dict[str, object]]]:
    """Coverage of 95 % intervals on two plants: whether it is as it should be, and all intervals."""
    rows = [one for case in cases(seeds) for one in intervals(case, folder)[0]]
    table = frame("95 % intervals of drives in two plants", ["", "held", "of", "rms of error / std"])
    table.add_row("all", *_held(rows))
    for title, kind in COVERED.items():
        for value in sorted({kind(row) for row in rows}):
            table.add_row(f"{title} {value}".strip(), *_held([row for row in rows if kind(row) == value]))
    console.print(table)
    share = float(np.mean([abs(row.score) <= SIDES for row in rows]))
    said = f"coverage {share:.3f} of {len(rows)} intervals (target .93 to .97)"
    kept: list[dict[str, object]] = [asdict(row) for row in rows]
    return print_targets(console, [(said, 0.93 <= share <= 0.97)]), kept


def _held(rows: Sequence[Interval]) -> tuple[str, str, str]:
    score = np.array([row.score for row in rows])
    return f"{np.mean(np.abs(score) <= SIDES):.3f}", str(len(score)), f"{np.sqrt(np.mean(score**2)):.2f}"


def show_real(console: Console, folder: Path) -> list[dict[str, object]]:
    """Held-out errors of real servos."""
    table = frame(
        "real servos: rms [rad] of held-out recordings from commands alone",
        ["set", "joints", "whole", "1 s", "q = q_des", "target", "s", "still missing"],
    )
    kept = []
    for row in sets(folder):
        sizes = (f"{x:.4f}" for x in (row.whole, row.second, row.ideal))
        table.add_row(row.name, str(row.joints), *sizes, row.target, f"{row.seconds:.1f}", row.missing)
        kept.append(asdict(row))
    console.print(table)
    return kept


def show_models(console: Console, folder: Path) -> list[dict[str, object]]:
    """Friction models of a real servo beside each other."""
    table = frame(
        "XL330, friction models: errors in mrad of held-out recordings from commands alone",
        ["held out", "model", "mean |error|", "rms", "log Bayes factor", "probability", "s"],
    )
    kept = list[dict[str, object]]()
    for held, one in friction_models(folder):
        sizes = (1e3 * float(one.mean_absolute[0]), 1e3 * float(one.rms[0]), one.log_bayes_factor)
        share = "-" if np.isnan(one.probability) else f"{one.probability:.2f}"
        table.add_row(held, one.name, *(f"{x:.1f}" for x in sizes), share, f"{one.seconds:.1f}")
        kept.append({"held_out": held, "model": one.name, "errors": sizes, "seconds": one.seconds})
    console.print(table)
    return kept


def _errors(rows: Sequence[Row]) -> tuple[str, str]:
    sizes = [row.error for row in rows if np.isfinite(row.error)]
    return (f"{np.median(sizes):.4f}", f"{max(sizes):.4f}") if sizes else ("-", "-")


def _coverage(rows: Sequence[Row]) -> str:
    held = [row.covered for row in rows if row.covered is not None]
    return f"{np.mean(held):.2f}" if held else "-"


def _median(rows: Sequence[Row], name: str) -> float:
    return float(np.nanmedian([row.error for row in rows if row.number == name] or [np.inf]))


def _worst(rows: Sequence[Row], name: str) -> float:
    return float(np.nanmax([row.error for row in rows if row.number == name] or [np.inf]))


@dataclass(frozen=True)
class RealRow:
    """One real set."""

    name: str
    joints: int
    whole: float  # [rad] rms of held-out recordings, all joints
    second: float  # [rad] restarted every second
    ideal: float  # [rad] q = q_des, or stated numbers
    seconds: float  # processor time
    target: str
    missing: str  # laws that a diagnosis still names


def sets(folder: Path) -> Iterator[RealRow]:
    """Each public set that is at hand."""
    data = data_folder()
    if data is None:
        return
    for held in HELD:
        robot = xl330(data, folder)
        files = [data / "bam_xl330" / f"kp{kp}_{name}.csv.gz" for kp in (100, 400) for name in XL330]
        unseen = [file for file in files if held in file.name]
        yield _row(f"XL330, {held} held out", robot, [f for f in files if f not in unseen], unseen, "")
    go2 = data / "go2_dls"
    yield _row("Go2, last 30 %", load_robot(go2 / "go2.urdf"), [go2 / "held_base_first.csv.gz"], [], ".0065")
    place = data / "mauicv_servo"
    train, unseen = ([place / f"a_{name}.csv.gz" for name in names] for names in MAUICV)
    yield _row("mauicv, other motions", load_robot(place / "arm.urdf"), train, unseen, ".060")
    place = data / "so101_servo"
    train, unseen = ([place / f"{name}.csv.gz" for name in names] for names in (SO101, SO101_HELD))
    yield _row(
        "SO-101, whole arm, other motions", load_robot(place / "so101.urdf"), train, unseen, ".010", SO101_JOINTS
    )


def friction_models(folder: Path) -> Iterator[tuple[str, FrictionModel]]:
    """Friction models of the XL330 beside each other, by the held-out motion."""
    data = data_folder()
    if data is None:
        return
    robot, place = xl330(data, folder), data / "bam_xl330"
    for held in HELD:
        files = {name: [place / f"kp{kp}_{name}.csv.gz" for kp in (100, 400)] for name in XL330}
        unseen = [read_recording(file, robot) for file in files.pop(held)]
        learned = [read_recording(file, robot) for some in files.values() for file in some]
        found = compare_models(identify_servos(robot, learned, held_out=unseen), learned, held_out=unseen)
        yield from ((held, one) for one in found.friction_models)


def xl330(data: Path, folder: Path) -> Robot:
    """The XL330 with the firmware gain of each recording."""
    lines = ["[joint.servo.servo]", "kp_register = 400"]
    for kp in (100, 400):
        for name in XL330:
            lines += [f'[recording."kp{kp}_{name}.csv.gz".servo]', f"kp_register = {kp}"]
    file = folder / "actuators.toml"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return load_robot(data / "bam_xl330" / "pendulum.urdf", actuators=file)


def _row(
    name: str,
    robot: Robot,
    train: Sequence[Path],
    unseen: Sequence[Path],
    target: str,
    columns: Mapping[str, Any] | None = None,
) -> RealRow:
    learned, held_out = ([read_recording(f, robot, columns=columns) for f in files] for files in (train, unseen))
    start = time.process_time()
    found = identify_servos(robot, learned, held_out=held_out)
    seconds = time.process_time() - start
    missing = diagnose_servos(found.model, learned, held_out=held_out)
    names = ", ".join(f"{x.effect}@{x.joint} {x.probability:.2f}" for x in missing.causes[:3])
    return RealRow(name, len(found.joints), *_rms_of(found), seconds, target, names or missing.verdict)


def _rms_of(found: ServoIdentification) -> tuple[float, float, float]:
    rolled = found.rollout
    sizes = (rolled.whole_rms, rolled.one_second_rms, rolled.nominal_whole_rms)
    whole, second, ideal = (float(np.sqrt(np.nanmean(x**2))) for x in sizes)
    return whole, second, ideal


if __name__ == "__main__":
    raise SystemExit(main())
