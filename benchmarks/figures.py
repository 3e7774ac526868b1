"""Figures of benchmarks/README.md measured again: `python -m benchmarks.figures [--only NAME ...] [--minutes N]`.

The commands of the headings run one after another, as far as all of them fit into the time; what they print goes to
`--json FILE` with the commit. At the end stands how old the figures of both READMEs are. `--memory` measures the
commands of signid instead, a process each: peak memory (of its largest process) and processor time. Needs SIGNID_DATA.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from .summary import command_line, data, frame, measured, one_thread, write_json

ROOT = Path(__file__).parents[1]


class Figure(NamedTuple):
    """How the figures of a heading are measured."""

    heading: str  # of benchmarks/README.md
    command: str  # words after `python`; several commands with ;
    prints: str
    minutes: float


FIGURES = (
    Figure("Coverage of intervals", "-m benchmarks.coverage --held --low-noise", "% of intervals that hold", 25),
    Figure("Torque without signs", "-m benchmarks.signs --only real", "right segments and samples, distance", 1),
    Figure(
        "Hidden physics in MuJoCo",
        "-m benchmarks.concealed --only exact hard pairs --sample 90 --base 9000; "
        "-m benchmarks.concealed --only none --sample 24 --base 9000",
        "first causes right, by size; false alarms",
        30,
    ),
    Figure("A stranger's robot", "-m benchmarks.concealed --stranger --sample 24", "first beyond the ordinary", 10),
    Figure("Changes in identified models", "-m benchmarks.concealed_real", "changes named, intervals, joints", 60),
    Figure(
        "Real robots", "; ".join(f"robots/{x}/identify.py" for x in "panda ur10e tx40 emps".split()), "held-out R2", 1
    ),
    Figure("EMPS, public test file", "-m benchmarks.public", "rms errors of position", 4),
    Figure("Changes of a log", "-m benchmarks.logs --only 3r ur5", "largest change in standard deviations", 1),
    Figure("Named laws and black boxes", "-m benchmarks.blackbox", "rms over that of least squares", 40),
    Figure("Drives from commands", "-m benchmarks.servo", "errors and coverage of drives, rms of real servos", 30),
    Figure("Faults of position drives", "-m benchmarks.servo_faults", "faults named first, healthy silent", 15),
    Figure("Exported loops", "-m benchmarks.export_loop", "rms from signid's roll-out", 2),
    Figure("A robot at work", "-m benchmarks.watch --hours 0.1", "pushes, changes and false alarms", 10),
    Figure("Generated C", "-m benchmarks.export", "microseconds a state", 1),
    Figure("Speed of base parameters", "-m benchmarks.regressor", "times the floor", 1),
    Figure("Memory of commands", "-m benchmarks.regressor --hours 0.1 1; -m benchmarks.figures --memory", "MiB, s", 8),
)
UR10E, PANDA = "{data}/ur10e_mamedov/", "{data}/panda_gaz2019/"
FOURIER = f"{UR10E}identification_data__20_02_"
SETS = {  # description, recording, another one
    "3r": ("3r", "{robots}/3r/recording.parquet", "{robots}/3r/held_out.parquet"),
    "ur10e": (
        f"{UR10E}ur10e.urdf --actuators {{robots}}/ur10e/actuators.toml",
        f"{FOURIER}19_14harm50sec.csv.gz",
        f"{FOURIER}12_50sec_12harm.csv.gz",
    ),
    "panda": (f"{PANDA}panda.urdf", *(f"{PANDA}exciting_traj_1.csv.gz",) * 2),
    "xl330": (
        "{data}/bam_xl330/pendulum.urdf --actuators {robots}/bam_xl330/actuators.toml",
        " ".join(f"{{data}}/bam_xl330/kp400_{x}.csv.gz" for x in ("sin_sin", "lift_and_drop", "up_and_down")),
        "{data}/bam_xl330/kp400_sin_time_square.csv.gz",
    ),
    "go2": ("{data}/go2_dls/go2.urdf", *("{data}/go2_dls/held_base_first.csv.gz",) * 2),
}
ARMS, SERVOS = ("3r", "ur10e", "panda"), ("xl330", "go2")
COMMANDS: dict[str, tuple[str, ...]] = {
    "inspect {robot}": ARMS,
    "check {robot} {log}": ARMS,
    "identify {robot} {log} -o {name}": (*ARMS, *SERVOS),
    "diagnose {robot} {log} -o {name}_found": ARMS,
    "diagnose {name}/model.json {log} -o {name}_found": SERVOS,
    "simulate {name}/model.json --duration 20 --noise 0.02 -o {name}.csv": ARMS,
    "validate {name}/model.json {other}": (*ARMS, *SERVOS),
    "excite {robot} --duration 10 -o {name}_motion.csv": ARMS,
    "export {name}/model.json --urdf {name}.urdf --mjcf {name}.xml --c c_{name}.c": ARMS,
    "replay {name}/model.json {log} --html {name}.html": ARMS,
    "watch {name}/model.json {other}": ARMS,
    "convert {log} --robot {robot} -o {name}_log.csv": ARMS,
    f"payload {{name}}/model.json --without {{log}} --with {FOURIER}19_14harm50secLoad.csv.gz": ("ur10e",),
    "fleet manifest.csv -o fleet": ("3r",),
    "data": ("3r",),
}


def memory(console: Console) -> dict[str, dict[str, tuple[int, float, float]]]:
    """Measure every command of signid in a folder of its own: exit code, peak [MiB], processor time [s]."""
    found: dict[str, dict[str, tuple[int, float, float]]] = {}
    with tempfile.TemporaryDirectory() as place:
        rows = "".join(f"3r,{ROOT}/robots/3r/{name}.parquet,identify\n" for name in ("recording", "held_out"))
        (Path(place) / "manifest.csv").write_text(f"robot,recording,task\n{rows}", encoding="utf-8")
        for command, name in ((line, name) for line, names in COMMANDS.items() for name in names):
            robot, log, other = SETS[name]
            words = command.replace("{log}", log).replace("{other}", other).replace("{robot}", robot)
            words = words.format(name=name, data=data(), robots=ROOT / "robots")
            used = measured([sys.executable, "-m", "signid", *words.split()], cwd=place)
            found.setdefault(verb := words.split()[0], {})[name] = used
            console.print(f"{verb} {name}: exit code {used[0]}, {used[1]:.0f} MiB, {used[2]:.1f} s", highlight=False)
    table = frame("peak memory [MiB], processor time [s]", ("", *SETS))
    for verb, row in found.items():
        table.add_row(verb, *(f"{row[x][1]:.0f}, {row[x][2]:.1f}" if x in row else "" for x in SETS))
    console.print(table)
    return found


def ages() -> Iterator[str]:
    """For each heading of the READMEs, the commits of its figures and how many changes of signid/ came later."""
    for name in ("README.md", "benchmarks/README.md"):
        for section in re.split(r"^#+ ", (ROOT / name).read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
            commits = dict.fromkeys(re.findall(r"\b(?=[0-9a-f]*\d)(?=\d*[a-f])[0-9a-f]{7,8}\b", section))
            later = {x: git("rev-list", "--count", f"{x}..HEAD", "--", "signid") for x in commits}
            if older := ", ".join(f"{x} ({count or '?'})" for x, count in later.items() if count != "0"):
                yield f"{name}, {section.splitlines()[0]}: {older}"


def git(*words: str) -> str:
    """Standard output of git; empty if it refuses."""
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, encoding="utf-8").stdout.strip()


def main() -> int:
    """Run what fits into the time, or measure the commands, and say how old the figures are."""
    one_thread()
    parser = command_line("figures", __doc__)
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME", help="words of headings or commands")
    parser.add_argument("--minutes", type=float, default=10.0, help="time for all commands together (%(default)s)")
    parser.add_argument("--memory", action="store_true", help="measure memory and time of the commands of signid")
    given, console, kept = parser.parse_args(), Console(width=120, highlight=False), dict[str, object]()
    kept["commit"], left = git("rev-parse", "--short", "HEAD"), 0.0 if given.memory else given.minutes
    if given.memory:
        kept["memory"] = memory(console)
    for one in FIGURES:
        if one.minutes <= left and any(word.lower() in f"{one.heading} {one.command}".lower() for word in given.only):
            left -= one.minutes
            console.rule(f"{one.heading}: {one.prints}")
            for command in one.command.split("; "):
                words = [sys.executable, *command.split()]
                done = subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, encoding="utf-8")
                kept[command] = {"heading": one.heading, "exit code": done.returncode, "printed": done.stdout}
                console.print(done.stdout, markup=False, soft_wrap=True)
                write_json(given.json, kept)
    write_json(given.json, kept)
    console.print("Figures older than this commit, with later changes of signid/:", *ages(), sep="\n", soft_wrap=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
