"""Cache folders in ``$XDG_CACHE_HOME/physic``, or in the system's default cache folder."""

from __future__ import annotations

import os
import sys
from pathlib import Path

CACHE_VARIABLE = "PHYSIC_CACHE"
"""Environment variable with the folder of all caches, or "off"."""


def cache_folder(name: str, variable: str = "") -> Path | None:
    """Return the folder of a cache; None if it is disabled or the user has no home folder.

    Args:
        name: of the cache.
        variable: environment variable with another folder, or "off"; "" for none.
    """
    setting = os.environ.get(variable, "") if variable else ""
    if setting.lower() in ("off", "0", "no", "false"):
        return None
    if setting:
        return Path(setting)
    base = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(base):  # the XDG standard ignores relative paths
        try:
            home = Path.home()
        except RuntimeError:
            return None
        if sys.platform == "win32":
            base = os.environ.get("LOCALAPPDATA") or str(home / "AppData" / "Local")
        else:
            base = str(home / ("Library/Caches" if sys.platform == "darwin" else ".cache"))
    return Path(base) / "physic" / name


def results_folder() -> Path | None:
    """Return the cache folder of backend results; None if disabled."""
    return _folder("answers")


def correspondences_folder() -> Path | None:
    """Return the cache folder of mesh correspondences; None if disabled."""
    return _folder("maps")


def graphs_folder() -> Path | None:
    """Return the cache folder of optimised graphs of networks; None if disabled."""
    return _folder("graphs")


def hashes_folder() -> Path | None:
    """Return the cache folder of SHA-256s of the user's files; None if disabled."""
    return _folder("hashes")


def _folder(name: str) -> Path | None:
    root = cache_folder("", CACHE_VARIABLE)
    return None if root is None else root / name
