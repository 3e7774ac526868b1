"""How far do models stray within half a second? `python -m benchmarks.rollout [--windows 48] [--json FILE]`.

A model starts from measured states all over a recording that it did not learn from and is simulated under the recorded
torque. Real recordings need SIGNID_DATA. Then: how steps and filters of torque matter, and windows one by one.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scipy.ndimage import convolve1d

import signid
from signid.model import Model, stated_inertials
from signid.recording.sampling import survey
from signid.regression.bandwidth import choose_band
from signid.regression.filters import lowpass
from signid.regression.prepare import prepare
from signid.regression.session import Options, Session
from signid.simulation.plant.plant import Plant
from signid.simulation.rollout import RollOut, roll_out
from signid.simulation.rollout.windows import WindowLayout, Windows, cut_windows
from signid.types import Recording

from .real.data import JUDGED, LINK_SIDE, ROBOTS, UNLOADED, data, recording, ur10e, ur10e_recording

HORIZONS = (0.2, 0.5)  # s
STEPS = (("rk4", 2.5e-4), ("rk4", 1e-3), ("semi-implicit", 1e-3), ("semi-implicit", 2e-3), ("semi-implicit", 5e-3))
LACKING, BETTER, NEAR, FASTER = 3.0, 2.0, 1.5, 4.0  # targets, as `judge` words them


@dataclass(frozen=True)
class Case:
    """Models of one robot, and what they are judged by."""

    name: str
    judge: Recording | Session
    models: dict[str, Model]


def three_r() -> Case:
    """The arm simulated by MuJoCo, whose truth is known."""
    robot = signid.load_robot("3r")
    learn, judge = (signid.read_recording(ROBOTS / "3r" / f"{key}.parquet", robot) for key in ("recording", "held_out"))
    found = signid.identify(robot, [learn], held_out=[judge])
    truth = tomllib.loads((ROBOTS / "3r" / "truth.toml").read_text(encoding="utf-8"))
    links = [truth["link"][name] for name in robot.links]
    inertials = np.array([[link["mass"], *link["first_moment"], *link["inertia"]] for link in links])
    laws = []
    for law in found.model.laws:
        (key,) = law.effect.linear()
        laws.append(replace(law, parameters={key: truth["joint"][robot.joints[law.joints[0]]][law.effect.name]}))
    true = Model(robot, inertials, tuple(laws))
    lacking = tuple(law for law in laws if (law.effect.name, law.joints) != ("coulomb_friction", (1,)))
    models = {"URDF": bare(found.model), "no Coulomb 2": replace(true, laws=lacking), "identified": found.model}
    return Case("3r, held_out", judge, {**models, "true": true})


def real() -> Iterator[Case]:
    """A UR10e and an EMPS judged by another recording, a Panda by the last 30 % of its own."""
    learn, judge = ur10e_recording(UNLOADED[1]), ur10e_recording(JUDGED)
    found = signid.identify(ur10e(), [learn], held_out=[judge])
    yield Case("UR10e, 50 s", judge, {"URDF": bare(found.model), "identified": found.model})
    robot, options = signid.load_robot(data() / "panda_gaz2019" / "panda.urdf"), Options(effects=LINK_SIDE)
    learn = recording("panda_gaz2019", "exciting_traj_1", robot)
    found = signid.identify(robot, [learn], options=options)
    session = prepare(robot, [learn], options=options)
    yield Case("Panda, last 30 %", session, {"URDF": bare(found.model), "identified": found.model})
    robot = signid.load_robot("emps")
    learn, judge = (recording("emps_janot", f"emps_{key}", robot) for key in ("train", "pulses"))
    found = signid.identify(robot, [learn], held_out=[judge])
    yield Case("EMPS, pulses", judge, {"URDF": bare(found.model), "identified": found.model})


def bare(model: Model) -> Model:
    """What the description alone states, without any drive."""
    return Model(model.robot, stated_inertials(model.robot))


def stepped(case: Case, windows: int) -> Iterator[tuple[str, float, float]]:
    """How the simulation is stepped: its name, seconds, and how far its rms errors are from the first one's."""
    model, first = case.models["identified"], None
    assert isinstance(case.judge, Recording)
    for integrator, step in STEPS:
        start = time.perf_counter()
        found = roll_out(model, case.judge, HORIZONS, windows=windows, step=step, integrator=integrator)
        first, spent = first or found, time.perf_counter() - start
        yield f"{integrator}, {1e3 * step:g} ms", spent, apart(found, first)
    rows = case.judge.read()
    band = choose_band([rows], rate := 1 / survey(case.judge, model.robot).period)
    for factor in (1.0, 3.0):
        taps = lowpass(rate, factor * band.cutoff)
        smooth = {"t": rows.t, "q": rows.q, "tau": convolve1d(rows.tau, taps, axis=0, mode="nearest")}
        start = time.perf_counter()
        found = roll_out(model, signid.read_recording(smooth, model.robot), HORIZONS, windows=windows)
        assert first is not None
        yield f"torque below {factor * band.cutoff:.3g} Hz", time.perf_counter() - start, apart(found, first)


def apart(found: RollOut, first: RollOut) -> float:
    """Largest relative difference of the rms errors at the longest horizon, over the joints."""
    return float(np.max(np.abs(found.rms(HORIZONS[-1]) / first.rms(HORIZONS[-1]) - 1)))


def copies(case: Case, windows: int) -> tuple[float, float]:
    """Seconds that the simulation takes of all windows together, and one by one."""
    assert isinstance(case.judge, Recording)
    model, sampling = case.models["identified"], survey(case.judge, case.models["identified"].robot)
    band = choose_band([case.judge.read()], 1 / sampling.period)
    cut = cut_windows(model, (case.judge, sampling), band, WindowLayout(HORIZONS[-1], windows, 1e-3))
    return simulated(model, cut, [slice(None)]), simulated(model, cut, [slice(k, k + 1) for k in range(windows)])


def simulated(model: Model, cut: Windows, groups: list[slice]) -> float:
    """Seconds for the steps of some windows at a time."""
    spent = 0.0
    for group in groups:
        plant = Plant(model, cut.step, len(cut.t[group]))
        plant.start(cut.q[group, 0], cut.v[group, 0])
        start = time.perf_counter()
        for k in range(cut.torque.shape[1]):
            plant.advance(cut.t[group] + k * cut.step, cut.torque[group, k])
        spent += time.perf_counter() - start
    return spent


def judge(found: dict[str, dict[str, RollOut]], speeds: tuple[float, float]) -> Iterator[tuple[str, bool]]:
    """Each target with whether it is met."""
    last, three = HORIZONS[-1], found["3r, held_out"]
    worse = float(three["no Coulomb 2"].rms(last)[1] / three["true"].rms(last)[1])
    yield f"3r without Coulomb friction on joint 2: {worse:.1f} times the true model's error there", worse >= LACKING
    near = float(np.max(three["identified"].rms(last) / three["true"].rms(last)))
    yield f"3r identified: at most {near:.2f} times the true model's error", near <= NEAR
    for name, models in found.items():
        gain = float(np.min(models["URDF"].median(last) / models["identified"].median(last)))
        yield f"{name}: the median falls at least {gain:.1f} times from the URDF's", gain >= BETTER
    ratio = speeds[1] / speeds[0]
    yield f"all windows together: {ratio:.1f} times as fast as one by one", ratio >= FASTER


def show(found: dict[str, dict[str, RollOut]]) -> Table:
    """Errors per joint and horizon."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title="error in mrad (EMPS: mm), each joint")
    for name in ("recording", "model", "rms, 0.2 s", "rms, 0.5 s", "median, 0.5 s"):
        table.add_column(name)
    for name, models in found.items():
        for model, got in models.items():
            told = (got.rms(0.2), got.rms(0.5), got.median(0.5))
            table.add_row(name, model, *(" ".join(map(written, errors)) for errors in told))
    return table


def written(error: float) -> str:
    """In mrad or mm."""
    return f"{1e3 * error:.3g}" if error < 1 else ">1000"


def main() -> None:
    """Roll out, print the tables, write the numbers; exit 1 when a target is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rollout", description=__doc__)
    parser.add_argument("--windows", type=int, default=48, help="of each recording, by default %(default)s")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    options, console = parser.parse_args(), Console(width=140)
    cases = [three_r(), *(real() if os.environ.get("SIGNID_DATA") else ())]
    found = {
        case.name: {
            key: roll_out(model, case.judge, HORIZONS, windows=options.windows) for key, model in case.models.items()
        }
        for case in cases
    }
    console.print(show(found))
    example = cases[min(1, len(cases) - 1)]
    rows, speeds = list(stepped(example, options.windows)), copies(example, options.windows)
    for name, spent, off in rows:
        console.print(f"{example.name}, {name:24} {spent:5.2f} s, rms off by {100 * off:.2f} %", highlight=False)
    console.print(f"{example.name}: {speeds[0]:.2f} s together, {speeds[1]:.2f} s one by one", highlight=False)
    verdicts = list(judge(found, speeds))
    for sentence, met in verdicts:
        console.print(sentence, style="" if met else "red", highlight=False)
    if options.json:
        machine = {"python": platform.python_version(), "pinocchio": pin.__version__}
        errors = {name: {key: got.document(got) for key, got in models.items()} for name, models in found.items()}
        told = {"machine": machine, "errors": errors, "steps": rows, "seconds": speeds, "targets": dict(verdicts)}
        options.json.write_text(json.dumps(told, indent=1), encoding="utf-8")
    raise SystemExit(0 if all(met for _, met in verdicts) else 1)


if __name__ == "__main__":
    main()
