"""File access rules for descriptions, and a restricted process for xacro and for MuJoCo's compiler.

The compiler is C code, which may crash on a damaged file; it reads files that signid has copied for it. Python never
evaluates the expressions of a xacro file (`xacro_strict`), so an audit hook suffices for xacro: it reads the files that
`may_read` allows, and neither writes, nor runs programs, nor connects. Time and memory of the process are
limited (MAX_SECONDS, MAX_MEMORY).

The module runs as a script and imports nothing from signid.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import sysconfig
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

MAX_SECONDS, MAX_MEMORY = 20, 4_000_000_000  # limits [s], [bytes]
PLACE_FAULT = "it lies neither beside the description nor in a package or a --package-dir"
MODEL_FILE = "model.xml"  # name of the MJCF in its folder
ARGUMENTS_FILE = "arguments.json"  # name of the file with the values of xacro's arguments, in the same folder
SENTENCE_CODE = 2  # exit code if the reason is a sentence of its own
_FLAG_NAMES = ("GRAVITY", "SPRING", "DAMPER", "FRICTIONLOSS")  # of MuJoCo's mjtDisableBit
_BODY_FIELDS = ("pos", "quat", "ipos", "iquat", "mass", "inertia", "gravcomp")  # of MuJoCo's mjModel
MANIFEST_FILES = ("package.xml", "manifest.xml", "stack.xml")
REFUSED_EVENTS = tuple(
    "socket. subprocess. ctypes. shutil. os.system os.exec os.posix_spawn os.spawn os.fork os.kill os.remove os.rename "
    "os.rmdir os.mkdir os.link os.symlink os.truncate os.chmod os.chown os.utime".split()
)


def may_read(path: str | Path, folders: Sequence[str | Path]) -> bool:
    """Whether a description may refer to a file: it is one of the `folders` or below one, or in a ROS package.

    Symbolic links are followed, since a description cannot create any.
    """
    place = Path(os.path.normpath(Path(path).absolute()))
    allowed = {Path(os.path.normpath(Path(folder).absolute())) for folder in folders}
    around = (place, *place.parents)
    return any(folder in allowed or any((folder / name).is_file() for name in MANIFEST_FILES) for folder in around)


def _guard(folders: Sequence[str]) -> None:
    """Restrict this process permanently by an audit hook: it reads files of Python and of `folders`."""
    libraries = ("stdlib", "platstdlib", "purelib", "platlib")
    allowed = tuple(os.path.abspath(sysconfig.get_path(kind)) + os.sep for kind in libraries)
    writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC

    def watch(event: str, given: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(given[0], str | bytes):
            path = os.path.abspath(os.fsdecode(given[0]))
            known = path.startswith(allowed) or os.path.basename(path) in MANIFEST_FILES
            if given[2] & writes or not (known or may_read(path, folders)):
                raise PermissionError(13, PLACE_FAULT, path)
        elif event.startswith(REFUSED_EVENTS):
            raise PermissionError(13, "a description may not do this", event)

    sys.addaudithook(watch)


def _limit_process() -> None:
    try:
        import resource
    except ImportError:  # Windows; the parent process limits the time
        return
    for kind, limit in ((resource.RLIMIT_CPU, MAX_SECONDS), (resource.RLIMIT_AS, MAX_MEMORY)):
        known = resource.getrlimit(kind)[1]
        least = limit if known == resource.RLIM_INFINITY else min(limit, known)
        with contextlib.suppress(ValueError):  # macOS has no memory limit
            resource.setrlimit(kind, (least, least))


def _compile(scratch: str) -> str:
    """Bodies, joints, joint constraints and gravity of `model.xml` in `scratch`, compiled by MuJoCo, as JSON."""
    import mujoco

    spec = mujoco.MjSpec.from_file(os.path.join(scratch, MODEL_FILE))
    spec.compiler.usethread = False
    model = spec.compile()
    off = {name: bool(model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in _FLAG_NAMES}
    bodies = [
        {
            **{key: getattr(model, f"body_{key}")[i].tolist() for key in _BODY_FIELDS},
            "name": model.body(i).name,
            "parent": int(model.body_parentid[i]),
        }
        for i in range(1, model.nbody)
    ]
    ties = [i for i in range(model.neq) if model.eq_active0[i]]
    medium = [model.opt.density, model.opt.viscosity, *model.opt.wind]
    content = {
        "gravity": [0.0] * 3 if off["GRAVITY"] else model.opt.gravity.tolist(),
        "medium": any(medium),
        "bodies": bodies,
        "joints": [_compiled_joint(model, i, off) for i in range(model.njnt)],
        "ties": [[int(model.eq_obj1id[i]), int(model.eq_obj2id[i]), model.eq_data[i, :5].tolist()] for i in ties],
    }
    return json.dumps(content)


def _compiled_joint(model: Any, i: int, off: dict[str, bool]) -> dict[str, Any]:
    """A joint of a compiled model; `off` names the passive torques that the file disables."""
    row, place = model.jnt_dofadr[i], model.jnt_qposadr[i]
    beyond = (model.dof_dampingpoly[row].any() and not off["DAMPER"], model.jnt_stiffnesspoly[i].any())
    return {
        **{key: getattr(model, f"jnt_{key}")[i].tolist() for key in ("pos", "axis", "range")},
        "name": model.joint(i).name,
        "kind": ("free", "ball", "slide", "hinge")[model.jnt_type[i]],
        "body": int(model.jnt_bodyid[i]),
        "ref": float(model.qpos0[place]),
        "limited": bool(model.jnt_limited[i]),
        "effort": float(model.jnt_actfrcrange[i, 1]) if model.jnt_actfrclimited[i] else None,
        "damping": 0.0 if off["DAMPER"] else float(model.dof_damping[row]),
        "frictionloss": 0.0 if off["FRICTIONLOSS"] else float(model.dof_frictionloss[row]),
        "armature": float(model.dof_armature[row]),
        "stiffness": 0.0 if off["SPRING"] else float(model.jnt_stiffness[i]),
        "springref": float(model.qpos_spring[place]),
        "nonlinear": any(map(bool, beyond)),
    }


def _main(scratch: str, path: str, *package_dirs: str) -> None:
    """Print the URDF of a xacro file, or what MuJoCo compiles of an MJCF; or print the reason and exit with 1.

    The reason goes to standard error; it is a sentence of its own if the exit code is SENTENCE_CODE. `path` is empty
    for MJCF. The values of xacro's arguments are in ARGUMENTS_FILE, in `scratch`.
    """
    try:
        _limit_process()
        if path:
            sys.path.append(os.path.dirname(os.path.abspath(__file__)))  # the script has no package
            arguments = json.loads(Path(scratch, ARGUMENTS_FILE).read_text(encoding="utf-8"))
            result = str(import_module("xacro_strict").expand(path, package_dirs, arguments, _guard))
        else:
            result = _compile(scratch)
        sys.stdout.buffer.write(result.encode())
    except (Exception, SystemExit) as error:  # expressions in the file may raise anything
        reason = "it needs too much memory" if isinstance(error, MemoryError) else " ".join(str(error).split())
        sys.stderr.buffer.write((reason or type(error).__name__).encode("utf-8", "replace"))
        sys.exit(SENTENCE_CODE if type(error).__name__ == "Sentence" else 1)


if __name__ == "__main__":
    _main(*sys.argv[1:])
