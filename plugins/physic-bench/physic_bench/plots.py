"""Plots: error over distance, occlusion, truncation and action; precision and recall over the contact threshold."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_bench.intervals import figure
from physic_bench.metrics import columns_for
from physic_bench.scoring import CURVE_CM
from physic_core.errors import PackageMissingError

if TYPE_CHECKING:
    from physic_bench.tables import Tables

    Record = Mapping[str, Any]

DISTANCES_M = (0.0, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, math.inf)
SHARES = (0.0, 0.1, 0.3, 0.6, 1.01)
COUNT_BOX = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
COLORS = ("#1f5a8c", "#c2703d", "#4b8b57", "#8a4f9e", "#8a8a8a", "#b8434e")


def draw_plots(records: Sequence[Record], tables: Tables, path: Path) -> Path | None:
    """Write the plots that there is data for; return None if there is none.

    Raises:
        PackageMissingError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise PackageMissingError(
            f"{path.name} is not written, since {error.name} is not installed: "
            "`pip install -e 'plugins/physic-bench[plot]'` in a checkout of PhySIC"
        ) from error
    from physic_core.files.atomic import atomic_write
    from physic_core.files.own import MARK

    panels = _panels(records, tables)
    if not panels:
        return None
    page = Figure(figsize=(5.2 * len(panels), 3.8), layout="constrained")
    FigureCanvasAgg(page)
    axes = page.subplots(1, len(panels), squeeze=False)[0]
    for axis, panel in zip(axes, panels, strict=True):
        panel(axis)
    with atomic_write(path.parent) as temporary:
        page.savefig(temporary(path.name), dpi=130, format="png", metadata={"Comment": MARK})
    return path


def _panels(records: Sequence[Record], tables: Tables) -> list[Callable[[Any], None]]:
    key, title = ("me_mpjpe", "MPJPE, mm") if any("me_mpjpe" in r for r in records) else ("me_pve", "MPVPE, mm")
    panels: list[Callable[[Any], None]] = []
    if any(key in r for r in records):
        near = _binned(records, "distance_m", DISTANCES_M, lambda a, b: f"{a:g}+" if b == math.inf else f"{a:g}-{b:g}")
        panels.append(lambda axis: _bars(axis, near, tables, key, "distance from the camera, m", title))
        hidden = _binned(records, "occlusion", SHARES, _percent) or _labelled(records, "occlusion")
        if hidden:
            words = "share of the body in the picture that the scene hides"
            panels.append(lambda axis: _bars(axis, hidden, tables, key, words, title))
        cut = _binned(records, "truncation", SHARES, _percent)
        if any(r.get("truncation") for r in records):
            panels.append(lambda axis: _bars(axis, cut, tables, key, "share of the body outside the picture", title))
        actions = _labelled(records, "action") or _labelled(records, "posture")
        if actions:
            panels.append(lambda axis: _bars(axis, actions, tables, key, "action", title))
    if any(f"{cm:g} cm" in r["contact"] for r in records for cm in CURVE_CM):
        panels.append(lambda axis: _curve(axis, records, tables))
    return panels


def _percent(low: float, high: float) -> str:
    return f"{100 * low:.0f}-{min(100 * high, 100):.0f} %"


def _binned(
    records: Sequence[Record], key: str, edges: Sequence[float], name: Callable[[float, float], str]
) -> dict[str, list[Record]]:
    found: dict[str, list[Record]] = {}
    for low, high in pairwise(edges):
        own = [r for r in records if r.get(key) is not None and low <= r[key] < high]
        if own:
            found[name(low, high)] = own
    return found


def _labelled(records: Sequence[Record], key: str) -> dict[str, list[Record]]:
    names = sorted({r["labels"][key] for r in records if key in r["labels"]})
    return {name: [r for r in records if r["labels"].get(key) == name] for name in names}


def _bars(axis: Any, groups: Mapping[str, Sequence[Record]], tables: Tables, key: str, words: str, title: str) -> None:
    """Draw the mean of each group and method, with its interval and number of people."""
    column = next(c for c in columns_for(()) if c.key == key)
    width = 0.8 / len(tables.methods)
    for k, method in enumerate(tables.methods):
        figures = [figure([r for r in own if r["method"] == method], column) for own in groups.values()]
        places = [i - 0.4 + width * (k + 0.5) for i in range(len(groups))]
        values = [f.value for f in figures]
        spread = [
            [0.0 if math.isnan(f.low) else max(f.value - f.low, 0.0) for f in figures],
            [0.0 if math.isnan(f.high) else max(f.high - f.value, 0.0) for f in figures],
        ]
        axis.bar(places, values, width, color=COLORS[k % len(COLORS)], label=method, yerr=spread, capsize=2)
        for place, found in zip(places, figures, strict=True):
            where = {"xy": (place, 0), "xytext": (0, 4), "textcoords": "offset points"}
            axis.annotate(str(found.count), **where, ha="center", size=6, bbox=COUNT_BOX)
    axis.set_xticks(range(len(groups)), list(groups), rotation=30 if len(groups) > 4 else 0)
    axis.set_xlabel(words)
    axis.set_ylabel(title)
    _legend(axis)


def _curve(axis: Any, records: Sequence[Record], tables: Tables) -> None:
    """Draw precision and recall of predicted contact over the threshold that makes the true contact."""
    columns = {c.key: c for c in columns_for([f"{cm:g} cm" for cm in CURVE_CM])}
    for k, method in enumerate(tables.methods):
        own = [r for r in records if r["method"] == method]
        for name, style in (("precision", "-"), ("recall", "--")):
            values = [figure(own, columns[f"{name}@{cm:g} cm"]).value for cm in CURVE_CM]
            if all(math.isnan(value) for value in values):
                continue  # a method without contact
            axis.plot(CURVE_CM, values, style, color=COLORS[k % len(COLORS)], label=f"{method}: {name}", marker=".")
    axis.set_xlabel("threshold of true contact, cm")
    axis.set_ylabel("precision and recall of contact")
    axis.set_ylim(0, 1.02)
    _legend(axis)


def _legend(axis: Any) -> None:
    """Draw the legend over the panel, where it hides nothing."""
    axis.legend(fontsize=7, handlelength=3, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
