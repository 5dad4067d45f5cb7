"""Preview image and GLB files of a reconstruction.

Other packages use :mod:`.preview`, :mod:`.glb` and :mod:`.report` for files, :mod:`.export` for
formats of plugins, and the parts that these are made of: :mod:`.palette`, :mod:`.render`,
:mod:`.surface`, :mod:`.rig`, :mod:`.textures`, :mod:`.glb_builder`, :mod:`.panels` and
:mod:`.views`.
"""
