"""Caches of backend results, mesh correspondences, networks and hashes in the user's cache folder.

Other packages use :mod:`.folders` for where caches are, and the caches themselves: :mod:`.results`,
:mod:`.correspondences` and :mod:`.digests`.
"""
