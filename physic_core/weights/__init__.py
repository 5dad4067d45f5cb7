"""Find and verify the weights of networks.

A plugin describes its weights in TOML files (:mod:`physic_core.weights.manifest`). A backend calls
:func:`locate` to get the path of a file. Nothing here uses the network: ``physic weights fetch`` of
metricbody-embedded downloads files.

These places are searched, in this order:

1. The folders in the environment variable ``PHYSIC_WEIGHTS``, for ``<folder>/<set>/<file>``.
2. The user's cache folder, for ``.../physic/weights/<set>/<file>``.
3. The cache of Hugging Face, if ``huggingface_hub`` is installed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.lazy import importer

if TYPE_CHECKING:
    from physic_core.weights.find import common_folder as common_folder
    from physic_core.weights.find import describe_mismatch as describe_mismatch
    from physic_core.weights.find import fingerprint, locate, missing
    from physic_core.weights.find import format_size as format_size
    from physic_core.weights.find import locate_files as locate_files
    from physic_core.weights.find import presence as presence
    from physic_core.weights.find import search_folders as search_folders
    from physic_core.weights.find import size_mismatches as size_mismatches
    from physic_core.weights.library import named_sets as named_sets
    from physic_core.weights.library import read_library as read_library
    from physic_core.weights.manifest import HubSource as HubSource
    from physic_core.weights.manifest import WebSource as WebSource
    from physic_core.weights.manifest import WeightFile, WeightSet, read_manifest

__all__ = ["WeightFile", "WeightSet", "fingerprint", "locate", "missing", "read_manifest"]


_NAMES = {
    "find": "common_folder describe_mismatch fingerprint format_size locate locate_files missing "
    "presence search_folders size_mismatches",
    "library": "named_sets read_library",
    "manifest": "HubSource WebSource WeightFile WeightSet read_manifest",
}
# a run with the embedded networks needs none of the modules
__getattr__ = importer(__name__, _NAMES)
