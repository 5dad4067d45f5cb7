"""Search folders of weight files: those of the user, the default cache, and the cache of Hugging Face."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

from physic_core.cache.folders import cache_folder
from physic_core.weights.manifest import HubSource, WeightFile, WeightSet

FOLDERS_VARIABLE = "PHYSIC_WEIGHTS"
"""Environment variable with folders of the user, separated as in ``PATH``."""


def user_folders() -> tuple[Path, ...]:
    """Return the folders in the environment variable ``PHYSIC_WEIGHTS``."""
    return tuple(
        Path(os.path.expanduser(text))
        for text in os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep)
        if text.strip()
    )


def find_without_subfolder(folder: Path, weights: WeightSet, file: WeightFile) -> Path | None:
    """Find a weight file directly in a folder, not in the weight set's subfolder; None if the match is uncertain."""
    path = folder / Path(file.path).name
    if not path.is_file():
        return None
    if file.bytes is not None:
        return path if path.stat().st_size == file.bytes else None
    return path if path.stem == weights.name else None


def find_in_hub_cache(file: WeightFile) -> Path | None:
    """Return the path of a file in the cache of Hugging Face, or None if it is not in the cache."""
    origin = file.origin
    if not isinstance(origin, HubSource) or find_spec("huggingface_hub") is None:
        return None
    if "huggingface_hub" not in sys.modules and not _hub_folder(origin.repository).is_dir():
        return None  # saves the slow import of the library
    try:
        from huggingface_hub import try_to_load_from_cache
    except ImportError:  # treated as a missing library: the error lists the searched folders
        return None
    found = try_to_load_from_cache(origin.repository, origin.path, revision=origin.revision)
    return Path(found) if isinstance(found, str) else None


def _hub_folder(repository: str) -> Path:
    """Return the cache folder of a repository, from the environment variables of ``huggingface_hub``."""
    home = os.environ.get("HF_HOME") or os.path.join(os.environ.get("XDG_CACHE_HOME") or "~/.cache", "huggingface")
    old = os.environ.get("HUGGINGFACE_HUB_CACHE") or os.path.join(home, "hub")
    cache = os.path.expandvars(os.path.expanduser(os.environ.get("HF_HUB_CACHE") or old))
    return Path(cache, f"models--{repository.replace('/', '--')}")


def describe_search_folders(name: str) -> str:
    """Return the list of folders that are searched for a weight set, as text."""
    own = cache_folder("weights")
    folders = [*user_folders(), *([own] if own is not None else [])]
    words = [str(folder / name) for folder in folders]
    if find_spec("huggingface_hub") is not None:
        words.append("Hugging Face's cache")
    return ", ".join(words)
