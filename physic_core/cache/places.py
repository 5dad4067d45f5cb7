"""Where caches lie: ``$XDG_CACHE_HOME/physic``, or the system's own place for them."""

from __future__ import annotations

import os
import sys
from pathlib import Path

__all__ = ["SWITCH", "answers_folder", "maps_folder", "models_folder", "place"]

SWITCH = "PHYSIC_CACHE"
"""Environment variable of the backends' answers, of maps between bodies and of plain copies: a folder, or "off"."""


def place(name: str, switch: str = "") -> Path | None:
    """The folder of one cache, or None if it is switched off, or if the user has no home for it.

    Args:
        name: of the cache.
        switch: environment variable that holds another folder, or "off"; empty where there is none.
    """
    wish = os.environ.get(switch, "") if switch else ""
    if wish.lower() in ("off", "0", "no", "false"):
        return None
    if wish:
        return Path(wish)
    base = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(base):  # the standard says that a relative one is not valid
        try:
            home = Path.home()
        except RuntimeError:
            return None
        if sys.platform == "win32":
            base = os.environ.get("LOCALAPPDATA") or str(home / "AppData" / "Local")
        else:
            base = str(home / ("Library/Caches" if sys.platform == "darwin" else ".cache"))
    return Path(base) / "physic" / name


def answers_folder() -> Path | None:
    """Where answers of backends are kept, or None if they are not."""
    return place("answers", SWITCH)


def maps_folder() -> Path | None:
    """Where maps between the meshes of bodies are kept, or None if they are not."""
    return place("maps", SWITCH)


def models_folder() -> Path | None:
    """Where plain copies of the user's body models are kept, or None if they are not."""
    return place("models", SWITCH)
