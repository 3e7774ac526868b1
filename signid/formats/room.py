"""How much memory this process may still take: libraries end the process where there is none, without a word."""

from __future__ import annotations

from pathlib import Path

from ..errors import RecordingError


def need_room(path: Path, size: int) -> None:
    """Refuse a file that would not fit.

    Args:
        path: of the file.
        size: of memory that reading it takes [bytes].

    Raises:
        RecordingError: there is not as much.
    """
    free = room()
    if size > free:
        told = f"{path} needs about {size / 1e9:.2g} GB of memory to be read whole, and there are {free / 1e9:.2g} GB"
        raise RecordingError(f"{told}; give it as Parquet, which is read piece by piece")


def room() -> float:
    """Memory that is free for this process, as far as the system tells [bytes]."""
    limits = [float("inf")]
    told = Path("/proc/meminfo")
    if told.is_file():
        limits += [1024.0 * float(line.split()[1]) for line in told.read_text().splitlines() if "MemAvailable" in line]
    try:
        import resource
    except ImportError:  # Windows
        return min(limits)
    most, used = resource.getrlimit(resource.RLIMIT_AS)[0], Path("/proc/self/statm")
    if most != resource.RLIM_INFINITY and used.is_file():
        limits.append(max(0.0, most - int(used.read_text().split()[0]) * resource.getpagesize()))
    return min(limits)
