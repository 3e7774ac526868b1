"""Small recordings of the 3R arm, and manifests of them."""

from __future__ import annotations

from pathlib import Path

import polars as pl

ARM = Path(__file__).parents[1] / "robots" / "3r"
FILES = {"identify": "identification.json", "diagnose": "diagnosis.json"}


def record(folder: Path, count: int = 3) -> list[str]:
    """Recordings of 12 s, each starting some seconds after the previous one."""
    whole = pl.concat([pl.read_parquet(ARM / f"{name}.parquet") for name in ("recording", "held_out")])
    names = []
    for k in range(count):
        part = whole[600 * k : 600 * k + 3000].with_columns(t=pl.int_range(pl.len()) * 0.004)
        part.write_parquet(folder / f"day_{k}.parquet")
        names.append(f"day_{k}.parquet")
    return names


def manifest(folder: Path, *rows: str, head: str = "robot,recording,name,time,task") -> Path:
    """A CSV file of those rows."""
    (folder / "manifest.csv").write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    return folder / "manifest.csv"


def contents(folder: Path) -> dict[str, bytes]:
    """Contents of every file below a folder, by path."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
