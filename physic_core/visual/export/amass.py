"""Deprecated place of :func:`physic_export.amass.read_amass`; it is removed in the next minor release."""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

from physic_core.discovery.catalog import how_to_install
from physic_core.errors import PackageMissingError


def __getattr__(name: str) -> Any:
    if name != "read_amass":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warnings.warn(f"{__name__}.read_amass is now physic_export.amass.read_amass", DeprecationWarning, stacklevel=2)
    try:
        return import_module("physic_export.amass").read_amass
    except ModuleNotFoundError as error:
        raise PackageMissingError(f"read_amass needs physic-export: {how_to_install('physic-export')}") from error
