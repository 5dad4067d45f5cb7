"""Stage 2: human points in the scene, and the translation of each body (paper Sec. 3.2).

Other packages use ``solve_placement`` and ``PlacementInput`` of :mod:`.solve`, the observations and
bodies of :mod:`.place`, and the ``PlacementMethod`` of :mod:`.method`, which an energy may replace
with :mod:`.terms` of its own.
"""
