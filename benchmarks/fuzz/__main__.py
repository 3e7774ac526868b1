"""Fuzz all readers and options: `python -m benchmarks.fuzz --inputs 1000000 --seed 0 [--jobs 2] [--json FILE]`.

The inputs are seed files with mutations; they follow from --seed, the name of the reader and their number, so that
`--only URDF --input 17` repeats one. Each must end in a result or in a SignidError. A finding is any other exception,
more than 10 s of processor, 1 GB or an end of the process, text that a library prints, or a senseless recording that is
neither refused nor flagged. `--guided` lets atheris (libFuzzer) choose the mutations by code coverage instead.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from .campaign import Row, run_campaign
from .guided import run_guided
from .worker import content_of, give


def counts(inputs: int, names: Sequence[str] | None = None) -> dict[str, int]:
    """Inputs of each reader, by its share; of the named ones only, if there are names."""
    from .sources import readers

    chosen = [reader for reader in readers() if not names or reader.name in names]
    whole = sum(reader.share for reader in chosen)
    found = {reader.name: max(1, round(inputs * reader.share / whole)) for reader in chosen}
    most = max(found, key=lambda name: found[name])
    return {**found, most: max(1, found[most] + inputs - sum(found.values()))}


def show(rows: Sequence[Row]) -> Table:
    """Format the rows as a table."""
    table = Table(title="inputs of each reader")
    for name in ("reader", "inputs", "CPU s", "refused", "accepted", "peak, MB", "findings"):
        table.add_column(name, justify="left" if name == "reader" else "right")
    for row in rows:
        numbers = (f"{row.inputs:,}", f"{row.seconds:.0f}", f"{row.refused:,}", f"{row.accepted:,}", str(row.peak))
        table.add_row(row.reader, *numbers, str(sum(one.count for one in row.findings.values())))
    total = [sum(getattr(row, key) for row in rows) for key in ("inputs", "seconds", "refused", "accepted")]
    found = sum(one.count for row in rows for one in row.findings.values())
    peak = max((row.peak for row in rows), default=0)
    table.add_row("all", *(f"{number:,.0f}" for number in total), str(peak), str(found), style="bold")
    return table


def repeat(name: str, seed: int, number: int, keep: Path | None) -> str:
    """Give one input to a reader again; return the fault."""
    from .sources import TOKENS, readers

    (reader,) = (reader for reader in readers() if reader.name == name)
    content = content_of(reader, TOKENS, seed, number)
    if keep:
        (keep / f"{number}-{Path(reader.file).name}").write_bytes(reader.wrap(content))
    with tempfile.TemporaryDirectory() as folder:
        accepted, fault = give(reader, content, Path(folder))
    return fault or ("accepted" if accepted else "refused")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the campaign and print its table and findings; exit with 1 on a finding."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000, help="number of inputs; with --guided, of each reader")
    parser.add_argument("--seed", type=int, default=0, help="seed of the mutations")
    parser.add_argument("--jobs", type=int, default=1, help="worker processes")
    parser.add_argument("--readers", "--only", nargs="+", metavar="NAME", help="run only these readers")
    parser.add_argument("--input", type=int, metavar="N", help="repeat this input of the only reader")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="copy files that cause a fault there")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE as JSON")
    parser.add_argument("--guided", action="store_true", help="guide mutations by coverage (needs atheris)")
    parser.add_argument("--attack", nargs=2, metavar=("NAME", "FOLDER"), help=argparse.SUPPRESS)
    options, console = parser.parse_args(arguments), Console()
    if options.guided or options.attack:
        run_guided(options)
    if options.input is not None:
        console.print(repeat(options.readers[0], options.seed, options.input, options.keep), markup=False)
        return
    start = time.perf_counter()
    with console.status("") as status:
        rows = run_campaign(
            counts(options.inputs, options.readers),
            options.seed,
            options.jobs,
            lambda rows: status.update(f"{sum(row.inputs for row in rows):,} of {options.inputs:,} inputs"),
        )
    console.print(show(rows))
    console.print(f"{(time.perf_counter() - start) / 60:.1f} minutes, {options.jobs} processes, seed {options.seed}")
    findings = [one for row in rows for one in row.findings.values()]
    for one in findings:
        console.print(f"{one.reader}: {one.fault}: {one.count} inputs, first {one.first}", markup=False, soft_wrap=True)
    if options.json:
        options.json.write_text(json.dumps([_document(asdict(row)) for row in rows], indent=1), encoding="utf-8")
    raise SystemExit(1 if findings else 0)


def _document(row: Mapping[str, object]) -> dict[str, object]:
    found = row["findings"]
    return {**row, "findings": list(found.values()) if isinstance(found, dict) else found}


if __name__ == "__main__":
    main()
