"""Strangers' robots, everything wrong at once: `python -m benchmarks.concealed --stranger [--sample N] [--seed S]`.

The inertials of the description are 30 % off and it states no drives; the robot in MuJoCo has rotors, viscous and
creeping dry friction, and mostly one thing more, of 5 to 30 % of a joint's torque. Of 24 sessions each kind of thing
has one, four are healthy; six arms and random ones take turns. A folder of `--sessions DIR` has robot.urdf,
recording_1.parquet ..., truth.json (never read by the diagnosis), diagnosis.json, stderr.txt and run.json; recordings
that exist are used again: `--make-only` records, `--judge-only` judges what was diagnosed, neither of them does all.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from signid.robot import DHLink, urdf_from_dh

from ..plants.bodies import Body
from ..summary import command_line, frame, measured, origin, write_json
from .evaluate import is_right, is_twin, listed, truths
from .faults import plant
from .scene import ROBOTS, Place, Scene, described, draw
from .session import ATTEMPTS, NOISE, facts, follow, stated_drives, write
from .summary import Target, targets_table

ARMS = ("ur3", "ur10", "panda", "kinova", "xarm7", "z1")
RANDOM, HEALTHY = "random", "healthy"
KINDS = (
    *("spring", "counterbalance", "cable_torque", "torque_gain", "joint_elasticity", "backlash", "position_friction"),
    *("torque_ripple", "encoder_offset", "time_delay", "base_tilt", "joint_coupling", "load_friction", "torque_sign"),
    *("torque_saturation", "fluid_drag"),
)
ORDINARY = (  # what every description lacks; a wrong body counts where the thing is among its alternatives
    *("viscous_friction", "coulomb_friction", "asymmetric_friction", "stribeck_friction", "armature", "torque_offset"),
    "link_inertia",
)
TURNS, MOTIONS = 3, 3  # sessions of each arm and of two random ones per block of 24; recordings of 16 s, one held out
SIZES = (0.05, 0.30)  # rms torque of the thing over that of its joint [1]
DRIVE_FACTORS = (0.5, 4.0)  # of viscous friction, dry friction (2.5 to 20 % of the torque each) and rotors [1]
MASS_ERROR, LENGTH_ERROR = 0.30, 0.10  # standard deviations of the logarithms of each body's mass and lengths [1]
SURE = 0.9  # probability above which a wrong cause counts as sure [1]
LIMIT = 240  # processor time of a diagnosis [s]
LIMITED = f"""import resource, runpy
resource.setrlimit(resource.RLIMIT_CPU, ({LIMIT}, {LIMIT + 5}))
runpy.run_module("signid", run_name="__main__", alter_sys=True)"""
ENDINGS = {2: "refused", -signal.SIGXCPU: "no answer"}  # exit codes without a diagnosis


class Case(NamedTuple):
    """One robot and what it has beyond the ordinary."""

    seed: int
    number: int
    kind: str  # an effect or "healthy"
    robot: str

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.seed}_{self.number:03d}_{self.kind}_{self.robot}"


def cases(number: int, seed: int, only: Sequence[str] = ()) -> list[Case]:
    """The first cases of a seed, or the first with one of some kinds or robots."""
    rng, found, first = np.random.default_rng(seed), list[Case](), 1
    while len(found) < number:
        kinds = rng.permutation([*KINDS, *4 * [HEALTHY], *rng.choice(KINDS, 4, replace=False)]).tolist()
        robots = rng.permutation(TURNS * [*ARMS, RANDOM, RANDOM]).tolist()
        block = [Case(seed, first + k, *both) for k, both in enumerate(zip(kinds, robots, strict=True))]
        found += [case for case in block if not only or {case.kind, case.robot} & set(only)]
        first += len(block)
    return found[:number]


def random_arm(rng: np.random.Generator) -> tuple[Body, Place]:
    """Arm of four to seven joints with slender links of decreasing mass, and the place of its motions."""
    n, mass, links = int(rng.integers(4, 8)), float(rng.uniform(4, 12)), []
    for k in range(n):
        alpha, length = float(rng.choice([-np.pi / 2, np.pi / 2, 0.0][: 2 + (k > 0)])), float(rng.uniform(0.1, 0.35))
        centre = (-length / 2, *rng.uniform(-0.03, 0.03, 2).tolist())
        inertia = mass * np.array([0.05**2, length**2 / 12 + 0.03**2, length**2 / 12 + 0.04**2])
        offset = float(rng.uniform(0, 0.15))
        links.append(DHLink(alpha=alpha, a=length, d=offset, mass=mass, centre=centre, inertia=inertia))
        mass *= float(rng.uniform(0.5, 0.9))
    place = Place(tuple(rng.uniform(-0.8, 0.8, n).tolist()), 0.8)
    return Body(urdf_from_dh("arm", links), tuple(f"joint_{k + 1}" for k in range(n))), place


def misdescribed(body: Body, rng: np.random.Generator) -> str:
    """URDF whose bodies have other densities and sizes, so that each remains one that can exist."""
    root = ElementTree.fromstring(body.urdf)
    for link in root.findall("link"):
        denser, longer = np.exp((MASS_ERROR, LENGTH_ERROR) * np.clip(rng.standard_normal(2), -2, 2))
        factors = {"mass": denser, "inertia": denser * longer**2, "origin": longer}
        for part in link.findall("inertial/*"):
            for key in set(part.attrib) - {"rpy"}:
                part.set(key, " ".join(f"{float(x) * factors[part.tag]:.17g}" for x in part.attrib[key].split()))
    return ElementTree.tostring(root, encoding="unicode")


def make(case: Case, folder: Path) -> str:
    """Record a session; return why the robot follows its motions with none of the drawn things, or an empty string."""
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([case.seed, case.number, attempt])
        true, place = random_arm(rng) if case.robot == RANDOM else (described(case.robot), ROBOTS[case.robot])
        factors = rng.uniform(*DRIVE_FACTORS, (3, len(true.joints)))
        scene = Scene(true, tuple(draw(place, rng) for _ in range(MOTIONS)), factors)
        size, noise = float(np.exp(rng.uniform(*np.log(SIZES)))), float(rng.uniform(*NOISE))
        try:
            planted = [plant(case.kind, str(rng.choice(true.joints)), size, scene, rng)] if case.kind in KINDS else []
            faults = [fault for fault, _ in planted]
            tracks = follow(scene, stated_drives(scene, faults), faults, soft=True)
        except (ValueError, ArithmeticError) as error:
            reason = f"{case.name}: {error}"
            continue
        write(folder, misdescribed(true, rng), scene, tracks, noise, rng)
        truth = {**case._asdict(), "faults": facts(planted), "joints": true.joints, "scale": scene.scale.tolist()}
        (folder / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
        return ""
    return reason


def process(case: Case, sessions: Path, diagnosed: bool) -> str:
    """Record a session unless it exists, and diagnose it with a limited processor time; return the error or ""."""
    folder = sessions / case.name
    if not (folder / "truth.json").is_file() and (reason := make(case, folder)):
        return reason
    if diagnosed:
        recordings = sorted(str(path) for path in folder.glob("recording_*.parquet"))
        command = [sys.executable, "-c", LIMITED, "diagnose", str(folder / "robot.urdf"), *recordings, "--json"]
        with (folder / "diagnosis.json").open("wb") as out, (folder / "stderr.txt").open("wb") as errors:
            code, _, seconds = measured(command, stdout=out, stderr=errors)
        run = {"code": code, "cpu": seconds}
        (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    return ""


@dataclass(frozen=True)
class Judgement:
    """Outcome of a session."""

    name: str
    kind: str
    outcome: str  # right, listed, wrong, missed; healthy: silent, alarm; refused, no answer, failed
    first: str  # effect and joint that are named first beyond the ordinary
    probability: float
    sure: bool  # a wrong cause has P > .9, and so have none of its alternatives the truth
    cpu: float  # processor time [s]


def judge(folder: Path) -> Judgement:
    """Judge the diagnosis of a session by its truth.json."""
    truth, run = (json.loads((folder / f"{name}.json").read_text(encoding="utf-8")) for name in ("truth", "run"))
    if run["code"] not in (0, 3):
        return Judgement(folder.name, truth["kind"], ENDINGS.get(run["code"], "failed"), "", 0.0, False, run["cpu"])
    document = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    hidden, verdict = truths(truth), document["verdict"]

    def right(x: Mapping[str, Any]) -> bool:
        return any(is_right(x, one) or is_twin(x, one, truth["joints"]) for one in hidden)

    def states(x: Mapping[str, Any]) -> bool:
        return any(is_right(name, one) for name in listed([x]) for one in hidden)

    causes = [x for x in document["findings"] if x["role"] == "cause"] if verdict == "named" else []
    beyond = [x for x in causes if x["effect"] not in ORDINARY or (x["effect"] == "link_inertia" and states(x))]
    if not hidden:
        outcome = "alarm" if beyond or verdict == "unknown" else "silent"
    elif not beyond:
        outcome = "missed"
    else:
        outcome = "right" if right(beyond[0]) else "listed" if any(map(states, beyond)) else "wrong"
    sure = any(x["probability"] > SURE and not right(x) and not states(x) for x in beyond)
    first = beyond[0] if beyond else {"effect": verdict, "joint": None, "probability": 0.0}
    words = f"{first['effect']} {first['joint'] or ''}"
    return Judgement(folder.name, truth["kind"], outcome, words, first["probability"], sure, run["cpu"])


def targets(judged: Sequence[Judgement]) -> Iterator[Target]:
    """Yield each target with its result."""
    for words, counted, bound in (
        ("the thing beyond the ordinary is first", [x.outcome == "right" for x in judged if x.kind != HEALTHY], 0.8),
        ("healthy: nothing beyond the ordinary", [x.outcome == "silent" for x in judged if x.kind == HEALTHY], 1.0),
        (f"wrong and sure (P > {SURE:g})", [x.sure for x in judged], 0.0),
        ("refused or failed", [x.outcome in ("refused", "failed") for x in judged], 0.0),
    ):
        yield Target(words, sum(counted) / max(len(counted), 1), bound, len(counted), most=not bound)


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = command_line("concealed --stranger", __doc__)
    parser.add_argument("--stranger", action="store_true", help=argparse.SUPPRESS)
    choices = (*KINDS, HEALTHY, *ARMS, RANDOM)
    parser.add_argument("--only", nargs="+", choices=choices, default=(), metavar="NAME", help="kinds or robots to run")
    parser.add_argument("--sample", type=int, default=96, metavar="N", help="number of sessions (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the sessions (%(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="number of parallel processes (%(default)s)")
    parser.add_argument("--sessions", type=Path, metavar="DIR", help="keep sessions and diagnoses in DIR")
    parser.add_argument("--make-only", action="store_true", help="record sessions without diagnosis")
    parser.add_argument("--judge-only", action="store_true", help="judge existing diagnoses only")
    return parser.parse_args()


def main() -> None:
    """Record, diagnose, judge and print; exit with 1 when a target is missed or a session failed."""
    options, console = parse(), Console(width=150)
    with tempfile.TemporaryDirectory() as temporary, ProcessPoolExecutor(options.jobs) as pool:
        sessions, wanted = options.sessions or Path(temporary), cases(options.sample, options.seed, options.only)
        jobs = [] if options.judge_only else [pool.submit(process, x, sessions, not options.make_only) for x in wanted]
        failures = [reason for job in jobs if (reason := job.result())]
        judged = [judge(x) for case in wanted if (x := sessions / case.name).joinpath("run.json").is_file()]
    for reason in failures:
        console.print(reason, style="red", highlight=False, soft_wrap=True)
    if options.make_only:
        sys.exit(bool(failures))
    table = frame("sessions", ("session", "", "first beyond the ordinary", "P", "wrong, sure", "CPU, s"), left=3)
    for one in judged:
        table.add_row(one.name, one.outcome, one.first, f"{one.probability:.3f}", "yes" * one.sure, f"{one.cpu:.0f}")
    console.print(table, targets_table(found := list(targets(judged))))
    counted = ", ".join(f"{n} {outcome}" for outcome, n in Counter(one.outcome for one in judged).most_common())
    console.print(f"{len(judged)} of {len(wanted)} sessions judged: {counted}", highlight=False)
    source = origin("concealed", sys.argv[1:], ("--json", "--sessions", "--jobs"))
    write_json(options.json, {"origin": source, "targets": found, "sessions": judged})
    sys.exit(bool(failures) or any(target.met is False for target in found))
