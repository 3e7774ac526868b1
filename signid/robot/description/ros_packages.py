"""Folders of ROS packages, which xacro files name by $(find PACKAGE), without an installation of ROS.

The restricted process of `sandbox` loads the module, which imports nothing from signid.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

ABSENT = "package://"  # begins the text in place of the folder of a package that is not there
MANIFEST, OLD_MANIFEST = "package.xml", "manifest.xml"  # of ROS 1 and 2, of rosbuild
LONGEST = 100_000  # part of a manifest that is searched for the name [characters]
INSIDE = frozenset("arms description grippers model models robot robots urdf xacro".split())  # of a package's folders
_NAME = re.compile(r"[A-Za-z][\w\-]*")
_STATED = re.compile(r"<name>\s*([\w\-]+)\s*</name>")


def package_finder(path: str, package_dirs: Sequence[str], allow: Callable[[str], None]) -> Callable[[str], str]:
    """Finder of a package's folder by its name, for the description in `path`.

    A package is a folder with a manifest that states the name. It is searched in the given folders, above and beside
    the description, and where ROS is installed. A folder without a manifest counts if its own name is that of the
    package and it is in a given folder, or above the description and looks like a package. `allow` gets the folder
    that is found. The name of a package that is not there becomes ABSENT and the name, as meshes have it.
    """
    place = Path(os.path.abspath(path))
    above, given = place.parents, [Path(folder) for folder in package_dirs]

    def candidates(name: str) -> Iterator[Path]:
        for folder in given:
            yield from (at for at in (folder, folder / name) if _states(at, name))
            yield from (at for at in (folder, folder / name) if at.name == name and at.is_dir())
            yield from _below(folder, name)
        yield from (folder for folder in above if _states(folder, name))
        yield from (folder for folder in above if folder.name == name and _like_package(folder, place))
        yield from (folder / name for folder in above if _states(folder / name, name))
        prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
        shares = (Path(prefix, "share", name) for prefix in prefixes)
        yield from (share for share in shares if _states(share, name))
        yield from _below(None, name)

    @functools.cache
    def find(name: str) -> str:
        found = next(candidates(name), None) if _NAME.fullmatch(name) else None
        if found is None:
            return ABSENT + name
        allow(str(found))
        return found.as_posix()

    return find


def absent_package(path: object) -> str:
    """Name of the package without which a file cannot be read, or an empty text."""
    text = str(path)
    return text.removeprefix(ABSENT).partition("/")[0] if text.startswith(ABSENT) else ""


def _states(folder: Path, name: str) -> bool:
    """Whether a folder has a manifest that states the name of the package; rosbuild's is named by its folder."""
    try:
        with open(folder / MANIFEST, encoding="utf-8", errors="replace") as stream:
            stated = _STATED.search(stream.read(LONGEST))
    except OSError:
        return folder.name == name and (folder / OLD_MANIFEST).is_file()
    return bool(stated and stated.group(1) == name)


def _like_package(folder: Path, file: Path) -> bool:
    """Whether a folder above a file is no other one of the computer: it has a _ and the layout of a ROS package."""
    home = Path.home()
    usual = "_" in folder.name and file.relative_to(folder).parts[0] in INSIDE
    return usual and folder != home and folder not in home.parents


def _below(folder: Path | None, name: str) -> Iterator[Path]:
    """The package somewhere below a folder, or in ROS_PACKAGE_PATH."""
    from xacrodoc.packages import PackageFinder, PackageNotFoundError

    finder = PackageFinder()
    if folder is not None:
        finder.look_in([str(folder)])
    with contextlib.suppress(PackageNotFoundError, OSError):
        yield Path(finder.get_path(name))
