"""Locate robot descriptions, by path, in signid, or in example-robot-data, and the mesh files that they may read."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from difflib import get_close_matches
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote

from ..errors import RobotError, shorten
from .sandbox import may_read

_DATA_FOLDER = "example-robot-data"
_PACKAGE_SCHEMES, _FILE_SCHEME = ("package://", "model://"), "file://"
_LOADER_STEMS = dict(  # names in the loaders of example-robot-data -> file stems
    pair.split("=")
    for pair in (
        "alexander=alexander_v1.lowerBodyOnly anymal=anymal_b_simple/anymal anymal_b=anymal_b_simple/anymal "
        "anymal_c=anymal_c_simple/anymal anymal_kinova=anymal-kinova asr_twodof=TwoDofs b1_z1=b1-z1 "
        "borinot=borinot_flying_arm_2 g1=g1_29dof_rev_1_0 hector=quadrotor_base hextilt=hextilt_flying_arm_5 "
        "hyq=hyq_no_sensors solo8=solo talos=talos_reduced talos_arm=talos_left_arm talos_box=talos_reduced_box "
        "talos_full=talos_full_v2 talos_full_box=talos_full_v2_box ur10=ur10_robot "
        "ur10_limited=ur10_joint_limited_robot ur3=ur3_robot ur3_limited=ur3_joint_limited_robot ur5=ur5_robot "
        "ur5_limited=ur5_joint_limited_robot"
    ).split()
)


def locate(source: str | Path) -> Path:
    """Find the description file of a path or name.

    An existing path has priority (a folder means the robot.urdf in it), followed by the robots of signid and those of
    example-robot-data. Names are case-insensitive.

    Raises:
        RobotError: unknown file or robot.
    """
    path, given = Path(os.path.expanduser(source)), str(source)
    if not given.strip():
        raise RobotError("no robot was named; give the path of a URDF, xacro or MJCF file, or a name such as 'panda'")
    try:
        if path.is_file():
            return path
        if path.is_dir() and (path / "robot.urdf").is_file():
            return path / "robot.urdf"
    except OSError as error:
        raise RobotError(f"{given[:80]} cannot be reached ({error.strerror}); check the path") from None
    known = _named_files()
    by_case = {name.casefold(): name for name in sorted(known, reverse=True)}
    name = given if given in known else by_case.get(given.casefold())
    if name is not None:
        return known[name]
    if path.is_dir():
        raise RobotError(f"{given} is a folder without a robot.urdf; give the URDF, xacro or MJCF file itself")
    if path.suffix in (".urdf", ".xacro", ".xml", ".mjcf", ".sdf") or len(path.parts) > 1:
        raise RobotError(f"there is no file {given}; check the path of the robot description")
    close = [by_case[name] for name in get_close_matches(given.casefold(), by_case, n=3, cutoff=0.5)]
    advice = f"did you mean {' or '.join(close)}?" if close else f"some known names are {shorten(names(), 12)}"
    raise RobotError(f"there is no file and no robot named {given!r}; {advice}")


def names() -> tuple[str, ...]:
    """Names of the robots that load without a path, sorted."""
    return tuple(sorted((name for name, path in _named_files().items() if path.suffix == ".urdf"), key=str.casefold))


def saved_model(source: str | Path, exported: bool = False) -> Path | None:
    """File of a saved model: a path that ends in .json, or the name of a published model; None: a description.

    A name that is that of a description elsewhere, as `panda`, means the published model only where it is `exported`.
    """
    path, name = Path(source), str(source).casefold()
    if str(source).endswith(".json"):
        return path
    file = robots_folder() / name / "model.json"
    if Path(name).name != name or not file.is_file() or path.is_file() or (path / "robot.urdf").is_file():
        return None
    return file if exported or _named_files().get(name, file).parent == file.parent else None


def robots_folder() -> Path:
    """Folder of the robots and examples of signid."""
    package = Path(__file__).parents[1]
    inside = package / "robots"  # in the wheel
    return inside if inside.is_dir() else package.parent / "robots"


def find_mesh(name: str, description: str, package_dirs: Sequence[str | Path] = ()) -> Path | None:
    """File of a mesh; None if there is none.

    Files outside the description's folder, a package, or `package_dirs` are never returned. Packages are searched in
    `package_dirs` (packages, or folders of packages), in ROS_PACKAGE_PATH, above the description and in
    example-robot-data. The name is package://PACKAGE/PATH, file://PATH, or a path relative to the description.
    """
    package = next((head for head in _PACKAGE_SCHEMES if name.startswith(head)), None)
    try:
        if package is not None:
            return _in_package(unquote(name.removeprefix(package)), description, package_dirs)
        path = Path(unquote(name.removeprefix(_FILE_SCHEME)))
        near = Path(description).parent if description else None
        place = path if path.is_absolute() else near and near / path
        folders = [*package_dirs, *_data_folders(), *([near] if near else [])]
        return place if place and may_read(place, folders) and place.is_file() else None
    except (OSError, ValueError):  # a name too long for the file system, or with a null character
        return None


def _data_folders() -> list[Path]:
    """Folder of example-robot-data, if any, below the prefix of Pinocchio (wheels and conda)."""
    spec = find_spec("pinocchio")
    above = Path(spec.origin).parents if spec is not None and spec.origin else ()
    places = (prefix / part for prefix in above for part in ("share", "Library/share"))  # the latter on Windows
    return [place for place in places if (place / _DATA_FOLDER / "robots").is_dir()][:1]


def _in_package(inside: str, description: str, package_dirs: Sequence[str | Path]) -> Path | None:
    package, _, rest = inside.partition("/")
    if ".." in Path(inside).parts or package in ("", "."):
        return None
    stated = filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep))
    above = Path(description).resolve().parents[:-1] if description else ()
    for root in (*map(Path, (*package_dirs, *stated)), *above, *_data_folders()):
        if (root / inside).is_file():
            return root / inside
        if root.name == package and (root / rest).is_file():
            return root / rest
    return None


@lru_cache(maxsize=1)
def _named_files() -> dict[str, Path]:
    """URDF files of example-robot-data by stem, or by "folder/stem" if that is ambiguous, and the robots of signid."""
    robots = {path.parent.name: path for path in sorted(robots_folder().glob("*/robot.urdf"))}
    if not _data_folders():
        return robots
    folder = _data_folders()[0] / _DATA_FOLDER / "robots"
    paths = sorted(folder.rglob("*.urdf"))
    count = Counter(path.stem for path in paths)
    full = {f"{path.relative_to(folder).parts[0].removesuffix('_description')}/{path.stem}": path for path in paths}
    unique = {path.stem: path for path in paths if count[path.stem] == 1}
    familiar = {name: (unique | full)[stem] for name, stem in _LOADER_STEMS.items() if stem in unique or stem in full}
    files = {path.stem: path for path in sorted(folder.rglob("*.sdf"))} | unique | familiar
    return files | {name: path for name, path in full.items() if path not in files.values()} | robots
