"""Data sets, by name; each is a module of this package with a ``DATA_SET``."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_bench.datasets.base import DataSet

__all__ = ["DATA_SETS", "data_set"]

DATA_SETS = {
    "prox": "PROX quantitative: bodies by motion capture in a scanned room",
    "rich": "RICH: bodies, contact and scans before several cameras",
    "worlds": "synthetic worlds of metricbody-testing, for the preset mock",
}
"""Name -> summary."""


def data_set(name: str) -> DataSet:
    """Return a data set by its name, which must be a key of DATA_SETS."""
    definition: DataSet = import_module(f"{__name__}.{name}").DATA_SET
    return definition
