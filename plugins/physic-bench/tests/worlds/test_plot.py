from __future__ import annotations

import pytest

from physic_bench.worlds.plot import draw_plot
from physic_bench.worlds.results import Results
from physic_bench.worlds.summary import by_action, row_statistics

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
def test_the_plot_of_a_benchmark_is_a_picture(tmp_path, suffix):
    pytest.importorskip("matplotlib")
    path = draw_plot(results(), tmp_path / f"ablation.{suffix}")
    assert path.stat().st_size > 5_000
