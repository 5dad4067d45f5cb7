"""The start of the published results: the bodies before the authors' optimisation, and DECO's contact."""

from __future__ import annotations

from typing import ClassVar

from physic_bench.readers.physic_release import PhysicRelease


class PhysicReleaseInit(PhysicRelease):
    """Reads the ``init_`` arrays of the release."""

    name: ClassVar[str] = "physic-release-init"
    prefix: ClassVar[str] = "init"


READER = PhysicReleaseInit
