"""Caches of backend results, mesh correspondences, networks and hashes in the user's cache folder.

Names that plugins use are imported at their first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.lazy import importer

if TYPE_CHECKING:
    from physic_core.cache.digests import CodeDigester as CodeDigester
    from physic_core.cache.digests import file_stamp as file_stamp
    from physic_core.cache.digests import files_named_by as files_named_by
    from physic_core.cache.folders import LruFolder as LruFolder
    from physic_core.cache.folders import belongs_to_user as belongs_to_user
    from physic_core.cache.folders import cache_folder as cache_folder
    from physic_core.cache.folders import claimed_cache as claimed_cache
    from physic_core.cache.folders import plain_name as plain_name
    from physic_core.cache.folders import users_cache as users_cache
    from physic_core.cache.kit_stamps import remember_passed as remember_passed
    from physic_core.cache.results import cached_network_result as cached_network_result
    from physic_core.cache.results import made_of as made_of

_NAMES = {
    "digests": "CodeDigester file_stamp files_named_by",
    "folders": "LruFolder cache_folder claimed_cache belongs_to_user plain_name users_cache",
    "kit_stamps": "remember_passed",
    "results": "cached_network_result made_of",
}

__getattr__ = importer(__name__, _NAMES)
