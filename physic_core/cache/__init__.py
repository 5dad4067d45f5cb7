"""Caches of backend results, mesh correspondences, networks and hashes in the user's cache folder.

Other packages use :mod:`.folders` and :mod:`.claim` for where caches are, :mod:`.lru_folder` for a cache of limited
size, and the caches themselves: :mod:`.result_cache`, :mod:`.network_results`, :mod:`.correspondences` and
:mod:`.file_hashes`.
"""
