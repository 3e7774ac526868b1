"""Plots over time and against the state, and heat maps: torque, positions, residuals, roll-outs and correlations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...estimation.excitation import MIN_INFO, ExcitationVerdict
from ...estimation.fit_quality import Course, Fit
from ...model import Model, stated_inertials, stated_laws
from ...recording.sampling import split
from ...recording.sampling.clock import CHUNK
from ...regression.session import Part, Session
from ...types import Array, Indices, Recording
from .layout import determination, figure, plot_markup, thousandths
from .pages import BLUE, GREEN, GREY, ORANGE, axis, curve, packed, thinned
from .sections import INK, Folds, JointPlots, Key, Plot

if TYPE_CHECKING:
    from ...servo.identify import ServoRollOut, ServoTrace
    from ...simulation.rollout import RollOut
    from ...validate import ValidatedModel

MAX_POINTS, MAX_DOTS = 16_000, 9_000  # total number of points of lines and of scatter plots
MIN_POINTS = 150  # minimum number of points per line
MAX_CURVED_ROWS = 1000  # number of low-passed rows up to which a curve is drawn through them, instead of straight lines
SCATTER_MEANS = 24  # number of means per scatter plot
MAX_DRAWN_SAMPLES, ENOUGH_SAMPLES = 400_000, 20_000  # most samples, and number from which no further part is drawn
ROLLOUT_POINTS = 60  # maximum number of points per line of a roll-out
MAX_OPEN = 3  # maximum number of unfolded joints
PANE_SHARE, PANE_GAP = 0.42, 0.06  # share of a plot taken by the residual, and half of the gap above it
DRAWN_ERROR_RATIO = 6.0  # largest drawn position error, as a multiple of the largest error of the identified loop
MAX_SHOWN_STAMP = 1e5  # [s] stamps beyond, as those since 1970, are shown after their first whole second
MAX_TRACES = 4  # maximum number of recordings that are drawn
LOOP_LEGEND = (
    "The robot starts at the measured state and follows the commands alone. Error is measured - simulated position."
)
LINE_HOVER = "$name: %{y:.5g} $unit at %{x:.5g} s<extra></extra>"
REGIONS, MIN_REGION_ROWS = 10, 3  # regions per variable, and minimum number of rows per region
HEAT_COLOURS = [[0, "rgba(209,80,14,0)"], [1, "rgba(209,80,14,1)"]]
MIN_TIED_CORRELATION = 0.95  # absolute correlation from which parameters are listed
MAX_DRAWN_PARAMETERS = 160  # maximum number of correlated parameters drawn
CORRELATION_COLOURS = [[0, "rgba(209,112,14,1)"], [0.5, "rgba(128,128,128,0)"], [1, "rgba(47,127,193,1)"]]
REGION_HOVER = "%{customdata[0]}: %{customdata[1]} times what no model could predict<extra></extra>"
MAX_LABEL_LENGTH = 16  # maximum length of the label of a joint [characters]
ROW_HEIGHT, AXIS_HEIGHT = 26, 62  # height of a row, and of the axis below [pixels]


class Line(NamedTuple):
    """A line of a plot over time."""

    name: str
    axis: str  # "y": upper pane, "y2": lower pane
    colour: str
    style: dict[str, Any]
    values: Array  # (M,) [unit of its pane]


class Panes(NamedTuple):
    """Two panes of a plot over time, one above the other."""

    upper: str  # quantity
    lower: str
    units: tuple[str, str]
    share: float = PANE_SHARE  # of the height, for the lower pane [1]
    height: int = 360  # [pixels]
    time: str = "time [s]"

    def plot(self, title: str, t: Array, lines: Sequence[Line], **lower: Any) -> Plot:
        """Plot lines over t: (M,) [s]; `lower`: further properties of the lower axis."""
        x, data = packed(t), []
        for line in lines:
            hover = plot_markup(LINE_HOVER, name=line.name, unit=self.units[line.axis == "y2"])
            style = {"color": line.colour, **line.style}
            data.append({**curve(line.name, x, packed(line.values), style, hovertemplate=hover), "yaxis": line.axis})
        zero = {"zeroline": True, "zerolinecolor": GREY}
        layout = {
            "xaxis": axis(self.time, anchor="y2"),
            "yaxis": axis(f"{self.upper} [{self.units[0]}]", domain=[self.share + PANE_GAP, 1], nticks=6),
            "yaxis2": axis(
                f"{self.lower} [{self.units[1]}]", domain=[0, self.share - PANE_GAP], nticks=5, **{**zero, **lower}
            ),
        }
        return Plot(title, data, layout, self.height, wide=True)


def joint_plots(course: Course, before: Fit, after: Fit, chosen: Sequence[int]) -> list[JointPlots]:
    """Plot torque over time, and the residual against velocity, position and load; unfold the first chosen joints."""
    shown, plots_of_joints = [*dict.fromkeys(chosen)][:MAX_OPEN], []
    for j, joint in enumerate(course.joints):
        rms = (float(fit.held_out_rms[j]) for fit in (before, after))
        summary = " → ".join(map(figure, rms)) + f" {course.unit[j]}, R2 {determination(float(after.held_out_r2[j]))}"
        plots = tuple(_plots(course, j)) if np.isfinite(course.torque[:, j]).any() else ()
        plots_of_joints.append(JointPlots(joint, summary, j in shown, plots))
    return plots_of_joints


def _plots(course: Course, j: int) -> Iterator[Plot]:
    unit, length = course.unit[j], "m" if course.prismatic[j] else "rad"
    measured, left = course.torque[:, j], (course.before[:, j], course.after[:, j])
    lines = (
        Line("measured", "y", INK, {"width": 1.6}, measured),
        Line("predicted before", "y", ORANGE, {"width": 1.4, "dash": "dot"}, measured - left[0]),
        Line("predicted after", "y", BLUE, {"width": 1.4}, measured - left[1]),
        Line("residual before", "y2", ORANGE, {"width": 1.2, "dash": "dot"}, left[0]),
        Line("residual after", "y2", BLUE, {"width": 1.2}, left[1]),
    )
    yield torque_plot(course.joints[j], course, unit, lines, line_points(len(course.joints)))
    yield _against(course, j, f"velocity [{length}/s]", course.v[:, j], unit)
    yield _against(course, j, f"position [{length}]", course.q[:, j], unit)
    yield _against(course, j, f"load: predicted torque [{unit}]", measured - left[0], unit)


def torque_plot(joint: str, rows: Course | ValidatedModel, unit: str, lines: Sequence[Line], max_points: int) -> Plot:
    """Plot low-passed torque over the time of some rows, with residuals below; few rows are joined by a spline."""
    if len(rows.t) <= min(MAX_CURVED_ROWS, max_points):
        lines = [line._replace(style={**line.style, "shape": "spline"}) for line in lines]
    first = np.flatnonzero(np.diff(rows.stretch, prepend=rows.stretch[:1] - 1))
    t, lines = _thinned(clock(rows.t, rows.recording), lines, first, max_points)
    panes = Panes("torque", "residual", (unit, unit))
    return panes.plot(f"{joint}: torque over time, and measured - predicted", t, lines)


def _thinned(t: Array, lines: Sequence[Line], first: Indices, max_points: int) -> tuple[Array, list[Line]]:
    t, values = thinned(t, np.column_stack([line.values for line in lines]), first, max_points)
    return t, [line._replace(values=y) for line, y in zip(lines, values.T, strict=True)]


def recorded_lines(recording: Recording, max_points: int) -> tuple[Array, Array]:
    """Time (M,) [s] and position, torque and command (M, 3 n) [rad or m, N.m or N] of at most about `max_points` rows.

    Rows keep the extremes of their stretches; NaN where nothing is recorded. The recording is read in chunks.
    """
    rows, parts = max(1, len(recording)), []
    for start in range(0, len(recording), CHUNK):
        samples = recording.read(start, start + CHUNK, servo=False)
        command = np.full_like(samples.q, np.nan) if samples.q_des is None else samples.q_des
        lines = np.column_stack([samples.q, samples.tau, command])
        parts.append(thinned(samples.t, lines, np.zeros(1, dtype=np.intp), max(2, max_points * len(lines) // rows)))
    t, lines = (np.concatenate(pieces) for pieces in zip(*parts, strict=True))
    return t, lines


def _against(course: Course, j: int, title: str, x: Array, unit: str) -> Plot:
    """Plot the residuals against x, with their means over intervals of x."""
    step = -(-len(course) * len(course.joints) * 6 // MAX_DOTS)
    data = []
    for name, left, colour in (("before", course.before[:, j], ORANGE), ("after", course.after[:, j], BLUE)):
        known = np.isfinite(left) & np.isfinite(x)
        dots = {"type": "scatter", "mode": "markers", "hoverinfo": "skip", "marker": {"color": colour, "size": 3}}
        data.append({**dots, "opacity": 0.35, "x": packed(x[known][::step]), "y": packed(left[known][::step])})
        middle, mean = _means(x[known], left[known])
        hover = plot_markup("mean $name: %{y:.3g} $unit at %{x:.3g}<extra></extra>", name=name, unit=unit)
        line = {"color": colour, "width": 2.4, **({"dash": "dot"} if name == "before" else {})}
        means = {"type": "scatter", "mode": "lines", "line": line, "hovertemplate": hover, "name": name}
        data.append({**means, "x": packed(middle), "y": packed(mean)})
    layout = {"xaxis": axis(title, nticks=6), "yaxis": axis(f"residual [{unit}]", zeroline=True, zerolinecolor=GREY)}
    return Plot(f"against {title.partition(' [')[0].partition(':')[0]}", data, layout)


def _means(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of x and y over intervals of x with equal numbers of rows."""
    if not len(x):
        return x, y
    order = np.argsort(x, kind="stable")
    parts = np.array_split(order, min(SCATTER_MEANS, max(1, len(x) // 5)))
    return np.array([x[part].mean() for part in parts]), np.array([y[part].mean() for part in parts])


def line_points(lines: int, factor: int = 1) -> int:
    """Number of points per line, of `factor` times the total number of points."""
    return max(MIN_POINTS, factor * MAX_POINTS // lines)


def clock(t: Array, recording: Indices) -> Array:
    """Time of rows with several recordings in sequence, (M,) [s]; t: (M,) [s], recording: (M,) its number."""
    if not len(t) or recording[0] == recording[-1]:
        return np.asarray(t)
    parts = np.split(t, np.flatnonzero(np.diff(recording)) + 1)
    starts = np.cumsum([0.0, *(float(part[-1] - part[0]) for part in parts[:-1])])
    return np.concatenate([part - part[0] + start for part, start in zip(parts, starts, strict=True)])


def worst(before: Fit) -> list[int]:
    """Joints in descending order of held-out residual over what no model could predict."""
    over = np.nan_to_num(before.held_out_rms / np.maximum(before.irreducible_rms, 1e-300), posinf=0.0)
    return [int(j) for j in np.argsort(-over, kind="stable")]


def rollout_plots(rolled: Sequence[tuple[str, RollOut, str, str]]) -> list[Plot]:
    """Plot the rms error of roll-outs against the time since their start, per joint.

    Each model has a name, a roll-out, a colour and a dash; a plot shows the models that have its joint.
    """
    drawn: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for name, rollout, colour, dash in rolled:
        step = -(-len(rollout.t) // ROLLOUT_POINTS)
        kept = np.arange(len(rollout.t) - 1, -1, -step)[::-1]
        for j, key in enumerate(zip(rollout.joints, rollout.unit, strict=True)):
            error = np.sqrt(np.mean(rollout.error[:, kept, j] ** 2, axis=0))
            hover = plot_markup("$name: %{y:.3g} $unit after %{x:.3g} s<extra></extra>", name=name, unit=key[1])
            line = {"color": colour, "width": 2, "dash": dash}
            y = packed(np.where(np.isfinite(error), error, np.nan))
            drawn.setdefault(key, []).append(curve(name, packed(rollout.t[kept]), y, line, hovertemplate=hover))
    x = axis("time since the start [s]", rangemode="tozero", nticks=6)
    y_axes = {unit: axis(f"rms error [{unit}]", rangemode="tozero", nticks=6) for _, unit in drawn}
    return [Plot(joint, data, {"xaxis": x, "yaxis": y_axes[unit]}, 210) for (joint, unit), data in drawn.items()]


def worst_joints(rollout: ServoRollOut) -> list[int]:
    """Joints with commands in descending order of the error of whole recordings."""
    order = np.argsort(-np.nan_to_num(rollout.whole_rms, nan=-1.0, posinf=1e300), kind="stable")
    return [int(j) for j in order if not np.isnan(rollout.whole_rms[j])]


def closed_loop_plots(traces: Sequence[ServoTrace], rollout: ServoRollOut) -> Iterator[JointPlots]:
    """Positions over time per joint: whole recordings and windows of 1 s; the worst joints are unfolded."""
    order = worst_joints(rollout)
    drawn = traces[:MAX_TRACES]
    lines = 6 * max(1, len(drawn)) * 2
    most = line_points(lines * max(1, len(order)), 6)
    for j in order:
        joint, unit = rollout.joints[j], rollout.units[j]
        plots = [plot for trace in drawn if joint in trace.joints for plot in _loop_plots(trace, joint, unit, most)]
        sizes = (rollout.nominal_whole_rms[j], rollout.whole_rms[j])
        summary = " → ".join(thousandths(float(rms)) for rms in sizes)
        yield JointPlots(joint, f"{summary} m{unit} rms, whole recordings", j in order[:MAX_OPEN], tuple(plots))


def loop_blocks(
    traces: Sequence[ServoTrace], found: ServoRollOut, before: str, after: str
) -> tuple[Key, Folds] | tuple[()]:
    """Key and plots of closed loops for a page; `before` and `after`: names of the simulations."""
    joints = list(closed_loop_plots(traces, found))
    marks = [
        ("floor", "command"),
        ("measured", "measured"),
        ("before", f"before: {before}"),
        ("after", f"after: {after}"),
    ]
    note = LOOP_LEGEND + (" The first recordings only." if len(traces) > MAX_TRACES else "")
    return (Key(marks), Folds(note, joints)) if joints else ()


def _loop_plots(trace: ServoTrace, joint: str, unit: str, max_points: int) -> Iterator[Plot]:
    j = trace.joints.index(joint)
    measured, nominal = trace.measured[:, j], trace.nominal[:, j]
    first = [
        Line("command", "y", GREEN, {"width": 1.2, "dash": "dash", "shape": "hv"}, trace.command[:, j]),
        Line("measured", "y", INK, {"width": 1.6}, measured),
    ]
    before = [Line("measured - before", "y2", ORANGE, {"width": 1.2, "dash": "dot"}, measured - nominal)]
    if not np.array_equal(nominal, trace.command[:, j], equal_nan=True):
        before.append(Line("before", "y", ORANGE, {"width": 1.3, "dash": "dot"}, nominal))
    title = f"{joint}, {trace.path.rpartition('/')[2] or 'recording'}"
    whole = [*first, *before, *_simulated(measured, trace.simulated[:, j])]
    yield _positions(f"{title}: whole recording from commands alone", trace.t, unit, whole, max_points)
    if trace.one_second is not None:
        short = [*first, *_simulated(measured, trace.one_second[:, j])]
        yield _positions(f"{title}: restarted from the measured state every second", trace.t, unit, short, max_points)


def _simulated(measured: Array, simulated: Array) -> list[Line]:
    return [
        Line("identified", "y", BLUE, {"width": 1.4}, simulated),
        Line("measured - identified", "y2", BLUE, {"width": 1.2}, measured - simulated),
    ]


def _positions(title: str, t: Array, unit: str, lines: Sequence[Line], max_points: int) -> Plot:
    """Plot positions over the time of the recording, with errors below."""
    origin = float(np.floor(t[0])) if len(t) and t[0] > MAX_SHOWN_STAMP else 0.0
    clock = f"time after {origin:.0f} s [s]" if origin else "time of the recording [s]"
    lines = [line._replace(values=np.where(np.isfinite(line.values), line.values, np.nan)) for line in lines]
    t, lines = _thinned(t - origin, lines, np.zeros(1, dtype=np.intp), max_points)
    errors = {line.name: float(np.nanmax(np.abs(line.values), initial=0.0)) for line in lines}
    span = DRAWN_ERROR_RATIO * errors["measured - identified"]
    cut = {"range": [-span, span]} if 0 < span < errors.get("measured - before", 0.0) else {}
    return Panes("position", "error", (unit, unit), time=clock).plot(title, t, lines, **cut)


def held_out_rows(session: Session, after: Model) -> tuple[Course, bool]:
    """Residuals of the description and the model on held-out data or its beginning; whether that is all of it."""
    from ...diagnose.holdout import course_of, residual_rows

    parts = list(_beginning(session.held_out))
    stated = Model(session.robot, stated_inertials(session.robot), stated_laws(session.robot))
    before, identified = (residual_rows(session.task, model, parts, keep=False) for model in (stated, after))
    return course_of(before, identified, session.robot), _samples(parts) == _samples(session.held_out)


def _beginning(parts: Sequence[Part]) -> Iterator[Part]:
    """Yield recordings until there are enough samples, the last one in part."""
    left = MAX_DRAWN_SAMPLES
    for part in parts:
        count, (recording, sampling) = _samples([part]), part
        if count > left:
            yield recording, split(sampling, left / count)[0]
            return
        yield part
        left -= count
        if left < ENOUGH_SAMPLES:
            return


def _samples(parts: Sequence[Part]) -> int:
    return sum(sampling.length(span) for _, sampling in parts for span in sampling.spans)


class Variable(NamedTuple):
    """A variable that torque may depend on, in regions per joint."""

    name: str
    title: str  # of the axis
    values: Array  # (M, n) [unit of each joint]
    edges: Array  # (n, REGIONS + 1) [unit of each joint]
    units: tuple[str, ...]  # n


def heat_maps(course: Course, over: Array, top: float) -> list[Plot]:
    """Plot ratios over: (M, n) [1], joint by region of state and time; the colour saturates at `top` [1]."""
    maps, joints = [], course.joints
    ticks = {"tickmode": "array", "tickvals": list(joints), "ticktext": short_names(joints)}
    names = axis("", autorange="reversed", showgrid=False, type="category", **ticks)
    shares = {"velocity": (-100.0, 100.0), "position": (0.0, 100.0), "load": (-100.0, 100.0)}
    for variable in _variables(course):
        table, name, edges = _rms(over, variable), variable.name, variable.edges
        low, high = shares.get(name, (float(edges[0, 0]), float(edges[0, -1])))
        rows = [zip(pairwise(ends), sizes, strict=True) for ends, sizes in zip(edges, table, strict=True)]
        cells = [
            [[f"{joint}, {name} {a:.3g} to {b:.3g} {unit}", f"{value:.3g}"] for (a, b), value in row]
            for joint, row, unit in zip(joints, rows, variable.units, strict=True)
        ]
        data = {
            "type": "heatmap",
            "x": np.linspace(low, high, REGIONS + 1).tolist(),
            "y": list(joints),
            "z": packed(np.log10(np.maximum(table, 1.0))),
            "customdata": cells,
            "zmin": 0,
            "zmax": float(np.log10(top)),
            "colorscale": HEAT_COLOURS,
            "showscale": False,
            "xgap": 1,
            "ygap": 1,
            "hoverongaps": False,
            "hovertemplate": plot_markup(REGION_HOVER),
        }
        layout = {"xaxis": axis(variable.title, showgrid=False), "yaxis": names}
        maps.append(Plot(name, [data], layout, ROW_HEIGHT * len(joints) + AXIS_HEIGHT))
    return maps


def hottest(course: Course, over: Array) -> float:
    """Return the largest ratio in such maps of the ratios over: (M, n) [1], at least 3 [1]."""
    sizes = [_rms(over, variable) for variable in _variables(course)]
    return max(3.0, *(float(np.nanmax(size, initial=0.0)) for size in sizes))


def _variables(course: Course) -> Iterator[Variable]:
    length = ["m" if prismatic else "rad" for prismatic in course.prismatic]
    speed, load = np.abs(course.v).max(axis=0), course.torque - course.before
    largest, share = np.nanmax(np.abs(load), axis=0, initial=0.0), np.linspace(-1, 1, REGIONS + 1)
    speeds = tuple(f"{x}/s" for x in length)
    yield Variable("velocity", "velocity [% of max]", course.v, np.outer(speed, share), speeds)
    low, high = course.q.min(axis=0), course.q.max(axis=0)
    edges = np.linspace(low, high, REGIONS + 1).T
    yield Variable("position", "q [% of range]", course.q, edges, tuple(length))
    yield Variable("load", "load [% of max]", load, np.outer(largest, share), course.unit)
    t, n = clock(course.t, course.recording), len(course.joints)
    edges = np.tile(np.linspace(t[0], t[-1], REGIONS + 1), (n, 1))
    yield Variable("time", "time [s]", np.tile(t[:, None], (1, n)), edges, ("s",) * n)


def _rms(over: Array, variable: Variable) -> Array:
    """Rms of each region, (n, BINS) [1]; NaN if it has too few rows."""
    edges = variable.edges
    low, width = edges[:, 0], np.maximum((edges[:, -1] - edges[:, 0]) / REGIONS, 1e-300)
    place = np.clip(np.nan_to_num((variable.values - low) / width, nan=0.0), 0, REGIONS - 1).astype(int)
    table = np.full((over.shape[1], REGIONS), np.nan)
    for row, size, region in zip(table, over.T, place.T, strict=True):
        known = np.isfinite(size)
        rows = np.bincount(region[known], minlength=REGIONS)
        squares = np.bincount(region[known], size[known] ** 2, minlength=REGIONS)
        enough = rows >= MIN_REGION_ROWS
        row[enough] = np.sqrt(squares[enough] / rows[enough])
    return table


def short_names(names: Sequence[str], most: int = MAX_LABEL_LENGTH) -> list[str]:
    """Names short enough for labels, all different: without common words, else without their middle, else numbered.

    >>> short_names(["left_hip_roll_actuator_joint", "left_knee_pitch_actuator_joint"])
    ['left_hip_roll', 'left_knee_pitch']
    """
    if all(len(name) <= most for name in names):
        return list(names)
    words = [name.split("_") for name in names]
    end = 0
    while len(names) > 1 and all(len(parts) > end + 1 and parts[-end - 1] == words[0][-end - 1] for parts in words):
        end += 1
    short = ["_".join(parts[: len(parts) - end]) for parts in words]
    half = (most - 1) // 2
    short = [name if len(name) <= most else f"{name[:half]}…{name[-half:]}" for name in short]
    return short if len(set(short)) == len(short) else [f"{k + 1} {name[: most - 4]}" for k, name in enumerate(short)]


def correlation_plot(covariance: Array) -> Plot:
    """Plot the correlations of base parameters, numbered from 1; covariance: (b, b) [units of base]."""
    correlations = _correlations(covariance)[:MAX_DRAWN_PARAMETERS, :MAX_DRAWN_PARAMETERS]
    number = list(range(1, len(correlations) + 1))
    data = {
        "type": "heatmap",
        "x": number,
        "y": number,
        "z": packed(correlations),
        "zmin": -1,
        "zmax": 1,
        "colorscale": CORRELATION_COLOURS,
        "colorbar": {"title": {"text": "correlation [1]", "side": "right"}, "thickness": 12, "outlinewidth": 0},
        "hovertemplate": plot_markup("%{x} and %{y}: correlation %{z:.3f}<extra></extra>"),
        "hoverongaps": False,
    }
    title, size = "number of the base parameter [1]", {"showgrid": False, "nticks": 12}
    layout = {"xaxis": axis(title, **size), "yaxis": axis(title, autorange="reversed", **size)}
    return Plot("Correlation of the parameter errors", [data], layout, 420)


def _correlations(covariance: Array) -> Array:
    """Correlation matrix, (b, b) [1]; NaN if a variance is unknown."""
    std = np.sqrt(np.diag(covariance))
    with np.errstate(all="ignore"):
        return np.asarray(np.where(np.isfinite(covariance), covariance / np.outer(std, std), np.nan))


def tied(covariance: Array) -> list[tuple[int, int, float]]:
    """List pairs of parameters with strongly correlated errors, the strongest first; covariance: (b, b) [any unit]."""
    correlations = np.triu(np.nan_to_num(_correlations(covariance)), 1)
    rows, columns = np.nonzero(np.abs(correlations) >= MIN_TIED_CORRELATION)
    pairs = [(int(i), int(k), float(correlations[i, k])) for i, k in zip(rows, columns, strict=True)]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))


def excitation_plot(excitation: ExcitationVerdict) -> Plot:
    """Plot the share of information per direction, ascending, and the required share."""
    shares = np.maximum(excitation.shares, 1e-6)
    number = np.arange(1.0, len(shares) + 1)
    bars = {
        "type": "bar",
        "x": packed(number),
        "y": packed(100 * shares),
        "marker": {"color": BLUE},
        "hovertemplate": plot_markup("direction %{x}: %{y:.3g} %<extra></extra>"),
    }
    ends = [0.5, len(shares) + 0.5]
    line = {"type": "scatter", "mode": "lines", "x": ends, "y": [100 * MIN_INFO] * 2, "hoverinfo": "skip"}
    layout = {
        "xaxis": axis("direction, weakest first [1]"),
        "yaxis": axis("share of information [%]", type="log", tickformat="~g"),
    }
    dashed = {**line, "line": {"color": GREEN, "dash": "dash", "width": 2}}
    title = "Directions in parameter space: information relative to random motion; dashed: required"
    return Plot(title, [bars, dashed], layout, 260, wide=True)
