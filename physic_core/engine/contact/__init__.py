"""Stage 4: contact of bodies with scene, people and objects, and their support (paper sec. 3.3).

Other packages use ``solve_contact`` of :mod:`.solve` with the input and result of :mod:`.problem`,
the ``ContactMethod`` of :mod:`.method`, which an energy may replace, and :mod:`.distance`,
:mod:`.regions`, :mod:`.scene_parts` and :mod:`.objects`.
"""
