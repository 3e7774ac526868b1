"""Stretches -> HDF5 files of IdentiBench, a description of the set, and a README of the folder."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import signid

from ..concealed_real.sets import RealSet
from ..summary import finite
from . import specification
from .origins import ORIGINS
from .specification import DESCRIPTION, MISSING, channels
from .stretches import PARTS, SetFiles, Stretch

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
    """Error message if a folder is not for these files, otherwise an empty string.

    Args:
        folder: folder of all sets.
    """
    if folder.resolve().is_relative_to(REPOSITORY):
        return f"{folder} is in the repository; recordings do not belong there; give another folder"
    if folder.exists() and not folder.is_dir():
        return f"{folder} is a file; give a folder"
    if folder.exists() and any(folder.iterdir()) and not (folder / COPY).exists():
        return f"{folder} holds other files, which could be replaced; give an empty folder"
    return ""


def write_set(folder: Path, one: RealSet, found: SetFiles) -> Path:
    """Write a set below a folder, in place of an earlier one; return its own folder.

    Args:
        folder: folder of all sets.
        one: set of recordings.
        found: its stretches.
    """
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
    """Content of the description of a set.

    Args:
        one: set of recordings.
        found: its stretches.
    """
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
    """Write the code of the specifications into the folder.

    Args:
        folder: folder of all sets.
    """
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(specification.__file__, folder / COPY)


def write_readme(folder: Path) -> None:
    """Write the README of the folder.

    Args:
        folder: folder of all sets, at least one of them written.
    """
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
