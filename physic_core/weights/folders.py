"""The folders that are searched for weights; nothing here uses the network."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

from physic_core.cache.folders import cache_folder
from physic_core.weights.manifest import HubSource, WeightFile, WeightSet

__all__ = ["FOLDERS", "in_hub_cache", "loose", "own_folder", "places_in_words", "user_folders"]

FOLDERS = "PHYSIC_WEIGHTS"
"""Environment variable: folders of the user's own, with the system's separator between them."""


def user_folders() -> tuple[Path, ...]:
    """The folders of ``PHYSIC_WEIGHTS``."""
    return tuple(Path(text).expanduser() for text in os.environ.get(FOLDERS, "").split(os.pathsep) if text.strip())


def own_folder() -> Path | None:
    """Folder to which ``physic weights fetch`` downloads; None if the user has no home folder."""
    return cache_folder("weights")


def loose(folder: Path, weights: WeightSet, file: WeightFile) -> Path | None:
    """Find a file directly in a folder, without the subfolder of its set; None if the match is not certain."""
    path = folder / Path(file.path).name
    if not path.is_file():
        return None
    if file.bytes is not None:
        return path if path.stat().st_size == file.bytes else None
    return path if path.stem == weights.name else None


def in_hub_cache(file: WeightFile) -> Path | None:
    """Path of a file in the cache of Hugging Face; None if it is not there or the library is not installed."""
    origin = file.origin
    if not isinstance(origin, HubSource) or find_spec("huggingface_hub") is None:
        return None
    if "huggingface_hub" not in sys.modules and not _hub_folder(origin.repository).is_dir():
        return None  # without the library, whose import takes time
    try:
        from huggingface_hub import try_to_load_from_cache
    except ImportError:  # ignored like a missing library: the error lists the searched folders
        return None
    found = try_to_load_from_cache(origin.repository, origin.path, revision=origin.revision)
    return Path(found) if isinstance(found, str) else None


def _hub_folder(repository: str) -> Path:
    """Cache folder of a repository, from the environment variables of ``huggingface_hub``."""
    home = os.environ.get("HF_HOME") or os.path.join(os.environ.get("XDG_CACHE_HOME") or "~/.cache", "huggingface")
    old = os.environ.get("HUGGINGFACE_HUB_CACHE") or os.path.join(home, "hub")
    cache = os.path.expandvars(os.path.expanduser(os.environ.get("HF_HUB_CACHE") or old))
    return Path(cache, f"models--{repository.replace('/', '--')}")


def places_in_words(name: str) -> str:
    """Describe the folders that are searched for a set."""
    own = own_folder()
    folders = [*user_folders(), *([own] if own is not None else [])]
    words = [str(folder / name) for folder in folders]
    if find_spec("huggingface_hub") is not None:
        words.append("Hugging Face's cache")
    return ", ".join(words)
