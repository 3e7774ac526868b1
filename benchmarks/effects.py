"""Recovery of each law's parameters from simulated data: `python -m benchmarks.effects [--seeds 5 6 7] [--seconds 16]`.

The test arm has viscous and Coulomb friction at every joint, 0.5 % torque noise and a 12 Hz cut-off.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from signid.effects import EFFECTS

from .summary import command_line, write_json

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
HEADINGS = ("effect", "parameter", "seed", "planted", "recovered", "error, %", "share of what is allowed")  # JSON keys


def rows(seeds: Sequence[int], seconds: float, names: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield one row per parameter and seed."""
    tests = import_module("recover")
    for effect in (EFFECTS[name] for name in names):
        for seed in seeds:
            case = tests.case(effect, seed, seconds)
            found = tests.recover(case)
            for key, share in tests.misses(case, found).items():
                true = 1.0 if key == "there" else effect.example[key]
                value = found.coefficient if key == "there" else found.parameters[key]
                error = 100 * (value / true - 1)
                yield dict(zip(HEADINGS, (effect.name, key, seed, true, value, error, share), strict=True))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if an error exceeds its tolerance."""
    parser = command_line("effects", __doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[5, 6, 7])
    parser.add_argument("--seconds", type=float, default=16.0)
    parser.add_argument("--effects", nargs="+", default=[name for name in EFFECTS.names if name != "gravity"])
    options = parser.parse_args(arguments)
    found = list(rows(options.seeds, options.seconds, options.effects))
    table = Table(*HEADINGS, box=SIMPLE_HEAD)
    for row in found:
        table.add_row(*(f"{x:.4g}" if isinstance(x, float) else str(x) for x in row.values()))
    Console(width=120).print(table)
    write_json(options.json, found)
    return int(any(row[HEADINGS[-1]] > 1 for row in found))


if __name__ == "__main__":
    sys.exit(main())
