"""Figures of results by name: the plots of report.html, composed into one Plotly figure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...errors import OptionError, shorten
from .series import held_out_course

if TYPE_CHECKING:
    from ...signs import Signs
    from ..report.sections import JointPlots, Plot

    Plots = Sequence[Plot]
    Maker = Callable[[Any, Sequence[str]], Plots]


def figure(result: Any, name: str | None = None, joint: str | None = None) -> Any:
    """Return a figure of a result by name, of one joint or all; None: the first figure.

    Raises:
        OptionError: the result has no such figure or joint, or no figure at all.
    """
    from .compose import compose

    kind, known = type(result).__name__, figure_names(result)
    if not known:
        raise OptionError(f"{kind} has no figures; its tables are given by to_frame()")
    name = known[0] if name is None else name
    if name not in known:
        raise OptionError(f"{kind} has no figure {name!r}; choose from {', '.join(known)}")
    joints = _joints(result)
    if joint is not None and joint not in joints:
        raise OptionError(f"{kind} has no joint {joint!r}; choose from {shorten(joints)}")
    plots = FIGURES[kind][name](result, [joint] if joint else joints)
    if not plots:
        raise OptionError(f"{kind} has nothing to draw as {name} here: no such data was recorded or simulated")
    short = max(map(len, joints), default=0) <= LONGEST
    return compose(plots, 2 if name in GRIDS and short else 1)


def figure_names(result: Any) -> tuple[str, ...]:
    """Names of the figures of a result; signs only where some were recovered."""
    signed = not hasattr(result, "signs") or result.signs is not None
    return tuple(name for name in FIGURES.get(type(result).__name__, ()) if signed or name != "signs")


def _joints(result: Any) -> tuple[str, ...]:
    if hasattr(result, "models"):
        return tuple(dict.fromkeys(joint for one in result.models for joint in one.fit.joints))
    owner = next((getattr(result, key) for key in ("robot", "trajectory", "rollout") if hasattr(result, key)), result)
    return tuple(owner.joints)


def _of(found: Iterable[JointPlots], joints: Sequence[str], part: slice) -> Plots:
    return [plot for one in found if one.name in joints for plot in one.plots[part]]


def _torque(part: slice) -> Maker:
    """Plots of each joint of the report: torque and residual on what was held out, before and after."""

    def made(result: Any, joints: Sequence[str]) -> Plots:
        from ..report.documents import rms
        from ..report.plots.courses import joint_plots

        course = held_out_course(result)
        after = result.after if hasattr(result, "after") else result.fit
        return _of(joint_plots(course, replace(after, held_out_rms=rms(course.before)), after, ()), joints, part)

    return made


def _heat(after: bool) -> Maker:
    def made(result: Any, joints: Sequence[str]) -> Plots:
        from ..report.results.diagnosis import residual_maps

        before, extended, _ = residual_maps(result)
        return extended if after else before

    return made


def _rollouts(result: Any, joints: Sequence[str]) -> Plots:
    from ..report.plots.courses import rollout_plots
    from ..report.plots.frame import AFTER, BEFORE

    if hasattr(result, "rollout_before"):
        runs = [("before", result.rollout_before, BEFORE, "dot"), ("after", result.rollout_after, AFTER, "solid")]
    else:
        runs = [("simulation", result, AFTER, "solid")]
    return [plot for plot in rollout_plots([run for run in runs if run[1] is not None]) if plot.name in joints]


def _signs(result: Any, joints: Sequence[str]) -> Plots:
    from ..report.layout import torque_units
    from ..report.results.signs import sign_plots

    signs: Signs = getattr(result, "signs", result)
    parts = sign_plots(signs, torque_units(result.robot) if signs is not result else ())
    return [
        plot._replace(name=f"{plot.name}, {part}") if len(parts) > 1 else plot
        for part, plots in parts.items()
        for plot in plots
        if plot.name in joints
    ]


def _validated(result: Any, joints: Sequence[str]) -> Plots:
    from ..report.results.validation import validated_plots

    return _of(validated_plots(result), joints, slice(None))


def _validated_rollouts(result: Any, joints: Sequence[str]) -> Plots:
    from ..report.results.validation import validated_rollouts

    return [plot for plot in validated_rollouts(result) if plot.name in joints]


def _positions(result: Any, joints: Sequence[str]) -> Plots:
    from ..report.plots.courses import closed_loop_plots

    return _of(closed_loop_plots(result.traces, result.rollout), joints, slice(None))


def _friction(result: Any, joints: Sequence[str]) -> Plots:
    from ..report.plots.friction import friction_plots

    return friction_plots(result, joints)


def _correlation(result: Any, joints: Sequence[str]) -> Plots:
    from ..report.plots.heat import correlation_plot

    return [correlation_plot(result.estimate.covariance)]


def _excitation(result: Any, joints: Sequence[str]) -> Plots:
    from ..report.plots.heat import excitation_plot

    return [excitation_plot(result.excitation)]


def _samples(recording: Any, joints: Sequence[str]) -> Plots:
    from ..report.plots.courses import recording_plots

    return recording_plots(recording, joints)


LONGEST = 12  # characters of a joint name from which on plots do not stand side by side
GRIDS = ("heat_maps", "heat_maps_after")
FIGURES: dict[str, dict[str, Maker]] = {
    "Check": {"signs": _signs, "excitation": _excitation},
    "Diagnosis": {
        "residuals": _torque(slice(1)),
        "residuals_by_state": _torque(slice(1, None)),
        "heat_maps": _heat(False),
        "heat_maps_after": _heat(True),
        "rollouts": _rollouts,
        "signs": _signs,
    },
    "Identification": {
        "residuals": _torque(slice(1)),
        "residuals_by_state": _torque(slice(1, None)),
        "correlation": _correlation,
        "excitation": _excitation,
        "signs": _signs,
    },
    "Recording": {"samples": _samples},
    "RollOut": {"rollouts": _rollouts},
    "ServoIdentification": {"positions": _positions, "friction": _friction},
    "ServoValidatedModel": {"positions": _positions},
    "Signs": {"signs": _signs},
    "Validation": {"residuals": _validated, "rollouts": _validated_rollouts},
}
