"""Identify the published models robots/NAME/model.json from public recordings: `python robots/publish.py NAME ...`.

published.toml lists recordings and command of each. The recordings are read from the folder SIGNID_DATA, and only
numbers are written. A model that predicts the held-out recording of any joint worse than the plain description does
is refused.
"""

import json
import os
import sys
import tomllib
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from signid import SignidError
from signid.cli import run
from signid.errors import InputError
from signid.output.report import to_json
from signid.recording.gallery import data_folder

ROBOTS = Path(__file__).parent
DATE = "2026-11-28"  # on which the models were made
Z95 = 1.96  # standard deviations of an interval of 95 %
SETTLED = (0, 3)  # exit codes: done, done with flags

Document = dict[str, Any]


def published() -> dict[str, dict[str, str]]:
    """Return title, recordings and command of each published model by its name."""
    return tomllib.loads((ROBOTS / "published.toml").read_text(encoding="utf-8"))


def identify(name: str) -> Document:
    """Identify a model: content of its model.json, with date, source, licence, held-out error and intervals.

    Raises:
        InputError: no recordings, or a model that predicts the held-out recording worse than the description.
    """
    entry = published()[name]
    words = entry["command"].split()
    if not os.environ.get("SIGNID_DATA"):
        raise InputError("SIGNID_DATA is not set; name the folder of the recordings that robots/published.toml lists")
    with TemporaryDirectory() as folder, chdir(data_folder()):
        code = run(["identify", *(word.replace("{robots}", str(ROBOTS.resolve())) for word in words), "-o", folder])
        if code not in SETTLED:
            raise InputError(f"the identification of {name} ended with {code}; see above")
        found, model = (
            json.loads(Path(folder, f"{part}.json").read_text(encoding="utf-8")) for part in ("identification", "model")
        )
    error = found["servo"]["rollout"] if "servo" in found else found["fit"]
    if worse := [one["joint"] for one in held_out(error) if one["rms"] > one.get("without", one["rms"])]:
        raise InputError(f"{name} is not published: worse than its description at {', '.join(worse)}")
    if worse := [flag for flag in found["flags"] if "worse than by the description" in flag]:
        raise InputError(f"{name} is not published: {worse[0]}")
    facts = {key: entry[key] for key in ("title", "description", "source", "licence", "recordings")}
    command = " ".join(["signid identify", *words]).replace("{robots}", "robots")
    made = {"date": DATE, **facts, "command": command, "version": found["version"], "flags": found["flags"]}
    return {**model, "published": {**made, "held_out": held_out(error), "numbers": [*numbers(found)]}}


def held_out(error: Document) -> list[Document]:
    """Held-out error by joint: rms of the torque, or of the position in the closed loop and without the fit."""
    if "whole_rms" not in error:
        keys = (error["joints"], error["unit"], error["held_out_rms"], error["held_out_r2"])
        return [{"joint": j, "unit": u, "rms": rms, "r2": r2} for j, u, rms, r2 in zip(*keys, strict=True)]
    rows = zip(error["joints"], error["whole_rms"], error["nominal_whole_rms"], strict=True)
    return [{"joint": joint, "rms": rms, "without": nominal, "of": error["nominal"]} for joint, rms, nominal in rows]


def numbers(found: Document) -> Iterator[Document]:
    """Yield each number with its interval of 95 %, or with why it has none."""
    for joint in found.get("servo", {}).get("joints", ()):
        for name, number in joint.items():
            if isinstance(number, dict) and "unit" in number:
                yield {"joint": joint["joint"], "number": name, **_interval(number)}
    for law in () if "servo" in found else found["effects"]:
        for name, number in law["parameters"].items():
            yield {"joint": law["joint"], "number": f"{law['effect']}.{name}", **_interval(number)}
    for row in found["base_parameters"]:
        yield {"number": row["expression"], **_interval(row)}


def _interval(number: Document) -> Document:
    """Value, unit and interval; bounds and the sentence of a number that is not identifiable."""
    std, stated = number.get("std"), number.get("stated")
    known = {"value": number["value"], "unit": number["unit"]}
    if std is not None:
        return {**known, "interval": Z95 * std}
    if stated is not None:
        return {**known, "stated": stated}
    bounds = {key: number[key] for key in ("below", "above") if number.get(key) is not None}
    return {**known, **bounds, "not_identifiable": number.get("sentence") or "only together with other numbers"}


def main(names: list[str]) -> None:
    """Write the published models of these names, or all."""
    if unknown := sorted({*names} - {*published()}):
        raise InputError(f"there is no published model {unknown[0]}; choose from {', '.join(published())}")
    for name in names or published():
        path = ROBOTS / name / "model.json"
        path.write_text(to_json(identify(name)), encoding="utf-8")
        print(f"{name}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except SignidError as error:
        raise SystemExit(str(error)) from None
