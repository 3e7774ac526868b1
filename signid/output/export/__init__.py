"""Export of models to other programs: URDF, MJCF, actuators.toml, Python, ROS 2, Isaac Lab, mjlab, C, controllers.

`Exported.flags`, `Exported.notes` and a comment in the file list the content that a format cannot hold; FORMATS is what
each holds. The Python function holds the laws that neither URDF nor MJCF can express, and needs only NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from ...errors import OptionError
from ...model import ModelSource, as_model
from ...recording import Recordings
from ...typed import typed
from .bodies import Exported, annotated, model_digest, with_comment
from .drives import with_known_numbers
from .formats import FORMATS, OF_TORQUE, VENDORS, left_out
from .urdf import urdf_with

__all__ = ["KINDS", "VENDORS", "Exported", "export", "urdf_with", "with_comment", "with_known_numbers"]

_MODULES = {  # below this folder, where `write_KIND` is not in a module of its own
    **dict.fromkeys(("ros", "isaaclab", "mjlab", "newton"), "actuators"),
    **dict.fromkeys(("c", "arrays"), "code.languages"),
    **dict.fromkeys(VENDORS, "vendor"),
}
KINDS = tuple(FORMATS)
STARTED_KINDS = ("mjcf", "isaaclab", "mjlab")  # loops that can start from a recording
CODE_FUNCTIONS = ("nonlinear", "forward", "jacobian", "payload", "observer")  # functions of C code on request


@typed
def export(
    model: ModelSource,
    kind: str,
    package_dirs: Sequence[str | Path] = (),
    *,
    name: str | None = None,
    floating: bool = False,
    meshes: str | None = None,
    start: Recordings | None = None,
    functions: Sequence[str] = (),
    link: str | None = None,
    flange: str | None = None,
    tool: str | None = None,
    beside: Sequence[str] = (),
) -> Exported:
    """Export a model; return the text of the file, and flags and notes on the content that the format cannot hold.

    >>> urdf = signid.export("3r", "urdf").text

    Args:
        model: rigid bodies and laws.
        kind: one of KINDS. "urdf": robot's URDF with inertials, damping and friction; "mjcf": for MuJoCo; "actuators":
            TOML file for use with a URDF; "function": laws as Python code that needs only NumPy; "ros": parameters of a
            ROS 2 node; "isaaclab", "mjlab", "newton": actuators; "c", "arrays": inverse dynamics as C99 (`beside` holds
            its header and a test program), or as Python over numpy, jax.numpy or torch; of the payload alone "franka"
            (JSON; `beside` has the numbers of libfranka), "ur" (URScript) and "kuka" (KRL).
        package_dirs: folders to search for meshes of an MJCF, besides those of example-robot-data.
        name: name of the C files without ".c"; default: the robot's name as an identifier.
        floating: whether the base link of an MJCF is a body on a free joint, with its mass.
        meshes: folder beside an MJCF that its meshes are read from; `meshes` of the result has the files to copy there.
            Default: they are read from their place.
        start: recording whose first state "mjcf", "isaaclab" and "mjlab" state, for position drives on a fixed base.
        functions: further functions of "c": "nonlinear" (h(q, v)), "forward" (accelerations at a torque), "jacobian"
            (of a link's frame), "payload" (torque of a body that is given at run time) and "observer" (residual torque,
            thresholds that it learns, and contacts, row by row).
        link: link whose frame Jacobian and payload have; default: the frame of the last joint.
        flange: link whose frame "franka", "ur" and "kuka" take as the flange. Default: link8 of Franka, tool0.
        tool: link whose frame they take as the tool. Default: none.
        beside: kinds of the files that are written with this one; a law that they hold is no flag.

    Raises:
        OptionError: the kind is unknown, a function, or the gain of a position drive; `start`, `functions` or `link` do
            not fit the kind or the model; the payload or flange of "franka", "ur" or "kuka" is not known.
        RecordingError: `start` cannot be used.
        RobotError: the format cannot hold the bodies of the model, the robot has no URDF, or a floating base no mass.
    """
    model = as_model(model, "export")
    if kind not in FORMATS:
        raise OptionError(f"there is no export to {kind!r}; choose from {', '.join(KINDS)}")
    if unwritten := [name for name in functions if name not in CODE_FUNCTIONS]:
        raise OptionError(f"C code has no further function {unwritten[0]!r}; choose from {', '.join(CODE_FUNCTIONS)}")
    if (functions or link is not None) and kind != "c":
        raise OptionError("further functions and their link belong to C code; export to 'c'")
    if link is not None and not {"jacobian", "payload"} & set(functions):
        raise OptionError(f"link {link!r} is that of a Jacobian or a payload; add the function jacobian or payload")
    code = {"digest": model_digest(model), "further": functions, "link": link} if kind == "c" else {}
    unknown: list[str] = []
    if model.servos and kind not in VENDORS:
        model, unknown = with_known_numbers(model, gain=kind not in (*OF_TORQUE, "urdf"))
    loop = None
    if start is not None:
        if kind not in STARTED_KINDS or floating:
            raise OptionError(
                f"a start belongs to {', '.join(STARTED_KINDS)} on a fixed base; leave `start` or `floating` out"
            )
        if not model.servos:
            raise OptionError(
                f"{model.robot.name} has no position drive that starts from a recording; give the model.json that "
                f"`signid identify` wrote from commands"
            )
        from .loop import loop_of, with_loop

        loop = loop_of(model, start)
        model = loop.written
    write = getattr(import_module(f"{__name__}.{_MODULES.get(kind, kind)}"), f"write_{kind}")
    more = {"mjcf": (package_dirs, floating, meshes), "c": (name,)}.get(kind, (flange, tool) if kind in VENDORS else ())
    made: Exported = write(model, *more, **code)
    made = with_loop(kind, made, loop) if loop else made
    if kind in VENDORS:
        return made
    flags, notes = left_out(model, kind, floating, beside)
    return annotated(kind, replace(made, flags=tuple(flags), notes=(*notes, *made.notes, *unknown)))
