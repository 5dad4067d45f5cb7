from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core.errors import PhysicError
from physic_testing.bench.plot import draw_plot, draw_reliability
from physic_testing.bench.results import Results
from physic_testing.bench.summary import by_action, row_statistics

ROWS = {"start": {"label": "start"}, "full": {"label": "+ floor"}}
PEOPLE = [
    {"found": True, "why": "", "hits": 5, "false_alarms": 2, "misses": 3, "mpjpe_mm": v, "pa_mpjpe_mm": v / 5}
    for v in (90.0, 70.0)
]


def results():
    rows = {key: {"people": PEOPLE, "scene": {}, "seconds": 1.0, "error": ""} for key in ROWS}
    true = [{"action": "lie"}, {"action": "stand"}]
    records = [{"name": "lie", "seed": 0, "people": true, "false_alarms": 0, "error": "", "rows": rows}]
    settings = {"rows": ROWS, "size": [320, 240], "seed": 0, "preset": "default"}
    document = {"settings": settings, "actions": by_action(records, list(ROWS)), "worlds_done": 1}
    return Results(document, (), {key: row_statistics(records, key) for key in ROWS})


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_a_picture_is_drawn(tmp_path, suffix):
    pytest.importorskip("matplotlib")
    path = draw_plot(results(), tmp_path / f"ablation.{suffix}")
    assert path.stat().st_size > 5_000


def test_without_matplotlib_it_names_the_package_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(
        PhysicError,
        match=r"^the plot needs matplotlib.*: `pip install -e 'plugins/physic-testing\[plot\]'` in a checkout",
    ):
        draw_plot(results(), tmp_path / "ablation.png")


def test_a_reliability_diagram_is_drawn_where_probabilities_are_known(tmp_path):
    pytest.importorskip("matplotlib")
    known = results()
    assert draw_reliability(known, tmp_path / "none.png") is None
    figures = known.figures["full"]
    bins = [[0.0, 0.0, 0.0]] * 8 + [[10, 8.2, 7], [20, 19, 20]]
    known = replace(known, figures={"full": replace(figures, reliability=np.array(bins))})
    path = draw_reliability(known, tmp_path / "reliability.png")
    assert path is not None
    assert path.stat().st_size > 5_000
