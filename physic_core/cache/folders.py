"""Cache folders in ``$XDG_CACHE_HOME/physic``, or in the system's default cache folder."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from physic_core.cache.lru_folder import LruFolder

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


CACHES = {
    "results": ("results", ".result.npz"),
    "correspondences": ("maps", ".map.npz"),
    "graphs": ("graphs", ".graph.onnx"),
    "hashes": ("hashes", ".sha256"),
}
"""Folder and suffix of each cache: results of backends, correspondences of meshes, optimised graphs of networks, and
SHA-256s of the user's files."""


def users_cache(name: str) -> LruFolder | None:
    """Return a cache of :data:`CACHES`; None if it is disabled."""
    folder, suffix = CACHES[name]
    root = cache_folder("", CACHE_VARIABLE)
    return None if root is None else LruFolder(root / folder, suffix)
