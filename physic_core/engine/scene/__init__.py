"""Stage 1: metric scene points, camera and floor (paper Sec. 3.1).

Other packages use ``solve_scene`` of :mod:`.solve`, the records of :mod:`.state`, and the
``SceneStageMethod`` of :mod:`.method`, which an energy may replace.
"""
