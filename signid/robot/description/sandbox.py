"""File access rules for descriptions, and a restricted process for xacro, whose files are programs.

The process only reads files that `may_read` allows, starts no programs, opens no connections, and is limited in time
(SECONDS) and memory (MEMORY). The module runs as a script and imports nothing from signid.
"""

from __future__ import annotations

import contextlib
import os
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SECONDS, MEMORY = 20, 4_000_000_000  # limits [s], [bytes]
WHERE = "it lies neither beside the description nor in a package or a --package-dir"
MANIFESTS = ("package.xml", "manifest.xml", "stack.xml")
REFUSED = tuple(
    "socket. subprocess. ctypes. shutil. os.system os.exec os.posix_spawn os.spawn os.fork os.kill os.remove os.rename "
    "os.rmdir os.mkdir os.link os.symlink os.truncate os.chmod os.chown os.utime".split()
)


def may_read(path: str | Path, folders: Sequence[str | Path]) -> bool:
    """Whether a description may refer to a file: it lies below one of the folders, or in a ROS package.

    Symbolic links are followed, since a description cannot create any.
    """
    place = Path(os.path.normpath(Path(path).absolute()))
    allowed = {Path(os.path.normpath(Path(folder).absolute())) for folder in folders}
    return any(folder in allowed or any((folder / name).is_file() for name in MANIFESTS) for folder in place.parents)


def _guard(folders: Sequence[str], scratch: str) -> None:
    """Restrict this process permanently by an audit hook."""
    own = [scratch, *(sysconfig.get_path(kind) for kind in ("stdlib", "platstdlib", "purelib", "platlib"))]
    within = tuple(os.path.abspath(folder) + os.sep for folder in own)

    def watch(event: str, given: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(given[0], str | bytes):
            path, writes = os.path.abspath(os.fsdecode(given[0])), _writes(given[1], given[2])
            inside = path.startswith(within[:1] if writes else within)
            if not inside and (writes or not (may_read(path, folders) or os.path.basename(path) in MANIFESTS)):
                raise PermissionError(13, WHERE, path)
        elif event.startswith(REFUSED) and not _in_scratch(given, within[0]):
            raise PermissionError(13, "a description may not do this", event)

    sys.addaudithook(watch)


def _writes(mode: Any, flags: Any) -> bool:
    if isinstance(mode, str):
        return any(letter in mode for letter in "wax+")
    return bool(isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC))


def _in_scratch(given: tuple[Any, ...], scratch: str) -> bool:
    paths = [os.path.abspath(os.fsdecode(x)) + os.sep for x in given if isinstance(x, str | bytes)]
    return bool(paths) and all(path.startswith(scratch) for path in paths)


def _limit() -> None:
    try:
        import resource
    except ImportError:  # Windows; the parent process limits the time
        return
    for kind, most in ((resource.RLIMIT_CPU, SECONDS), (resource.RLIMIT_AS, MEMORY)):
        known = resource.getrlimit(kind)[1]
        least = most if known == resource.RLIM_INFINITY else min(most, known)
        with contextlib.suppress(ValueError):  # macOS has no memory limit
            resource.setrlimit(kind, (least, least))


def _expand(path: str, package_dirs: Sequence[str], scratch: str) -> str:
    import io

    from xacrodoc import XacroDoc, packages

    _limit()
    _guard([os.path.dirname(os.path.abspath(path)), *package_dirs], scratch)
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        packages.reset()
        if package_dirs:
            packages.look_in(list(package_dirs))
        return str(XacroDoc.from_file(path, resolve_packages=False).dom.toxml())


def _main(path: str, scratch: str, *package_dirs: str) -> None:
    """Print the URDF of a xacro file, or exit with 1 and print the reason to standard error."""
    try:
        sys.stdout.buffer.write(_expand(path, package_dirs, scratch).encode())
    except (Exception, SystemExit) as error:  # expressions in the file may raise anything
        reason = "it needs too much memory" if isinstance(error, MemoryError) else " ".join(str(error).split())
        sys.stderr.buffer.write((reason or type(error).__name__).encode("utf-8", "replace"))
        sys.exit(1)


if __name__ == "__main__":
    _main(*sys.argv[1:])
