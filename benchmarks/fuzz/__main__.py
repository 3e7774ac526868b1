"""Fuzz all readers and options: `python -m benchmarks.fuzz --inputs 1000000 --seed 0 [--jobs 2] [--json FILE]`.

The inputs are seed files with mutations; they follow from --seed, the name of the reader and their number, so that
`--only URDF --input 17` repeats one. Each must end in a result or in a SignidError. A finding is any other exception,
more than 10 s of processor, 1 GB or an end of the process, text that a library prints, or a senseless recording that is
neither refused nor flagged. `--guided` lets atheris (libFuzzer) choose the mutations by code coverage of signid
instead, in a process for each reader of `readers.py`: `--inputs` files each (xacro: a hundredth, because it starts a
process per file).
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

from rich.console import Console
from rich.table import Table

from ..summary import ONE_THREAD, command_line, write_json
from .campaign import Row, run_campaign
from .worker import content_of, give

# time per file [s], memory [MB], largest file unless a seed is larger [byte]
SECONDS, MEMORY, LENGTH = 60, 3000, 20_000
SLOW = 100  # divisor on the number of files for readers that start processes


@dataclass(frozen=True)
class GuidedRow:
    """Result of one reader."""

    reader: str
    inputs: int
    minutes: float
    memory: int  # peak [MB]
    fault: str  # "" without fault


def attack(name: str, folder: Path, inputs: int) -> None:
    """Fuzz one reader; runs in a separate process and does not return."""
    import atheris

    with atheris.instrument_imports(include=["signid", "tomllib"]):
        from .readers import TOKENS, readers
    (reader,) = (each for each in readers() if each.name == name)
    corpus, place, words = folder / "corpus", folder / "files", folder / "words"
    for subfolder in (corpus, place):
        subfolder.mkdir()
    for k, seed in enumerate(reader.seeds):
        (corpus / str(k)).write_bytes(seed)
    words.write_text(
        "\n".join(f'"{"".join(f"{chr(92)}x{b:02x}" for b in token[:60])}"' for token in TOKENS) + "\n", encoding="utf-8"
    )
    warnings.simplefilter("ignore")
    reader(reader.seeds[0], place)
    length = max(LENGTH, *map(len, reader.seeds))
    options = [f"-runs={inputs}", f"-timeout={SECONDS}", f"-rss_limit_mb={MEMORY}", f"-max_len={length}", "-seed=1"]
    options += [f"-dict={words}", f"-artifact_prefix={folder}/fault-", "-print_final_stats=1", "-len_control=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], lambda content: reader(content, place) and None)
    atheris.Fuzz()


def measure(name: str, inputs: int, keep: Path | None) -> GuidedRow:
    """Fuzz one reader in a separate process; copy a faulty file to `keep`."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.fuzz", "--attack", name, folder, "--inputs", str(inputs)]
        start = time.perf_counter()
        done = subprocess.run(
            command,
            env={**os.environ, **ONE_THREAD},
            capture_output=True,
            text=True,
            errors="replace",
            encoding="utf-8",
        )
        minutes, output = (time.perf_counter() - start) / 60, done.stdout + done.stderr
        numbers = {key: int(value) for key, value in re.findall(r"stat::(\w+):\s+(\d+)", output)}
        fault = "" if done.returncode == 0 else _fault(output)
        for file in Path(folder).glob("fault-*") if keep else ():
            (keep / f"{name.replace(' ', '_')}-{file.name}").write_bytes(file.read_bytes())
    return GuidedRow(name, numbers.get("number_of_executed_units", 0), minutes, numbers.get("peak_rss_mb", 0), fault)


def _fault(output: str) -> str:
    """Extract the line that describes the fault."""
    lines = [
        line for line in output.splitlines() if re.match(r"[\w.]*(Error|Exception|Interrupt)\b|==.*(ERROR|ALARM)", line)
    ]
    return (lines or output.strip().splitlines() or ["unknown"])[0][:200]


def show_guided(rows: Sequence[GuidedRow]) -> Table:
    """Format the rows as a table."""
    table = Table(title="files given to each reader")
    for name in ("reader", "files", "minutes", "peak, MB", "fault"):
        table.add_column(name, justify="left" if name in ("reader", "fault") else "right")
    for row in rows:
        table.add_row(row.reader, f"{row.inputs:,}", f"{row.minutes:.1f}", str(row.memory), row.fault or "none")
    return table


def run_guided(options: argparse.Namespace) -> NoReturn:
    """Fuzz every reader and print the table; exit with 1 on a fault."""
    if find_spec("atheris") is None:
        raise SystemExit("atheris is not installed; run `pip install atheris` (Linux and macOS)")
    if options.attack:
        attack(options.attack[0], Path(options.attack[1]), options.inputs)
    from .readers import readers

    console, rows = Console(), list[GuidedRow]()
    for reader in readers():
        if not options.readers or reader.name in options.readers:
            with console.status(reader.name):
                rows.append(measure(reader.name, max(1, options.inputs // (SLOW if reader.slow else 1)), options.keep))
    console.print(show_guided(rows))
    write_json(options.json, rows)
    raise SystemExit(1 if any(row.fault for row in rows) else 0)


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
    parser = command_line("fuzz", __doc__)
    parser.add_argument("--inputs", type=int, default=20_000, help="number of inputs; with --guided, of each reader")
    parser.add_argument("--seed", type=int, default=0, help="seed of the mutations")
    parser.add_argument("--jobs", type=int, default=1, help="worker processes")
    parser.add_argument("--readers", "--only", nargs="+", metavar="NAME", help="run only these readers")
    parser.add_argument("--input", type=int, metavar="N", help="repeat this input of the only reader")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="copy files that cause a fault there")
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
    write_json(options.json, [_document(asdict(row)) for row in rows])
    raise SystemExit(1 if findings else 0)


def _document(row: Mapping[str, object]) -> dict[str, object]:
    found = row["findings"]
    return {**row, "findings": list(found.values()) if isinstance(found, dict) else found}


if __name__ == "__main__":
    main()
