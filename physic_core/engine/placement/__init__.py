"""Stage 2: human points in the scene, and the translation of each body (paper Sec. 3.2).

Other packages use ``solve_placement`` of :mod:`.solve`, and the ``PlacementStageMethod`` of
:mod:`.method`, which an energy may replace with :mod:`.terms` of its own.
"""
