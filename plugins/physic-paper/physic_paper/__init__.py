"""Energies of the publications: the paper as printed, the code as released, and PROX, the paper's baseline."""

from __future__ import annotations

from physic_core import EnergyRecord, hookimpl

__all__: list[str] = []


@hookimpl
def physic_energies() -> list[EnergyRecord]:
    """Return one record per preset of the engine."""
    return [
        EnergyRecord("paper", "physic_paper.presets:PAPER", "as printed in the paper"),
        EnergyRecord("release", "physic_paper.presets:RELEASE", "as in the paper's released code"),
        EnergyRecord("prox", "physic_paper.presets:PROX", "PROX, the paper's baseline"),
    ]
