"""Reconstruct many photos: find them, run them in worker processes, keep a journal, and write
tables and pages.

Other packages use ``plan_batch``, ``run_batch`` and ``open_executor`` of :mod:`.run`,
``list_photos`` of :mod:`.photos`, :mod:`.process` for one photo of a batch, :mod:`.workers` for its
processes, :mod:`.journal` with its tables, and :mod:`.contact_sheet`.
"""
