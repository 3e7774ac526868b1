"""Files that take messages; their libraries are optional, so a missing one is named in a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import IO, TYPE_CHECKING

from ...errors import OptionError
from .links import Head

if TYPE_CHECKING:
    from .mcap_ import McapFile
    from .rerun_ import RerunFile

LIBRARIES = {"rrd": ("rerun",), "mcap": ("mcap", "rosbags")}  # modules by kind of log
NAMES = {"rerun": "rerun-sdk"}  # package of a module, if it has another name


def check_library(kind: str) -> None:
    """Check that the libraries of a kind of log, "rrd" or "mcap", are installed.

    Raises:
        OptionError: one is missing.
    """
    lacking = [NAMES.get(module, module) for module in LIBRARIES[kind] if find_spec(module) is None]
    if lacking:
        raise OptionError(
            f"writing .{kind} files needs {' and '.join(lacking)}, which is not installed; "
            f"install the viewers with: pip install 'signid[viewers]'"
        )


def log_file(kind: str, out: IO[bytes], head: Head, package_dirs: Sequence[str] = ()) -> McapFile | RerunFile:
    """Begin a file of a kind; it is complete when it is closed.

    package_dirs: folders of packages of meshes, which a file of Rerun contains.

    Raises:
        OptionError: a library is missing.
    """
    check_library(kind)
    if kind == "mcap":
        from .mcap_ import McapFile

        return McapFile(out, head)
    from .rerun_ import RerunFile

    return RerunFile(out, head, package_dirs)
