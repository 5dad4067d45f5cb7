"""Where weights are, what they are, and how to get them.

A plugin lists its weights in TOML files (:mod:`physic_core.weights.manifest`); a backend asks here for the file that
it is to read. Nothing here goes to the network but :mod:`physic_core.weights.fetch`, and only ``physic weights fetch``
calls that.

Weights are sought, in this order, in

1. the folders of the environment variable ``PHYSIC_WEIGHTS``, as ``<folder>/<set>/<file>``; and as ``<folder>/<file>``
   where nothing else can be meant: the file has exactly the published size, or, where no size is published, the file
   is called after its set,
2. the user's folder for caches, ``.../physic/weights/<set>/<file>``,
3. Hugging Face's own cache, if ``huggingface_hub`` is installed.
"""

from __future__ import annotations

from physic_core.weights.locate import fingerprint, locate, missing
from physic_core.weights.manifest import WeightFile, WeightSet, read_manifest

__all__ = ["WeightFile", "WeightSet", "fingerprint", "locate", "missing", "read_manifest"]
