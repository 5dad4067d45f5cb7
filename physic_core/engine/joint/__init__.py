"""Stage 3: joint optimisation of people and scene (paper Sec. 3.3).

Other packages use ``optimize`` and ``finalize_scene`` of :mod:`.solve`. An energy replaces the
``JointMethod`` of :mod:`.method`; its terms are of the class in :mod:`.term` and read
:mod:`.sampling`, :mod:`.variables` and :mod:`.snapshot`; those of the default energy are in
:mod:`.terms`. :mod:`.optimiser` minimises it.
"""
