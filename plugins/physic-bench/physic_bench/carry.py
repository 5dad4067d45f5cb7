"""Carry values from the vertices of one body mesh to those of another, over the bodies' T-poses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from physic_bench.bodies import BodyFiles

    Array = NDArray[np.float64]


@dataclass(eq=False)
class Carrier:
    """Correspondences between body meshes, found when they are first needed, half a second each.

    Args:
        files: the user's body models; the embedded body is always there.
    """

    files: BodyFiles
    _found: dict[tuple[str, str], Callable[[Array], Array] | None] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {"files": self.files, "_found": {}}

    def values(self, values: Array, source: str, target: str) -> Array | None:
        """Return values (V_source, C) at the vertices of another mesh (V_target, C), or None without a way.

        A way needs the model files of both meshes, except that of the embedded body.
        """
        if source == target:
            return values
        if (source, target) not in self._found:
            self._found[source, target] = self._way(source, target)
        way = self._found[source, target]
        return None if way is None else way(values)

    def contact(self, contact: NDArray[np.bool_], source: str, target: str) -> NDArray[np.bool_] | None:
        """Return contact (V_source,) at the vertices of another mesh: a vertex touches if most of its triangle does."""
        carried = self.values(contact.astype(np.float64)[:, None], source, target)
        return None if carried is None else carried[:, 0] >= 0.5

    def _way(self, source: str, target: str) -> Callable[[Array], Array] | None:
        from scipy.spatial import KDTree

        from physic_core.body.convert.correspondence import find_correspondence

        rest_source, rest_target = self.files.rest(source), self.files.rest(target)
        if rest_source is None or rest_target is None:
            return None
        model = self.files.model(target)
        if model is not None:
            return find_correspondence(rest_source, model).interpolate
        model = self.files.model(source)
        if model is None:
            return None
        # The target has no model here: its vertices take the values of the nearest of the source's, laid onto it.
        laid = find_correspondence(rest_target, model).interpolate(rest_target.vertices.astype(np.float64))
        nearest = KDTree(laid).query(rest_target.vertices)[1]
        return lambda values: values[nearest]
