"""Cache folders: ``$XDG_CACHE_HOME/physic``, or the system's default cache folder."""

from __future__ import annotations

import os
import sys
from pathlib import Path

__all__ = ["CACHE_VARIABLE", "cache_folder", "maps_folder", "models_folder", "results_folder"]

CACHE_VARIABLE = "PHYSIC_CACHE"
"""Environment variable of the backends' answers, of maps between bodies and of plain copies: a folder, or "off"."""


def cache_folder(name: str, switch: str = "") -> Path | None:
    """Folder of one cache; None if it is disabled or the user has no home folder.

    Args:
        name: of the cache.
        switch: environment variable with another folder, or "off"; "" if there is none.
    """
    wish = os.environ.get(switch, "") if switch else ""
    if wish.lower() in ("off", "0", "no", "false"):
        return None
    if wish:
        return Path(wish)
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
    """Cache folder of backend outputs; None if disabled."""
    return cache_folder("answers", CACHE_VARIABLE)


def maps_folder() -> Path | None:
    """Cache folder of maps between body meshes; None if disabled."""
    return cache_folder("maps", CACHE_VARIABLE)


def models_folder() -> Path | None:
    """Cache folder of converted body models; None if disabled."""
    return cache_folder("models", CACHE_VARIABLE)
