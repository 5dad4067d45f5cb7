"""Scores of the body parts that carry a person, as reported by the engine, against the truth of a world."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.engine.contact.regions import contact_regions

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import BoolArray, Support

_MIN_VERTICES = 10  # of a body part that carries, as in a reported support


class SupportScorer:
    """Comparison of reported supports with true ones, by body part.

    Args:
        model: body model of the world's people.
    """

    def __init__(self, model: BodyModel) -> None:
        self._names, region = contact_regions(model)
        self._region = region.cpu().numpy()

    def counts(self, support: Support | None, carrying: BoolArray) -> dict[str, int]:
        """Count right and wrong body parts of one person.

        Args:
            support: reported; None counts as no support.
            carrying: (V,) vertices that truly carry the person.

        Returns:
            The counts ``reported_support_hits``, ``reported_support_false_alarms`` and ``reported_support_misses``.
        """
        vertices = np.bincount(self._region[carrying], minlength=len(self._names))
        true = {name for name, count in zip(self._names, vertices, strict=True) if count >= _MIN_VERTICES}
        found = {contact.part for contact in support.contacts} if support is not None else set()
        return {
            "reported_support_hits": len(found & true),
            "reported_support_false_alarms": len(found - true),
            "reported_support_misses": len(true - found),
        }
