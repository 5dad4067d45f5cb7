"""Stage 1: metric scene points, camera and floor (paper Sec. 3.1).

Other packages use ``solve_scene``, ``SceneInput`` and ``SceneState`` of :mod:`.solve`, and the
``SceneMethod`` of :mod:`.method`, which an energy may replace.
"""
