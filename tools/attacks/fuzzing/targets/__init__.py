"""All attacks: one module per reader, each with a constant ``TARGETS``."""

from __future__ import annotations

import importlib
import pkgutil

from fuzzing.target import Target


def all_targets() -> list[Target]:
    """Return the targets of every module of this folder, by name."""
    modules = [
        importlib.import_module(f"{__name__}.{module.name}")
        for module in pkgutil.iter_modules(__path__)
    ]
    return sorted(
        (target for module in modules for target in module.TARGETS), key=lambda target: target.name
    )
