"""Results appear only when complete: written beside their place under another name, then renamed."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from stat import S_ISREG

from ...errors import OutputError

Content = str | bytes | Iterable[str]
MARK = ".signid-"  # how the names of files and folders begin that are not complete
_NAME = re.compile(rf"{re.escape(MARK)}\w{{8}}")  # of files that are not complete, as mkstemp calls them


_STALE = 86_400.0  # [s]


def probe_folder(folder: str | Path, option: str = "-o") -> None:
    """Find out whether results can be written into a folder, without leaving anything there.

    Args:
        folder: where the results will go.
        option: that names it on the command line.

    Raises:
        OutputError: when it is a file, lies below one, or must not be written to.
    """
    place = Path(folder)
    try:
        while not place.exists() and not place.is_symlink() and place != place.parent:
            place = place.parent
        if not place.is_dir():
            raise _refusal(folder, place, NotADirectoryError(), option)
        with tempfile.TemporaryFile(dir=place):
            pass
    except OutputError:
        raise
    except OSError as error:
        raise _refusal(folder, place, error, option) from None


def write_files(folder: str | Path, contents: Mapping[str, Content], option: str = "-o") -> list[Path]:
    """Write files into a folder, which is made where it is missing; either all of them or none.

    Should the process be killed, every file is as it was or whole. The first one appears last, after all others.
    What it had not finished then stays behind, and is cleared away by whoever writes there a day later or more: that
    it is no longer at work cannot be told, for the folder may be shared between machines.

    Args:
        folder: where the results go.
        contents: name of each file and what it holds, whole or in pieces; text is written as UTF-8.
        option: that names the folder on the command line.

    Raises:
        OutputError: when one of them cannot be written; nothing half-written stays behind.
    """
    place = Path(folder)
    new = _missing(place)
    waiting: list[tuple[Path, Path]] = []
    try:
        place.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            target = place / name
            if target.is_dir():
                raise _refusal(folder, place, IsADirectoryError(0, f"{target.name} in it is a folder"), option)
            waiting.append((_aside(place, content), target))
        _clear(place, [temporary for temporary, _ in waiting])
        for temporary, target in reversed(waiting):
            os.replace(temporary, target)
    except BaseException as error:
        for temporary, _ in waiting:
            temporary.unlink(missing_ok=True)
        for made in new:
            with suppress(OSError):
                made.rmdir()
        if isinstance(error, OSError) and not isinstance(error, OutputError):
            raise _refusal(folder, place, error, option) from None
        raise
    return [target for _, target in waiting]


def _missing(place: Path) -> list[Path]:
    """The folders that will have to be made, the innermost first."""
    return [folder for folder in (place, *place.parents) if not folder.exists()]


def _clear(place: Path, ours: Sequence[Path]) -> None:
    """Remove what runs that were killed left, by the clock of the machine that holds the folder."""
    now = max((path.stat().st_mtime for path in ours), default=0.0)
    for left in place.glob(f"{MARK}*"):
        with suppress(OSError):
            if S_ISREG(left.lstat().st_mode) and _NAME.fullmatch(left.name) and is_abandoned(left, now):
                left.unlink()


def _aside(place: Path, content: Content) -> Path:
    """A temporary file of that content, with the rights of an ordinary new file."""
    handle, name = tempfile.mkstemp(dir=place, prefix=MARK)
    try:
        with os.fdopen(handle, "wb") as file:
            for piece in [content] if isinstance(content, str | bytes) else content:
                file.write(piece.encode() if isinstance(piece, str) else piece)
        give_usual_rights(Path(name))
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return Path(name)


def _refusal(folder: str | Path, place: Path, error: OSError, option: str) -> OutputError:
    if isinstance(error, NotADirectoryError | FileExistsError):
        where = place if place.is_file() else next((p for p in place.parents if p.is_file()), place)
        return OutputError(f"cannot write results to {folder}: {where} is a file; name a folder with {option}")
    why = error.strerror or type(error).__name__
    return OutputError(
        f"cannot write results to {folder}: {why}; name another folder with {option}, or make room in it"
    )


def is_abandoned(path: Path, now: float) -> bool:
    """Whether a run that was killed left this; that it is no longer at work cannot be told, so a day must have gone by.

    Args:
        path: of a file or folder that is not complete.
        now: by the clock of the machine that holds it [s].

    Raises:
        OSError: it is there no more, or cannot be looked at.
    """
    return now - path.lstat().st_mtime > _STALE


def give_usual_rights(path: Path) -> None:
    """The rights of an ordinary new file or folder, for one that only its owner may read.

    Args:
        path: of a file or folder.

    Raises:
        OSError: they cannot be changed.
    """
    mask = os.umask(0)
    os.umask(mask)
    path.chmod((0o777 if path.is_dir() else 0o666) & ~mask)
