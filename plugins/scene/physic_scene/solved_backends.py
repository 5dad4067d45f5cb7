"""Backends that return the solution of several photos: bodies and metric depth of the reference
photo.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator, MetricDepth
from physic_core.types import Bodies, DepthMap

if TYPE_CHECKING:
    from physic_core.types import Hints, Intrinsics, Keypoints, People, UInt8Array


class SolvedBodies(BodyEstimator):
    """Returns the bodies that several photos show."""

    _bodies: Bodies

    @classmethod
    def of(cls, bodies: Bodies) -> Self:
        """Return a backend for one photo, whose people are those of ``bodies`` in this order."""
        backend = cls()
        backend._bodies = bodies
        return backend

    def infer(
        self,
        image: UInt8Array,
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """Return the bodies.

        Raises:
            BackendError: the photo shows another number of people.
        """
        if len(people) != len(self._bodies.parameters):
            raise BackendError(
                f"the reference photo showed {len(self._bodies.parameters)} people alone and now "
                f"{len(people)}: its segmenter does not repeat its results"
            )
        return self._bodies


class SolvedDepth(MetricDepth):
    """Returns the depth of the reference photo at the scale of all photos, which is not voted on
    again.
    """

    reads = ("scale",)
    _depth: DepthMap

    @classmethod
    def of(cls, depth: DepthMap) -> Self:
        """Return a backend for one photo."""
        backend = cls()
        backend._depth = depth
        return backend

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return the depth."""
        return self._depth
