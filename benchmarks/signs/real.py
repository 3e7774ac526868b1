"""Real robots with signed recordings: signs are removed, recovered and compared."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import signid
from signid.regression.session import Options

from ..real.data import LINK_SIDE, ROBOTS, data, ur10e
from .row import Row, Target
from .trial import Puzzle, attempt
from .truth import measured

UR10E = ("20_02_12_40sec_12harm", "20_02_12_50sec_12harm", "20_01_31_unload", "20_02_10_30sec_12harm")
HARD = UR10E[-1]  # reported without target
PANDA_TARGET = Target(segments=1.0, samples=0.989, off=0.01, seconds=2.0)
UR10E_TARGET = Target(segments=0.985)
FAST = 20.0  # low-pass of the true samples in fast logs [Hz]


def rows() -> Iterator[Row]:
    """Yield the rows of Panda, UR10e, TX40 and EMPS."""
    yield attempt(panda(), target=PANDA_TARGET)
    for name in UR10E:
        yield attempt(ur10e_log(name), target=Target() if name == HARD else UR10E_TARGET)
    yield attempt(fast("TX40", data() / "staubli_tx40" / "tx40.urdf", "staubli_tx40/exciting_traj"))
    yield attempt(fast("EMPS", ROBOTS / "emps" / "robot.urdf", "emps_janot/emps_train"))


def panda() -> Puzzle:
    """Panda with link-side torque sensors, 21 s; the last 30 % are held out."""
    folder = data() / "panda_gaz2019"
    robot, options = signid.load_robot(folder / "panda.urdf"), Options(effects=LINK_SIDE)
    return Puzzle("Panda", "21 s", robot, (folder / "exciting_traj_1.csv.gz",), options=options)


def ur10e_log(name: str) -> Puzzle:
    """UR10e with motor currents; another log is held out."""
    train, held_out = (data() / "ur10e_mamedov" / f"identification_data__{key}.csv.gz" for key in (name, other(name)))
    return Puzzle("UR10e", name, ur10e(), (train,), (held_out,))


def other(name: str) -> str:
    """Held-out log for a log of the UR10e."""
    return UR10E[1] if name != UR10E[1] else UR10E[0]


def fast(group: str, description: Path, recording: str) -> Puzzle:
    """Log at a high rate; the last 30 % are held out."""
    robot, path = signid.load_robot(description), data() / f"{recording}.csv.gz"
    whole = signid.read_recording(path, robot).read()
    return Puzzle(
        group, path.name.partition(".")[0], robot, (path,), truths=(measured(whole.t, whole.q, whole.tau, FAST),)
    )
