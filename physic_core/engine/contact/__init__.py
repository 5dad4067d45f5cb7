"""Stage 4: contact of bodies with scene and people, and their support (paper sec. 3.3).

Other packages use ``solve_contact`` of :mod:`.solve`, the ``ContactStageMethod`` of :mod:`.method`,
which an energy may replace, and :mod:`.distances`, :mod:`.probability`, :mod:`.regions` and
:mod:`.scene_parts`.
"""
