"""All readers of a campaign with their shares: of files, and of what is no file of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from .drives import drive_readers
from .factors import changed, changes, identify_from, pendulum
from .readers import TOKENS, Reader, readers as file_readers
from .texts import (
    EXPRESSIONS,
    HEADERS,
    OPTIONS,
    SIMULATED,
    law_seeds,
    read_expression,
    read_header,
    read_law,
    read_senseless,
    run_line,
    run_simulation,
)

__all__ = ["TOKENS", "readers"]

SHARES = {  # of the inputs of a campaign, per mille
    "URDF": 90,
    "xacro": 0.3,
    "MJCF": 40,
    "actuators": 60,
    "columns": 60,
    "bounds": 40,
    "CSV": 15,
    "CSV, gzip inside": 6,
    "CSV, gzip": 4,
    "Parquet": 6,
    "NPZ": 4,
    "NPZ, arrays": 8,
    "JSON lines": 6,
    "JSON": 6,
    "Arrow": 6,
    "NPY": 4,
    "MATLAB": 6,
    "HDF5": 4,
    "ROS 1 bag": 3,
    "ROS 2 bag": 3,
    "ROS 2 bag, metadata": 2,
    "MCAP": 3,
    "LeRobot": 3,
    "LeRobot, description": 5,
    "factors": 4,
    "factors, header": 15,
    "manifest": 80,
    "motion": 15,
    "model.json": 60,
    "diagnosis.json": 30,
    "laws": 110,
    "names of columns": 50,
    "expressions of xacro": 120,
    "command line": 8,
    "laws, simulated": 2,
    "senseless recordings": 0.4,
    "factors, arrays": 10,
    "watched lines, CSV": 10,
    "watched lines, JSON": 10,
    "servo columns": 4,
    "stated drives": 40,
    "saved drives": 30,
    "names in exports": 6,
}


@cache
def readers() -> tuple[Reader, ...]:
    """All readers, with their shares."""
    found = (
        *file_readers(),
        Reader("factors, arrays", "f.npz", changes(), lambda path: identify_from(path, pendulum()), wrap=changed),
        *drive_readers(),
        Reader("laws", "law", law_seeds(), read_law),
        Reader("names of columns", "names", HEADERS, read_header),
        Reader("expressions of xacro", "expression", EXPRESSIONS, read_expression),
        Reader("command line", "line", OPTIONS, run_line),
        Reader("laws, simulated", "simulated", [SIMULATED, *law_seeds()], run_simulation),
        Reader("senseless recordings", "recording", [bytes(range(64))], read_senseless),
    )
    return tuple(replace(reader, share=SHARES[reader.name]) for reader in found)
