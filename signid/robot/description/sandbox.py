"""File access rules for descriptions, and a restricted process for xacro and for MuJoCo's compiler.

The compiler is C code, which may crash on a damaged file; it reads files that signid has copied for it. Xacro files
contain expressions, which are walked as a syntax tree (simpleeval): numbers, strings, lists, dictionaries, operators,
the functions that xacro documents, and listed methods. Python never evaluates them, so an audit hook suffices for
xacro: it reads the files that `may_read` allows, and neither writes, nor runs programs, nor connects. Time (SECONDS)
and memory (MEMORY) of the process are limited.

The module runs as a script and imports nothing from signid.
"""

from __future__ import annotations

import contextlib
import os
import sys
import sysconfig
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

SECONDS, MEMORY = 20, 4_000_000_000  # limits [s], [bytes]
WHERE = "it lies neither beside the description nor in a package or a --package-dir"
COMPILED = "model.xml"  # name of the MJCF in its folder
ARGUMENTS = "arguments.json"  # name of the file with the values of xacro's arguments, in the same folder
SENTENCE = 2  # exit code if the reason is a sentence of its own
_FLAGS = ("GRAVITY", "SPRING", "DAMPER", "FRICTIONLOSS")  # of MuJoCo's mjtDisableBit
_BODY = ("pos", "quat", "ipos", "iquat", "mass", "inertia", "gravcomp")  # of MuJoCo's mjModel
LIBRARIES = ("stdlib", "platstdlib", "purelib", "platlib")  # folders of Python's own files
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC  # flags of a file that is opened
MANIFESTS = ("package.xml", "manifest.xml", "stack.xml")
REFUSED = tuple(
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
    return any(folder in allowed or any((folder / name).is_file() for name in MANIFESTS) for folder in around)


def _guard(folders: Sequence[str]) -> None:
    """Restrict this process permanently by an audit hook: it reads files of Python and of `folders`."""
    own = tuple(os.path.abspath(sysconfig.get_path(kind)) + os.sep for kind in LIBRARIES)

    def watch(event: str, given: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(given[0], str | bytes):
            path = os.path.abspath(os.fsdecode(given[0]))
            known = path.startswith(own) or os.path.basename(path) in MANIFESTS
            if given[2] & WRITES or not (known or may_read(path, folders)):
                raise PermissionError(13, WHERE, path)
        elif event.startswith(REFUSED):
            raise PermissionError(13, "a description may not do this", event)

    sys.addaudithook(watch)


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


def _expression_class() -> Any:
    """Class of simpleeval's evaluators with the names and attributes of a xacro file."""
    import ast

    import simpleeval
    import xacro

    named, methods = (xacro.NameSpace, xacro.YamlDictWrapper), simpleeval.BASIC_ALLOWED_ATTRS

    class Expression(simpleeval.EvalWithCompoundTypes):  # type: ignore[misc]
        """Syntax-tree evaluator."""

        def __init__(self, names: Any) -> None:
            super().__init__(functions={})
            self.names = names
            for kind in (ast.JoinedStr, ast.FormattedValue, ast.Assign, ast.AugAssign):
                del self.nodes[kind]

        def _check_disallowed_items(self, item: Any) -> None:  # attributes and names are listed one by one
            pass

        def _eval_call(self, node: ast.Call) -> Any:
            function = self._eval(node.func)
            named_arguments = dict(self._eval(keyword) for keyword in node.keywords)
            return function(*self._eval_list(ast.List(node.args)), **named_arguments)

        def _eval_attribute(self, node: ast.Attribute) -> Any:
            owner = self._eval(node.value)
            if isinstance(owner, named) and node.attr not in methods[dict]:
                return owner[node.attr]
            kind = next((kind for kind in methods if kind is not None and isinstance(owner, kind)), None)
            if kind is None or node.attr not in methods[kind] or node.attr in simpleeval.DISALLOW_METHODS:
                raise simpleeval.FeatureNotAvailable(f"an expression may not use .{node.attr} here")
            return getattr(owner, node.attr)

    return Expression


def _restrict_expressions(find: Callable[[str], str]) -> None:
    """Let xacro and its `$(eval ...)` walk expressions as syntax trees, in place of Python's `eval`.

    `find` finds the folder of a package for `$(find ...)`.
    """
    import xacro
    from xacro import substitution_args

    expression_class = _expression_class()

    def evaluate(expression: str, names: Any, _: Any = None) -> Any:
        return expression_class(names).eval(expression)

    def substitute(expression: str, context: dict[str, Any]) -> str:
        stated = context.get("arg", {})
        given = {name: substitution_args.convert_value(text, "auto") for name, text in stated.items()}
        own = {
            "arg": lambda name: substitution_args.convert_value(stated[name], "auto"),
            "dirname": lambda: os.path.dirname(context["filename"]),
        }
        known = {k: v for k, v in substitution_args._eval_dict.items() if not k.startswith("_")}
        return str(evaluate(expression, {**given, **own, **known}))

    for name in ("type", "vars", "issubclass"):  # they reach classes and their attributes
        xacro._global_symbols["python"].pop(name, None)
    xacro.safe_eval, substitution_args._eval, substitution_args._eval_find = evaluate, substitute, find


def _expand(path: str, package_dirs: Sequence[str], scratch: str) -> str:
    import io
    import json

    import xacro
    from xacrodoc import XacroDoc

    strict, packages = _beside("xacro_strict"), _beside("ros_packages")
    with open(os.path.join(scratch, ARGUMENTS), encoding="utf-8") as stream:
        arguments = strict.Arguments(json.load(stream))
    named = filter(os.path.isfile, filter(os.path.isabs, arguments.values()))  # by the caller, not by the description
    folders = [os.path.dirname(os.path.abspath(path)), *package_dirs, *named]
    xacro.parse = strict.strict_parser(arguments)
    xacro.abs_filename_spec = strict.strict_names(xacro.abs_filename_spec, packages.absent_package)
    _restrict_expressions(packages.package_finder(path, package_dirs, folders.append))
    _limit()
    _guard(folders)
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        try:
            text = str(XacroDoc.from_file(path, resolve_packages=False, subargs=arguments).dom.toxml())
        except (Exception, SystemExit) as error:
            raise arguments.explain(error) from None
    arguments.check()
    return text


def _beside(name: str) -> Any:
    """Module of this folder; the script has no package."""
    from importlib.util import module_from_spec, spec_from_file_location

    found = spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert found is not None and found.loader is not None, "it is a file of signid"
    module = module_from_spec(found)
    found.loader.exec_module(module)
    return module


def _compile(scratch: str) -> str:
    """Bodies, joints, joint constraints and gravity of `model.xml` in `scratch`, compiled by MuJoCo, as JSON."""
    import json

    import mujoco

    _limit()
    spec = mujoco.MjSpec.from_file(os.path.join(scratch, COMPILED))
    spec.compiler.usethread = False
    model = spec.compile()
    off = {name: bool(model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in _FLAGS}
    bodies = [
        {
            **{key: getattr(model, f"body_{key}")[i].tolist() for key in _BODY},
            "name": model.body(i).name,
            "parent": int(model.body_parentid[i]),
        }
        for i in range(1, model.nbody)
    ]
    ties = [i for i in range(model.neq) if model.eq_active0[i]]
    medium = [model.opt.density, model.opt.viscosity, *model.opt.wind]
    found = {
        "gravity": [0.0] * 3 if off["GRAVITY"] else model.opt.gravity.tolist(),
        "medium": any(medium),
        "bodies": bodies,
        "joints": [_joint(model, i, off) for i in range(model.njnt)],
        "ties": [[int(model.eq_obj1id[i]), int(model.eq_obj2id[i]), model.eq_data[i, :5].tolist()] for i in ties],
    }
    return json.dumps(found)


def _joint(model: Any, i: int, off: dict[str, bool]) -> dict[str, Any]:
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

    The reason goes to standard error; it is a sentence of its own if the exit code is SENTENCE. `path` is empty for
    MJCF. The values of xacro's arguments are in ARGUMENTS, in `scratch`.
    """
    try:
        result = _expand(path, package_dirs, scratch) if path else _compile(scratch)
        sys.stdout.buffer.write(result.encode())
    except (Exception, SystemExit) as error:  # expressions in the file may raise anything
        reason = "it needs too much memory" if isinstance(error, MemoryError) else " ".join(str(error).split())
        sys.stderr.buffer.write((reason or type(error).__name__).encode("utf-8", "replace"))
        sys.exit(SENTENCE if type(error).__name__ == "Sentence" else 1)


if __name__ == "__main__":
    _main(*sys.argv[1:])
