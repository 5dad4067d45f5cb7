"""Pure functions on tensors: cameras, point maps, alignment, planes, neighbours, visibility, robust
losses.

Other packages use :mod:`.camera`, :mod:`.pointmap`, :mod:`.alignment`, :mod:`.floor`,
:mod:`.plane`, :mod:`.upright`, :mod:`.mesh`, :mod:`.rays`, :mod:`.raster`, :mod:`.neighbors`,
:mod:`.visibility`, :mod:`.robust`, :mod:`.rotations`, :mod:`.rotvecs` and :mod:`.tensors`.
"""
