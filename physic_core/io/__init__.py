"""Read photos, and write and read reconstructions.

Other packages use ``read_source`` of :mod:`.photo`, ``save_reconstruction`` of :mod:`.saving` and the words of
:mod:`.saved_files`, ``load_reconstruction`` of :mod:`.results`, :mod:`.result_folder` for names and digests of files,
:mod:`.document`, :mod:`.records`, :mod:`.people_table`, :mod:`.people_prompt` and :mod:`.report_file`.
"""
