"""Position error of short simulations: `python -m benchmarks.rollout [--windows 48] [--json FILE]`.

A model starts from measured states throughout a held-out recording and is simulated for up to half a second under the
recorded torque. Real recordings need SIGNID_DATA. The effect of time steps and torque filters is measured as well, and
the speed of all windows together compared with one by one.
"""

from __future__ import annotations

import os
import platform
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scipy.ndimage import convolve1d

import signid
from signid.model import Model, stated_inertials
from signid.recording.sampling import survey
from signid.regression.bandwidth import choose_band, lowpass
from signid.regression.session import Options, Session, prepare
from signid.simulation.plant.plant import Plant
from signid.simulation.rollout import RollOut, roll_out
from signid.simulation.rollout.windows import Windows, cut_windows
from signid.types import Recording

from .real.data import HELD_OUT, LINK_SIDE, ROBOTS, UNLOADED, recording, ur10e, ur10e_recording
from .summary import command_line, data, print_targets, write_json

HORIZONS = (0.2, 0.5)  # simulated time [s]
STEPS = (("rk4", 2.5e-4), ("rk4", 1e-3), ("semi-implicit", 1e-3), ("semi-implicit", 2e-3), ("semi-implicit", 5e-3))
LACKING, BETTER, NEAR, FASTER = 3.0, 2.0, 1.5, 4.0  # bounds of the targets in `check_targets` [1]


@dataclass(frozen=True)
class Case:
    """Models of one robot and the held-out data."""

    name: str
    held_out: Recording | Session
    models: dict[str, Model]


def three_r() -> Case:
    """The 3R arm simulated by MuJoCo, with known parameters."""
    robot = signid.load_robot("3r")
    train, held_out = (
        signid.read_recording(ROBOTS / "3r" / f"{key}.parquet", robot) for key in ("recording", "held_out")
    )
    found = signid.identify(robot, [train], held_out=[held_out])
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
    return Case("3r, held_out", held_out, {**models, "true": true})


def real() -> Iterator[Case]:
    """A UR10e and an EMPS with a second recording held out, a Panda with its last 30 % held out."""
    train, held_out = ur10e_recording(UNLOADED[1]), ur10e_recording(HELD_OUT)
    found = signid.identify(ur10e(), [train], held_out=[held_out])
    yield Case("UR10e, 50 s", held_out, {"URDF": bare(found.model), "identified": found.model})
    robot, options = signid.load_robot(data() / "panda_gaz2019" / "panda.urdf"), Options(effects=LINK_SIDE)
    train = recording("panda_gaz2019", "exciting_traj_1", robot)
    found = signid.identify(robot, [train], options=options)
    session = prepare(robot, [train], options=options)
    yield Case("Panda, last 30 %", session, {"URDF": bare(found.model), "identified": found.model})
    robot = signid.load_robot("emps")
    train, held_out = (recording("emps_janot", f"emps_{key}", robot) for key in ("train", "pulses"))
    found = signid.identify(robot, [train], held_out=[held_out])
    yield Case("EMPS, pulses", held_out, {"URDF": bare(found.model), "identified": found.model})


def bare(model: Model) -> Model:
    """Model of the description alone, without drives."""
    return Model(model.robot, stated_inertials(model.robot))


def stepped(case: Case, windows: int) -> Iterator[tuple[str, float, float]]:
    """Yield each time step and torque filter: name, time [s], difference of its rms errors from the first."""
    model, first = case.models["identified"], None
    assert isinstance(case.held_out, Recording)
    for integrator, step in STEPS:
        start = time.perf_counter()
        found = roll_out(model, case.held_out, HORIZONS, windows=windows, step=step, integrator=integrator)
        first, spent = first or found, time.perf_counter() - start
        yield f"{integrator}, {1e3 * step:g} ms", spent, apart(found, first)
    rows = case.held_out.read()
    band = choose_band([rows], rate := 1 / survey(case.held_out, model.robot).period)
    for factor in (1.0, 3.0):
        taps = lowpass(rate, factor * band.cutoff)
        smooth = {"t": rows.t, "q": rows.q, "tau": convolve1d(rows.tau, taps, axis=0, mode="nearest")}
        start = time.perf_counter()
        found = roll_out(model, signid.read_recording(smooth, model.robot), HORIZONS, windows=windows)
        assert first is not None
        yield f"torque below {factor * band.cutoff:.3g} Hz", time.perf_counter() - start, apart(found, first)


def apart(found: RollOut, first: RollOut) -> float:
    """Largest relative difference of rms errors at the longest horizon over all joints."""
    return float(np.max(np.abs(found.rms(HORIZONS[-1]) / first.rms(HORIZONS[-1]) - 1)))


def copies(case: Case, windows: int) -> tuple[float, float]:
    """Simulation time of all windows together and one by one [s]."""
    assert isinstance(case.held_out, Recording)
    model, sampling = case.models["identified"], survey(case.held_out, case.models["identified"].robot)
    band = choose_band([case.held_out.read()], 1 / sampling.period)
    cut = cut_windows(model, (case.held_out, sampling), band, HORIZONS[-1], windows, 1e-3)
    return simulated(model, cut, [slice(None)]), simulated(model, cut, [slice(k, k + 1) for k in range(windows)])


def simulated(model: Model, cut: Windows, groups: list[slice]) -> float:
    """Simulation time of groups of windows [s]."""
    spent = 0.0
    for group in groups:
        plant = Plant(model, cut.step, len(cut.t[group]))
        plant.start(cut.q[group, 0], cut.v[group, 0])
        start = time.perf_counter()
        for k in range(cut.torque.shape[1]):
            plant.advance(cut.t[group] + k * cut.step, cut.torque[group, k])
        spent += time.perf_counter() - start
    return spent


def check_targets(found: dict[str, dict[str, RollOut]], speeds: tuple[float, float]) -> Iterator[tuple[str, bool]]:
    """Yield each target and whether it is met."""
    last, three = HORIZONS[-1], found["3r, held_out"]
    worse = float(three["no Coulomb 2"].rms(last)[1] / three["true"].rms(last)[1])
    yield f"3r without Coulomb friction on joint 2: {worse:.1f} times the true model's error there", worse >= LACKING
    near = float(np.max(three["identified"].rms(last) / three["true"].rms(last)))
    yield f"3r identified: at most {near:.2f} times the true model's error", near <= NEAR
    for name, models in found.items():
        gain = float(np.min(models["URDF"].median(last) / models["identified"].median(last)))
        yield f"{name}: the URDF's median error is at least {gain:.1f} times the identified model's", gain >= BETTER
    ratio = speeds[1] / speeds[0]
    yield f"all windows together: {ratio:.1f} times as fast as one by one", ratio >= FASTER


def show(found: dict[str, dict[str, RollOut]]) -> Table:
    """Table of errors per joint and horizon."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title="error in mrad (EMPS: mm), each joint")
    for name in ("recording", "model", "rms, 0.2 s", "rms, 0.5 s", "median, 0.5 s"):
        table.add_column(name)
    for name, models in found.items():
        for model, got in models.items():
            columns = (got.rms(0.2), got.rms(0.5), got.median(0.5))
            table.add_row(name, model, *(" ".join(map(cell, errors)) for errors in columns))
    return table


def cell(error: float) -> str:
    """Error in mrad or mm as text."""
    return f"{1e3 * error:.3g}" if error < 1 else ">1000"


def main() -> None:
    """Roll out, print the tables and write the numbers; exit with 1 when a target is missed."""
    parser = command_line("rollout", __doc__)
    parser.add_argument("--windows", type=int, default=48, help="number of windows per recording (%(default)s)")
    options, console = parser.parse_args(), Console(width=140)
    cases = [three_r(), *(real() if os.environ.get("SIGNID_DATA") else ())]
    found = {
        case.name: {
            key: roll_out(model, case.held_out, HORIZONS, windows=options.windows) for key, model in case.models.items()
        }
        for case in cases
    }
    console.print(show(found))
    example = cases[min(1, len(cases) - 1)]
    rows, speeds = list(stepped(example, options.windows)), copies(example, options.windows)
    for name, spent, off in rows:
        console.print(f"{example.name}, {name:24} {spent:5.2f} s, rms differs by {100 * off:.2f} %", highlight=False)
    console.print(f"{example.name}: {speeds[0]:.2f} s together, {speeds[1]:.2f} s one by one", highlight=False)
    targets = list(check_targets(found, speeds))
    met = print_targets(console, targets)
    machine = {"python": platform.python_version(), "pinocchio": pin.__version__}
    errors = {name: {key: got.document(got) for key, got in models.items()} for name, models in found.items()}
    document = {"machine": machine, "errors": errors, "steps": rows, "seconds": speeds, "targets": dict(targets)}
    write_json(options.json, document)
    raise SystemExit(0 if met else 1)


if __name__ == "__main__":
    main()
