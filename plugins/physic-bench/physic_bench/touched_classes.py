"""Classes of touched things, by which object labels of a data set and contact partners of a result are compared.

The words of both differ: a data set names objects ("couch", "skateboard"), a result names classes of surfaces ("seat",
"object"). Each is mapped to one of :data:`CLASSES`; two objects of one class in a photo count together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import ContactPartner

CLASSES = ("supporting", "seat", "bed", "table", "cabinet", "vehicle", "vegetation", "object", "person")
"""Classes of touched things. "supporting" is floor, ground, stairs and wall, as DAMON's label of that name."""

_CLASS_OF_OBJECT: Mapping[str, str] = {
    "supporting": "supporting",
    "person": "person",
    **dict.fromkeys(("chair", "couch", "sofa", "bench", "toilet"), "seat"),
    "bed": "bed",
    **dict.fromkeys(("dining table", "desk", "table"), "table"),
    **dict.fromkeys(("refrigerator", "oven", "sink", "cabinet"), "cabinet"),
    **dict.fromkeys(("bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat"), "vehicle"),
    **dict.fromkeys(("potted plant", "tree"), "vegetation"),
}

_CLASS_OF_SURFACE: Mapping[str, str] = {
    **dict.fromkeys(("floor", "ground", "rug", "stairs", "wall", "ceiling", "window", "water"), "supporting"),
    **{name: name for name in ("seat", "bed", "table", "cabinet", "vehicle", "vegetation", "object")},
}


def class_of_object(name: str) -> str:
    """Return the class of a data set's object: "object" for all that have no class of their own."""
    return _CLASS_OF_OBJECT.get(name.strip().lower().replace("_", " "), "object")


def class_of_partner(partner: ContactPartner) -> str:
    """Return the class of a contact partner; "" for the own body, and for a surface of unknown class."""
    if partner.kind in ("floor", "person"):
        return {"floor": "supporting"}.get(partner.kind, "person")
    return "" if partner.kind == "self" else _CLASS_OF_SURFACE.get(partner.surface, "")


def contact_by_class(classes: NDArray[Any] | Sequence[str]) -> dict[str, NDArray[np.bool_]]:
    """Return the contact vertices (V,) bool of each class, for the class of each of V vertices, "" without contact."""
    found = np.asarray(classes)
    return {name: np.asarray(found == name, bool) for name in CLASSES}
