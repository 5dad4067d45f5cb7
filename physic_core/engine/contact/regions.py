"""Body parts of contacts, in the words of a reader: the model's parts, with seat and back as parts of their own."""

from __future__ import annotations

from torch import Tensor

from physic_core.body.model import BodyModel

__all__ = ["contact_regions"]

_OWN_REGIONS = {"gluteus": "seat", "back": "back"}


def contact_regions(model: BodyModel) -> tuple[tuple[str, ...], Tensor]:
    """Return the names of the parts, and the part of each vertex (V,) as an index into them."""
    names = (*model.part_names, *_OWN_REGIONS.values())
    region = model.part_of_vertex.clone()
    for contact_set, name in _OWN_REGIONS.items():
        region[model.contact_sets[contact_set]] = names.index(name)
    return names, region
