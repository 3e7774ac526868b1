"""Public benchmarks beside published rows: `python -m benchmarks.public [--json FILE]`.

EMPS, official split; needs SIGNID_DATA. The rule of choice and the digest of each model are printed before the test
file is opened.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from ..one_thread import one_thread
from ..summary import finite, frame, origin
from .emps import entries, files, scored
from .rows import EARLIER, OTHERS, RULE, Row

GOAL, LIMIT = 5.17, 8  # [mm] the best published row; numbers of a model at most


def main() -> int:
    """Make the models, print their digests, then score them."""
    one_thread()
    parser = argparse.ArgumentParser(prog="python -m benchmarks.public", description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows to FILE as JSON")
    options, console = parser.parse_args(), Console(width=160, highlight=False)
    if not os.environ.get("SIGNID_DATA"):
        sys.exit("SIGNID_DATA is not set; real recordings are not in the repository; set it to their folder")
    console.print(RULE)
    made = []
    for entry in entries():
        made.append(entry)
        console.print(f"\n{entry.method}: sha256 {entry.digest}")
        for law in entry.model.laws:
            console.print(f"  {law.effect.name} {', '.join(f'{k} {v:.6g}' for k, v in law.parameters.items())}")
        for line in entry.trials:
            console.print(f"  tried: {line}")
    train, test = files()
    rows = [*(scored(entry, train, test) for entry in made), *OTHERS]
    rows.sort(key=lambda row: row.test or 0.0)
    console.print(table(rows), EARLIER)
    if options.json:
        document = {"origin": origin("public", sys.argv[1:]), "rows": [asdict(row) for row in rows]}
        text = json.dumps(finite(document), indent=1, allow_nan=False)
        options.json.write_text(text + "\n", encoding="utf-8")
    return 0


def table(rows: list[Row]) -> Table:
    """Table of all rows."""
    out = frame(
        "EMPS, test file, simulated open loop: RMSE of position [mm]",
        ("method", "numbers", "train", "test", "s", "source"),
    )
    out.columns[-1].justify = "left"
    for row in rows:
        figures = ("-" if x is None else f"{x:.3g}" for x in (row.train, row.test, row.seconds))
        train, test, seconds = figures
        out.add_row(row.method, "-" if row.numbers is None else str(row.numbers), train, test, seconds, row.source)
    return out


if __name__ == "__main__":
    raise SystemExit(main())
