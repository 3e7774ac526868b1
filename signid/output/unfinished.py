"""What outputs are called while they are not complete, and when nobody is at work on them any more."""

from __future__ import annotations

import os
from pathlib import Path

MARK = ".signid-"  # how the names of files and folders begin that are not complete
_STALE = 86_400.0  # [s]


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
