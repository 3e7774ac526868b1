"""Memory limits: libraries may abort the process without a message if memory is exhausted."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock

from ...errors import RecordingError

_MEMORY, _OWN = Path("/proc/meminfo"), Path("/proc/self/statm")  # of Linux
_LIMITED = Lock()


def require_memory(path: Path, size: float, advice: str = "give it as Parquet, which is read in chunks") -> None:
    """Reject a file that does not fit into memory; `size` is what reading it requires [bytes].

    Raises:
        RecordingError: not enough memory.
    """
    free = free_memory()
    if size > free:
        fault = f"reading {path} needs about {size / 1e9:.2g} GB of memory, but only {free / 1e9:.2g} GB are free"
        raise RecordingError(f"{fault}; {advice}")


def free_memory() -> float:
    """Free memory for this process; infinite if unknown [bytes]."""
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
def memory_limited() -> Iterator[None]:
    """Raise MemoryError for requests beyond the free memory, where Linux would kill the process; only on Linux.

    A few bytes of a compressed log can expand to any size, and libraries do not check it.
    """
    free = free_memory()
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
    """Address space of this process [bytes]."""
    import resource

    return int(_OWN.read_text(encoding="utf-8").split()[0]) * resource.getpagesize()
