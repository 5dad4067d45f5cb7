"""Energies of the publications: the paper as printed, the code as released, and PROX, the paper's
baseline.
"""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_engine_presets() -> list[PluginItem]:
    """Return the three energies."""
    return [
        PluginItem(name.lower(), f"physic_paper.presets:{name}")
        for name in ("PAPER", "PROX", "RELEASE")
    ]
