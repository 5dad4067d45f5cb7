"""Give the distributions of plugins the addresses and classifiers of the core.

A metadata hook of Hatchling: both are written once, in the ``pyproject.toml`` of the repository.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

SHARED = ("classifiers", "urls")


class SharedMetadata(MetadataHookInterface):
    """Copies what a distribution lists as dynamic from the project of the repository."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the shared fields."""
        text = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
        project = tomllib.loads(text)["project"]
        metadata.update({name: project[name] for name in SHARED})
