"""Run the conformance kit on every adapter and print a Markdown table of what came of it.

    python tools/adapters_table.py [--write] [more arguments of pytest]

The runs are those of the plugins' own tests: adapters whose networks answer what perfect ones
would, and, with published weights in $PHYSIC_WEIGHTS, the real ones. An adapter that is shown in
several forms (dialects of its file, sets of keypoints) has several runs. --write puts the outcome
into plugins/ADAPTERS.md. The exit status is pytest's, and 1 where an adapter has no run.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from pathlib import Path

import pytest

from physic_core import list_backends
from physic_core.discovery.entry_points import Offer
from physic_testing.conformance.run import CheckRun

ROOT = Path(__file__).parents[1]
PLUGINS = {
    "physic-onnx": ROOT / "plugins" / "physic-onnx",
    "physic-transformers": ROOT / "plugins" / "physic-transformers",
    "physic-human": ROOT / "plugins" / "physic-human",
    "physic-omnieraser": ROOT / "contrib" / "physic-omnieraser",
}
"""Distribution -> its folder; all are to be installed."""
DOCUMENT = ROOT / "plugins" / "ADAPTERS.md"
TESTS = "conform or holds_its_contract"
"""Names of the tests that run the whole kit."""
NONE = "NO RUN"


def main() -> int:
    write = "--write" in sys.argv
    further = [word for word in sys.argv[1:] if word != "--write"]
    runs: list[CheckRun] = []
    first = CheckRun.__init__

    def remembered(self: CheckRun, *arguments: object, **named: object) -> None:
        first(self, *arguments, **named)  # type: ignore[arg-type]
        runs.append(self)

    CheckRun.__init__ = remembered  # type: ignore[method-assign,assignment]
    tests = [str(folder / "tests") for folder in PLUGINS.values()]
    status = int(
        pytest.main([*tests, "-k", TESTS, "-q", "--no-header", "-p", "no:cacheprovider", *further])
    )
    rows = table(runs)
    print("\n| interface | backend | the kit |\n|---|---|---|")
    for (interface, name), told in rows.items():
        print(f"| {interface} | {name} | {told or NONE} |")
    if write:
        DOCUMENT.write_text(with_runs(DOCUMENT.read_text("utf-8"), rows), "utf-8")
    return status or int(not all(rows.values()))


def table(runs: list[CheckRun]) -> dict[tuple[str, str], str]:
    """(interface, name) of every adapter -> what came of its runs in words, empty where there is
    none.
    """
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for run in runs:
        outcomes = Counter(run.result(name).outcome for name in run.checks)
        for kind in run.subject.kind.__mro__:
            counts[f"{kind.__module__}:{kind.__qualname__}"] += Counter(runs=1) + outcomes
    return {(one.interface, one.name): words(counts[one.target]) for one in adapters()}


def with_runs(text: str, rows: dict[tuple[str, str], str]) -> str:
    """The document with another last column."""
    lines = []
    for line in text.splitlines():
        cells = line.split(" | ")
        key = (cells[0].removeprefix("| "), cells[1].strip("`")) if len(cells) == 4 else None
        if key in rows:
            cells[3] = f"{rows[key] or NONE} |"
        lines.append(" | ".join(cells))
    return "\n".join(lines) + "\n"


def words(found: Counter[str]) -> str:
    if not found:
        return ""
    bad = found["failed"] + found["xpassed"]
    result = f"{bad} checks FAILED" if bad else "passes"
    return f"{result}, {found['runs']} runs" if found["runs"] > 1 else result


def adapters() -> list[Offer]:
    """Backends of all these plugins."""
    return [offer for offer in list_backends() if offer.distribution in PLUGINS]


if __name__ == "__main__":
    sys.exit(main())
