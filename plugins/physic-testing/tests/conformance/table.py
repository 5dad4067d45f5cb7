"""The table of wrong backends x checks, as markdown: ``python plugins/physic-testing/tests/conformance/table.py``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import cache
from importlib.metadata import distributions
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import wrong_bodies  # noqa: F401 - notes its own in WRONG
import wrong_sayings  # noqa: F401
from right_backends import SIZE
from wrong_backends import WRONG, Wrong

from physic_core.discovery.plugins import discover
from physic_testing import Report, check_backend


@cache
def row(mistake: Wrong) -> Report:
    """What the kit says of one wrong backend."""
    if not mistake.plugin:
        return check_backend(mistake.kind, size=SIZE)
    with TemporaryDirectory() as folder, patch.object(sys, "path", [*sys.path, folder]):
        info = Path(folder) / "wrong_plugin-1.0.dist-info"
        info.mkdir()
        (Path(folder) / "wrong_plugin.py").write_text(mistake.plugin)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: wrong-plugin\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[physic.plugins]\nwrong = wrong_plugin\n")
        registry = discover(entry for found in distributions(path=[folder]) for entry in found.entry_points)
        sys.modules.pop("wrong_plugin")
        return check_backend("heavy", mistake.kind.interface, registry=registry, size=SIZE)


def table(mistakes: Sequence[Wrong] = tuple(WRONG), *, wide: bool = False) -> str:
    """One row a wrong backend.

    Args:
        mistakes: which ones.
        wide: a column for each check that caught anything; else one column that names the checks.
    """
    found = {m: [failure.check for failure in row(m).failures] for m in mistakes}
    columns = sorted({check for checks in found.values() for check in checks}) if wide else []
    head = ["interface", "wrong backend", "caught by", "others that failed", *columns]
    lines = [head, ["---"] * 4 + [":-:"] * len(columns)]
    for mistake, checks in found.items():
        others = [check for check in checks if check != mistake.check]
        own = f"caught by {mistake.check}" if mistake.check in checks else "NOT CAUGHT"
        marks = ["x" if column in checks else "" for column in columns]
        lines.append([mistake.kind.interface, mistake.mistake, own, ", ".join(others) or "none", *marks])
    return "\n".join(f"| {' | '.join(line)} |" if line[0] != "---" else f"|{'|'.join(line)}|" for line in lines)


if __name__ == "__main__":
    print(table(wide="--wide" in sys.argv))
