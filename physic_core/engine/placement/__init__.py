"""Stage 2: human points in the scene, and the translation of each body (paper Sec. 3.2).

Other packages use ``solve_placement`` and ``PlacementInput`` of :mod:`.solve`, the ``PlacementMethod`` of
:mod:`.method`, which an energy may replace by :mod:`.terms` and :mod:`.solvers` of its own, and :mod:`.human_points`.
"""
