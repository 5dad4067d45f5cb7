"""Find and verify the weights of networks.

A plugin describes its weights in TOML files (:mod:`physic_core.weights.manifest`). A backend calls
:func:`locate` to get the path of a file. Nothing here uses the network: ``physic weights fetch`` of
physic-setup downloads files.

These places are searched, in this order:

1. The folders in the environment variable ``PHYSIC_WEIGHTS``, for ``<folder>/<set>/<file>``.
   ``<folder>/<file>`` is also accepted if it has exactly the published size, or, if no size is
   published, if its name is the name of the set.
2. The user's cache folder, for ``.../physic/weights/<set>/<file>``.
3. The cache of Hugging Face, if ``huggingface_hub`` is installed.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from physic_core.weights.find import common_folder as common_folder
    from physic_core.weights.find import describe_mismatch as describe_mismatch
    from physic_core.weights.find import fingerprint, locate, missing
    from physic_core.weights.find import format_size as format_size
    from physic_core.weights.find import locate_files as locate_files
    from physic_core.weights.find import size_mismatches as size_mismatches
    from physic_core.weights.library import named_sets as named_sets
    from physic_core.weights.library import read_library as read_library
    from physic_core.weights.manifest import HubSource as HubSource
    from physic_core.weights.manifest import WebSource as WebSource
    from physic_core.weights.manifest import WeightFile, WeightSet, read_manifest

__all__ = ["WeightFile", "WeightSet", "fingerprint", "locate", "missing", "read_manifest"]


_MODULES = {
    **dict.fromkeys(("fingerprint", "locate", "missing"), "find"),
    **dict.fromkeys(("WeightFile", "WeightSet", "read_manifest"), "manifest"),
    **dict.fromkeys(
        ("common_folder", "describe_mismatch", "format_size", "locate_files", "size_mismatches"),
        "find",
    ),
    **dict.fromkeys(("named_sets", "read_library"), "library"),
    **dict.fromkeys(("HubSource", "WebSource"), "manifest"),
}


def __getattr__(name: str) -> Any:
    """Import the module of a name at its first use, since a run with the embedded networks needs
    none of them.
    """
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
