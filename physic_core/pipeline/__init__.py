"""The pipeline for one photo: call the backends, validate their results, run the engine, and make
the reconstruction.

Other packages use ``Pipeline`` and ``reconstruct`` of :mod:`.run`. Those that take one part of a
run use :mod:`.estimate` (backends), :mod:`.optimise` (engine) and :mod:`.reconstruction`.
"""
