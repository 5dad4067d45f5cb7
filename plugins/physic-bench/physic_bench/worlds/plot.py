"""Plots of the ablation and of the calibration of contact probabilities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_bench.worlds.contact_partners import BINS
from physic_bench.worlds.paper_results import PAPER_RESULTS
from physic_bench.worlds.tables import main_row
from physic_core.errors import PhysicError
from physic_core.files.own import MARK

if TYPE_CHECKING:
    from physic_bench.worlds.results import Results
    from physic_bench.worlds.summary import RowStatistics

_OURS, _START, _PAPER_COLUMNS = "#1f5a8c", "#8a8a8a", "#c2703d"
_PANELS = (("pa_mpjpe_mm", "PA-MPJPE, mm"), ("mpjpe_mm", "MPJPE, mm"), ("f1_of_means", "contact F1"))
_ACTION_PANELS = (
    ("pa_mpjpe_mm", "PA-MPJPE, mm"),
    ("hidden_limbs_pa_mm", "hidden limbs, mm"),
    ("mpjpe_mm", "MPJPE, mm"),
)


def draw_plot(results: Results, path: Path) -> Path:
    """Write the plot to a file; its suffix selects the format: .png, .svg or .pdf.

    Raises:
        PhysicError: matplotlib is not installed.
    """
    labels = {key: row["label"] for key, row in results.document["settings"]["rows"].items()}
    actions = results.document["actions"]
    key = main_row(list(labels))
    heights = [0.34 * len(labels) + 1.0]
    if key is not None:
        heights.append(0.25 * len(actions) + 1.0)
    figure = _figure(11, sum(heights))
    upper, *lower = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    _rows_part(upper, results.figures, labels, _subtitle(results.document))
    if key is not None:
        _actions_part(lower[0], actions, key, labels[key])
    figure.savefig(path, dpi=150, metadata={"Title": MARK})
    return path


def draw_reliability(results: Results, path: Path) -> Path | None:
    """Write the reliability diagram of the main row; None without contact probabilities.

    The points are the share of vertices in contact per bin of the estimated probability, those of a calibrated
    estimate are on the diagonal. The bars are the number of vertices per bin.

    Raises:
        PhysicError: matplotlib is not installed.
    """
    key = main_row(list(results.figures))
    if key is None or not results.figures[key].reliability.any():
        return None
    row = results.figures[key]
    count, likely, true = row.reliability[row.reliability[:, 0] > 0].T
    figure = _figure(5, 6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
    upper.plot([0, 1], [0, 1], color="#c8c8c8", linewidth=1)
    upper.plot(likely / count, true / count, "o-", color=_OURS, linewidth=2, markersize=6)
    upper.set(xlim=(0, 1), ylim=(0, 1), ylabel="share of the vertices in contact")
    lower.bar(likely / count, count, width=0.6 / BINS, color=_OURS)
    lower.set(yscale="log", xlabel="estimated probability of contact", ylabel="vertices")
    figure.suptitle(f"Calibration: ECE {row.figures['ece'].value:.3f}\n{_subtitle(results.document)}", fontsize=10)
    figure.savefig(path, dpi=150, metadata={"Title": MARK})
    return path


def _figure(width: float, height: float) -> Any:
    """Return an empty figure, size in inches.

    Raises:
        PhysicError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise PhysicError(
            f"the plot needs {error.name}: `pip install -e 'plugins/physic-bench[plot]'` in a checkout of PhySIC"
        ) from error
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _rows_part(part: Any, rows: Mapping[str, RowStatistics], labels: Mapping[str, str], subtitle: str) -> None:
    """Plot the rows with their intervals and the paper's numbers."""
    axes = part.subplots(1, len(_PANELS), sharey=True)
    places = list(range(len(rows)))
    for axis, (name, title) in zip(axes, _PANELS, strict=True):
        for place, (key, row) in enumerate(rows.items()):
            found = row.figures[name]
            if math.isfinite(found.value):
                colour = _START if key == "start" else _OURS
                axis.plot([found.low, found.high], [place, place], color=colour, linewidth=2, solid_capstyle="butt")
                axis.plot(found.value, place, "o", color=colour, markersize=6)
            printed = getattr(PAPER_RESULTS.get(key), name, None)
            if printed is not None:
                axis.plot(printed, place, "D", color=_PAPER_COLUMNS, markerfacecolor="none", markersize=6)
        _tidy(axis, title, places, [labels[key] for key in rows])
    axes[0].plot([], [], "o-", color=_OURS, linewidth=2, label="here, 95 % interval")
    axes[0].plot([], [], "D", color=_PAPER_COLUMNS, markerfacecolor="none", label="the paper, on PROX")
    part.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    part.suptitle(f"Ablation: {subtitle}", x=0.01, ha="left", fontsize=11, fontweight="bold")


def _actions_part(part: Any, actions: Mapping[str, Mapping[str, Mapping[str, Any]]], key: str, label: str) -> None:
    """Plot the start row and the main row by action."""
    axes = part.subplots(1, len(_ACTION_PANELS), sharey=True)
    names = sorted(actions)
    for axis, (name, title) in zip(axes, _ACTION_PANELS, strict=True):
        for place, action in enumerate(names):
            end, start = (_value(actions[action].get(row, {}).get(name)) for row in (key, "start"))
            if start is not None and end is not None and name != "mpjpe_mm":
                axis.plot([start, end], [place, place], color="#c8c8c8", linewidth=2, zorder=1)
                axis.plot(start, place, "o", color=_START, markerfacecolor="white", markersize=5)
            if end is not None:
                axis.plot(end, place, "o", color=_OURS, markersize=5)
        counts = [next(iter(actions[action].values()))["people"] for action in names]
        _tidy(axis, title, list(range(len(names))), [f"{n} ({c})" for n, c in zip(names, counts, strict=True)])
    axes[0].plot([], [], "o", color=_START, markerfacecolor="white", label="start")
    axes[0].plot([], [], "o", color=_OURS, label=label)
    part.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    part.suptitle("By action (people)", x=0.01, ha="left", fontsize=11, fontweight="bold")


def _tidy(axis: Any, title: str, places: Sequence[int], labels: Sequence[str]) -> None:
    """Set title, labels, limits and grid of an axis."""
    axis.set_title(title, fontsize=10, loc="left")
    axis.set_yticks(places, labels, fontsize=9)
    axis.set_ylim(len(places) - 0.4, -0.6)
    farthest = float(axis.dataLim.xmax)
    axis.set_xlim(0, 1.06 * farthest if 0 < farthest < math.inf else 1)  # infinite where nothing is drawn
    axis.tick_params(axis="x", labelsize=8)
    axis.tick_params(axis="y", length=0)
    axis.grid(axis="x", color="#e6e6e6", linewidth=0.8)
    axis.set_axisbelow(True)
    for side in ("top", "right", "left"):
        axis.spines[side].set_visible(False)


def _subtitle(document: Mapping[str, Any]) -> str:
    """Return worlds, seed, size and preset of a run as text."""
    settings = document["settings"]
    size = "{} x {} px".format(*settings["size"])
    return f"{document['worlds_done']} worlds of seed {settings['seed']}, {size}, preset {settings['preset']}"


def _value(number: Any) -> float | None:
    """Return a finite number as float, else None."""
    return float(number) if isinstance(number, (int, float)) and math.isfinite(number) else None
