"""Task of a set -> stretches of its parts -> HDF5 files of IdentiBench, a description of the set, and a README."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import signid
from signid.errors import RecordingError
from signid.types import Recording

from ..blackbox.run import figures
from ..blackbox.task import Array, Task, filtered, together
from ..concealed_real.sets import RealSet
from ..summary import finite
from . import specification
from .specification import DESCRIPTION, MISSING, channels

UNSTATED = "none stated (all rights reserved)"


@dataclass(frozen=True)
class Origin:
    """Where recordings come from, and what their licence allows."""

    repository: str  # OWNER/NAME on GitHub
    commit: str
    licence: str
    cite: str

    @property
    def source(self) -> str:
        """Web page of the repository at the commit."""
        return f"https://github.com/{self.repository}/tree/{self.commit}"


ORIGINS = {
    "ur10e_mamedov": Origin(
        "shamilmamedov/dynamic_calibration",
        "11af40e7deb758ec080a175fed8fcdd6c99aca29",
        UNSTATED,
        "Mamedov, Mikhel, Frontiers in Robotics and AI 7, 2020, doi 10.3389/frobt.2020.571574",
    ),
    "emps_janot": Origin(
        "forgi86/sysid-neural-continuous",
        "956aa7ecd73061b0321c6f6098d74c9e4a7ce67a",
        "none stated (licence of the repository: Apache-2.0)",
        "Janot, Gautier, Brunot, Data Set and Reference Models of EMPS, Nonlinear Sys. Id. Benchmarks, 2019",
    ),
    "staubli_tx40": Origin(
        "thanhndv212/figaroh-examples",
        "c0b5c7f0fda10078be55104f9ee76ac106b7a5ee",
        "Apache-2.0 (stated in its program files)",
        "Nguyen, Bonnet, Sabbah, Gautier, Fernbach and others, FIGAROH, IEEE-RAS Humanoids, 2023",
    ),
    "panda_gaz2019": Origin(
        "marcocognetti/FrankaEmikaPandaDynModel",
        "24d85ce4e648e2e894c832bfeee9b16711eb1a1a",
        "GPL-3.0",
        "Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, IEEE Robotics and Automation Letters 4(4), 2019",
    ),
    "rokae_xmate": Origin(
        "YanjunLIU-ac/Dynamic_Parameter_Identification_for_Rokae_xMate",
        "d5855f4731b00fc90061c838d66cc40c59f88c7d",
        UNSTATED,
        "its repository",
    ),
    "dvrk_wpi": Origin(
        "WPI-AIM/dvrk_dynamics_identification",
        "7697d3a6c90866c1846f0d3054d7f78384ab1ef9",
        UNSTATED,
        "Wang, Gondokaryono, Munawar, Fischer, IEEE Robotics and Automation Letters, 2019",
    ),
    "dvrk_psm_radiang": Origin(
        "radiang/dvrk_parameter_identification", "b044f8f66e38006a6b8a9fe750d8d3344854da87", UNSTATED, "its repository"
    ),
    "kuka_lwr4_flobaroid": Origin(
        "kjyv/FloBaRoID",
        "e6c077ea",  # of its history: later commits hold pointers in place of the recordings
        "LGPL-3.0",
        "its repository",
    ),
    "dfki_simple_pendulum": Origin(
        "dfki-ric-underactuated-lab/torque_limited_simple_pendulum",
        "ed17ea2d32a35ad944944ca03ef57693e2986732",
        "BSD-3-Clause",
        "its repository",
    ),
}


PARTS = ("train", "valid", "test")  # A, B and C


@dataclass(frozen=True)
class Stretch:
    """N uniform samples of n joints, and which of their M rows count."""

    part: str  # one of PARTS
    name: str  # of its file, without ending
    start: float  # [s] time of the first sample in its recording
    rate: float  # [Hz]
    motion: Array  # (N, 3 n) q, v, a: positions low-passed above the cut-off of the rows, and their derivatives
    torque: Array  # (N, n) [N.m or N] measured, not low-passed to the rows
    taps: Array  # (k,) [1] low-pass of the rows
    factor: int  # samples per row
    counts: NDArray[np.bool_]  # (M, n) rows where the joint moves
    slow: Array  # (n,) [rad/s or m/s] speed below which the direction of motion is uncertain


@dataclass(frozen=True)
class SetFiles:
    """All stretches of a set, and the figures of least squares on its test rows."""

    task: Task
    stretches: tuple[Stretch, ...]

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint's torque."""
        return tuple("N" if x else "N.m" for x in self.task.least_squares.robot.prismatic)

    @cached_property
    def least_squares_rms(self) -> tuple[float, ...]:
        """Rms [N.m or N] of least squares per joint, the row of `benchmarks.blackbox`."""
        rest = self.task.held_out.rest
        return figures(rest, self.task.held_out.torque, np.isfinite(rest))[0]

    def rows(self, part: str) -> list[int]:
        """Rows of a part that count, per joint."""
        own = [x.counts.sum(axis=0) for x in self.stretches if x.part == part]
        return np.sum(own, axis=0).astype(int).tolist()


def set_files(task: Task) -> SetFiles:
    """Cut the parts of a set into stretches without gaps; A and B are at one rate, as for the other methods.

    Raises:
        RecordingError: every stretch is shorter than the filter, or samples have no torque.
    """
    *a, b = together(task)
    named = [("train", f"A{k + 1}", x) for k, x in enumerate(a)] + [("valid", "B", b), ("test", "C", task.c)]
    return SetFiles(task, tuple(x for part, name, own in named for x in _stretches(task, part, name, own)))


def _stretches(task: Task, part: str, name: str, recording: Recording) -> Iterator[Stretch]:
    rows = filtered(task.least_squares, recording, task.cutoff)
    first = 0
    for k, piece in enumerate(rows.pieces):
        motion = piece.motion
        torque = piece.residual + np.asarray(motion.predicted)
        if not np.isfinite(torque).all():
            raise RecordingError(f"{task.name}, {name}: samples without torque; IdentiBench needs it at every sample")
        last = first + len(rows.thin.at(motion.t))
        yield Stretch(
            part=part,
            name=f"{name}_{k + 1}",
            start=float(motion.t[0]),
            rate=1 / motion.dt,
            motion=np.hstack([motion.q, motion.v, motion.a]),
            torque=torque,
            taps=rows.thin.taps,
            factor=rows.thin.factor,
            counts=np.isfinite(rows.residual[first:last]),
            slow=np.asarray(motion.slow),
        )
        first = last


REPOSITORY = Path(__file__).resolve().parents[2]
COPY = "signid_sets.py"  # specification.py, beside the data
README = """# Real robots: inverse dynamics

{count} sets of recordings of real robots as specifications of IdentiBench 0.4: filtered q, dq, ddq -> torque of each
joint. A is training, B validation, C test data. Written by `python -m benchmarks.public_sets` of signid.

```python
import identibench
from signid_sets import specifications

specs = specifications(".")  # this folder
result = identibench.run_benchmark(specs["{example}"], build_model)  # build_model(context) -> model(u, y_init, attrs)
print(result["metric_score"], result["test_sets"])
```

`model(u, y_init, attrs)` returns the torque (N, n) of a file's N samples; `y_init` is empty. The task low-passes and
decimates prediction and measurement in the same way (`taps`, `factor`) and evaluates the rows where the joint moves
(`counts_J`). `{headline}`: geometric mean over joints of rms over the rms of least squares on A and B
(rigid body, viscous and Coulomb friction, offset, rotor inertia); below 1 is better. `rms_J`: rms of joint J
[N.m or N]. To learn from rows as well: `u, y, rows, attrs = read(path, spec.task.joints)`, then `rows(y)`.

Attributes of a file: `fs` [Hz], `start` [s] in the recording, `cutoff` [Hz] of the rows, `slow` [rad/s or m/s], the
speed below which the direction of motion is uncertain, `source` and `licence`. The motion is filtered with zero phase.

The recordings are not signid's. Their licences hold for these files; without one, do not pass them on.

| set | joints | source | licence | cite |
|-|-|-|-|-|
{lines}
"""


def missing() -> str:
    """Error message if IdentiBench or h5py is not installed, otherwise an empty string."""
    try:
        import h5py  # noqa: F401
        import identibench  # noqa: F401
    except ImportError:
        return MISSING
    return ""


def refusal(folder: Path) -> str:
    """Error message if a folder is not for these files, otherwise an empty string."""
    if folder.resolve().is_relative_to(REPOSITORY):
        return f"{folder} is in the repository; recordings do not belong there; give another folder"
    if folder.exists() and not folder.is_dir():
        return f"{folder} is a file; give a folder"
    if folder.exists() and any(folder.iterdir()) and not (folder / COPY).exists():
        return f"{folder} holds other files, which could be replaced; give an empty folder"
    return ""


def write_set(folder: Path, one: RealSet, found: SetFiles) -> Path:
    """Write a set below a folder, in place of an earlier one; return its own folder."""
    place, metadata = folder / one.name, describe(one, found)
    for part in PARTS:
        shutil.rmtree(place / part, ignore_errors=True)
        (place / part).mkdir(parents=True)
    for stretch in found.stretches:
        _write_stretch(place / stretch.part / f"{stretch.name}.hdf5", stretch, metadata)
    text = json.dumps(finite(metadata), indent=1, allow_nan=False)
    (place / DESCRIPTION).write_text(text + "\n", encoding="utf-8")
    return place


def describe(one: RealSet, found: SetFiles) -> dict[str, Any]:
    """Content of the description of a set."""
    origin = ORIGINS[one.folder]
    return {
        "name": one.name,
        "joints": list(found.task.joints),
        "units": list(found.units),
        "source": origin.source,
        "licence": origin.licence,
        "cite": origin.cite,
        "written_by": f"signid {signid.__version__}",
        "recordings": {"train": [x.file for x in one.a], "valid": [one.b.file], "test": [one.c.file]},
        "cutoff": found.task.cutoff,  # [Hz]
        "rows": {part: found.rows(part) for part in PARTS},
        "least_squares_rms": list(found.least_squares_rms),
        "files": {part: [f"{x.name}.hdf5" for x in found.stretches if x.part == part] for part in PARTS},
    }


def write_specification(folder: Path) -> None:
    """Write the code of the specifications into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(specification.__file__, folder / COPY)


def write_readme(folder: Path) -> None:
    """Write the README of the folder."""
    known = [json.loads(x.read_text(encoding="utf-8")) for x in sorted(folder.glob(f"*/{DESCRIPTION}"))]
    lines = [f"| {x['name']} | {len(x['joints'])} | {x['source']} | {x['licence']} | {x['cite']} |" for x in known]
    filled = {"count": len(known), "example": known[0]["name"], "headline": specification.HEADLINE}
    (folder / "README.md").write_text(README.format(lines="\n".join(lines), **filled), encoding="utf-8")


def _write_stretch(path: Path, stretch: Stretch, metadata: dict[str, Any]) -> None:
    import h5py

    named = channels(metadata["joints"])
    with h5py.File(path, "w") as file:
        _columns(file, named.u, stretch.motion, "f4")
        _columns(file, named.y, stretch.torque, "f4")
        _columns(file, named.counts, stretch.counts, "u1")
        file.create_dataset("taps", data=stretch.taps)
        file.attrs.update(
            {
                "fs": stretch.rate,
                "init_sz": 0,
                "factor": stretch.factor,
                "cutoff": metadata["cutoff"],
                "start": stretch.start,
                "slow": stretch.slow,
                **{key: metadata[key] for key in ("joints", "units", "source", "licence", "cite")},
                "set": metadata["name"],
            }
        )


def _columns(file: Any, names: Sequence[str], values: np.ndarray, kind: str) -> None:
    for name, column in zip(names, values.T, strict=True):
        file.create_dataset(name, data=column, dtype=kind, compression="gzip")
