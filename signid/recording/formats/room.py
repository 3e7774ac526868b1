"""How much memory this process may still take: libraries end the process where there is none, without a word."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock

from ...errors import RecordingError

_MEMORY, _OWN = Path("/proc/meminfo"), Path("/proc/self/statm")  # of Linux
_LIMITED = Lock()


def need_room(path: Path, size: float, mend: str = "give it as Parquet, which is read piece by piece") -> None:
    """Refuse a file that would not fit.

    Args:
        path: of the file.
        size: of memory that reading it takes [bytes].
        mend: what to do then.

    Raises:
        RecordingError: there is not as much.
    """
    free = room()
    if size > free:
        told = f"{path} needs about {size / 1e9:.2g} GB of memory to be read whole, and there are {free / 1e9:.2g} GB"
        raise RecordingError(f"{told}; {mend}")


def room() -> float:
    """Memory that is free for this process, as far as the system tells [bytes]."""
    limits = [float("inf")]
    if _MEMORY.is_file():
        lines = _MEMORY.read_text(encoding="utf-8").splitlines()
        limits += [1024.0 * float(line.split()[1]) for line in lines if "MemAvailable" in line]
    try:
        import resource
    except ImportError:  # Windows
        return min(limits)
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most != resource.RLIM_INFINITY and _OWN.is_file():
        limits.append(max(0.0, most - _used()))
    return min(limits)


@contextmanager
def within_room() -> Iterator[None]:
    """What asks for more memory than is free gets a MemoryError, where Linux would end the process; only there.

    A few bytes of a compressed log may stand for any number, and libraries unpack them without looking.
    """
    free = room()
    if free == float("inf") or not _OWN.is_file():
        yield
        return
    import resource

    with _LIMITED:
        limits = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (int(_used() + free), limits[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, limits)


def _used() -> int:
    """Addresses that this process has taken [bytes]."""
    import resource

    return int(_OWN.read_text(encoding="utf-8").split()[0]) * resource.getpagesize()
