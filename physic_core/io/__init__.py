"""Read photos, and write and read reconstructions.

Other packages use ``read_photo`` of :mod:`.photo`, :mod:`.results` to write and read them, and
:mod:`.result_folder` for names and digests of files.
"""
