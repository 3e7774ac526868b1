"""Atomic output: files are written under a temporary name and then renamed."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from stat import S_ISREG
from typing import IO

from ...errors import OutputError

Content = str | bytes | Iterable[str]
MARK = ".signid-"  # prefix of temporary files and folders
_NAME = re.compile(rf"{re.escape(MARK)}\w{{8}}")  # temporary files, as named by mkstemp
WRITTEN = "written by signid"  # in a comment of an XML, C or Python file
_SIGNS = {  # what a file that signid wrote has near its beginning
    ".json": '"schema": "signid.',
    ".html": '<meta name="generator" content="signid">',
    ".urdf": WRITTEN,
    ".h": WRITTEN,
    ".py": WRITTEN,
    ".c": WRITTEN,
}
_BEGINNING = 4096  # [bytes] in which it stands
_STALE = 86_400.0  # age from which a temporary file is considered abandoned [s]
_LINKS = 40  # [links] followed from one to the next at most, as Linux does


def probe_folder(folder: str | Path, option: str = "-o") -> None:
    """Check that results can be written into a folder, without leaving anything there.

    Raises:
        OutputError: the path is a file, lies below a file, or is not writable.
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


def check_foreign(folder: str | Path, names: Iterable[str], option: str = "-o") -> None:
    """Check that result files of these names would replace no device, and no file that signid did not write.

    A JSON file, page or URDF shows its origin itself. Any other file belongs to signid if such a JSON file lies beside
    it, as `signed.csv` beside `identification.json`.

    Raises:
        OutputError: such a file exists.
    """
    place = Path(folder)
    for name in names:
        path = place / name
        check_regular(path)
        shown = [path] if path.suffix in _SIGNS else place.glob("*.json")
        if path.is_file() and not any(map(_is_ours, shown)):
            raise OutputError(
                f"cannot write results to {folder}: {name} in it was not written by signid; name another folder with "
                f"{option}, or move the file"
            )


def check_regular(path: str | Path) -> None:
    """Check that a file of this name would replace a regular file or none.

    Raises:
        OutputError: it is a device, pipe or socket, a link to one, or a link to a file that a process has open.
    """
    place = Path(path)
    for _ in range(_LINKS):
        if not place.is_symlink() or place.is_relative_to("/proc"):
            break
        place = place.parent / place.readlink()
    special = place.is_relative_to("/proc") or (place.exists() and not (place.is_file() or place.is_dir()))
    if special:
        raise OutputError(f"cannot write {path}: it is a device, pipe or socket; give the name of a regular file")


def _is_ours(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return _SIGNS[path.suffix].encode() in file.read(_BEGINNING)
    except OSError:
        return False


def write_files(
    folder: str | Path, contents: Mapping[str, Content], option: str = "-o", *, named: bool = False
) -> list[Path]:
    """Write all files into a folder, or none; create the folder if missing.

    A file that signid did not write is replaced only if the user named it (`named`). A link is replaced, and its target
    kept.

    If the process is killed, each file is either unchanged or complete. The first file appears last. Temporary files
    that remain are removed by a later call, once they are a day old: the folder may be shared between machines, so a
    live writer cannot be detected. Contents are whole or in pieces; text is written as UTF-8.

    Raises:
        OutputError: a file cannot be written; no incomplete file remains.
    """
    if not named:
        check_foreign(folder, contents, option)
    place, target = Path(folder), Path(folder)
    for name in contents:
        check_regular(place / name)
    new = [folder for folder in (place, *place.parents) if not folder.exists()]  # the innermost first
    waiting: list[tuple[Path, Path]] = []
    try:
        place.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            target = place / name
            if target.is_dir():
                raise _refusal(folder, place, IsADirectoryError(0, f"{target.name} in it is a folder"), option)
            waiting.append((_aside(place, content), target))
        ours = [temporary for temporary, _ in waiting]
        now = max((path.stat().st_mtime for path in ours), default=0.0)
        for left in place.glob(f"{MARK}*"):
            with suppress(OSError):
                if S_ISREG(left.lstat().st_mode) and _NAME.fullmatch(left.name) and is_abandoned(left, now):
                    left.unlink()
        for temporary, target in reversed(waiting):
            os.replace(temporary, target)
    except BaseException as error:
        for temporary, _ in waiting:
            temporary.unlink(missing_ok=True)
        for made in new:
            with suppress(OSError):
                made.rmdir()
        if isinstance(error, OSError) and not isinstance(error, OutputError):
            refusal = _file_refusal(target, error, option) if named and target != place else None
            raise refusal or _refusal(folder, place, error, option) from None
        raise
    return [target for _, target in waiting]


@contextmanager
def open_output(path: Path, option: str) -> Iterator[IO[bytes]]:
    """Open a file that appears under its name when the block ends, and does not if the block raises.

    Raises:
        OutputError: it would replace a device, pipe or socket, or cannot be created or completed.
    """
    check_regular(path)
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=MARK)
    except OSError as error:
        raise _file_refusal(path, error, option) from None
    file = os.fdopen(handle, "wb")
    try:
        yield file
        with refused_output(path, option):
            file.close()
            give_usual_rights(Path(name))
            os.replace(name, path)
    finally:
        with suppress(OSError):
            file.close()
        Path(name).unlink(missing_ok=True)


@contextmanager
def refused_output(path: Path, option: str) -> Iterator[None]:
    """Turn an error of the system into a sentence that names the file.

    Raises:
        OutputError: the file cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise error if isinstance(error, OutputError) else _file_refusal(path, error, option) from None


def _aside(place: Path, content: Content) -> Path:
    """Write a temporary file with the permissions of an ordinary new file."""
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
        f"cannot write results to {folder}: {why}; name another folder with {option}, or free disk space"
    )


def _file_refusal(path: Path, error: OSError, option: str) -> OutputError:
    why = error.strerror or type(error).__name__
    return OutputError(f"cannot write {path}: {why}; give another name with {option}, or free disk space")


def is_abandoned(path: Path, now: float) -> bool:
    """Whether a temporary file is at least a day old at `now` [s], since a live writer cannot be detected."""
    return now - path.lstat().st_mtime > _STALE


def give_usual_rights(path: Path) -> None:
    """Set the permissions of an ordinary new file or folder on a private one."""
    mask = os.umask(0)
    os.umask(mask)
    path.chmod((0o777 if path.is_dir() else 0o666) & ~mask)
