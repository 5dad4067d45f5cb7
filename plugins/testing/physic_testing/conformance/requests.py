"""Requests for a backend, built from a photo of the conformance kit."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.interfaces import INTERFACES
from physic_core.types import Hints

if TYPE_CHECKING:
    from physic_core.interfaces import Request
    from physic_testing.conformance.cases import Case


def build_request(interface: str, case: Case) -> Request[Any]:
    """Build the request for a case; its arrays are writable copies."""
    kind = INTERFACES[interface]
    known: dict[str, Any] = {
        "image": case.empty if kind.sees == "inpainted" else case.photo,
        "mask": case.hole,
        "people": case.people,
        "intrinsics": case.intrinsics,
        "keypoints": case.keypoints,
        "bodies": case.bodies,
        "hints": Hints(**{name: getattr(case, name) for name in kind.hints}),
    }
    given = {field.name: known[field.name] for field in fields(kind.Request) if not field.kw_only}
    # deepcopy makes the arrays writable: a backend that writes to them is then detected.
    return deepcopy(kind.Request(**given))


def read_only_view(thing: Any) -> Any:
    """Return an array, or a dataclass of arrays, as read-only views with negative strides."""
    if isinstance(thing, np.ndarray):
        # Reversed in memory with a negative stride, like a photo that was rotated by its EXIF tag.
        view = np.ascontiguousarray(thing[..., ::-1])[..., ::-1] if thing.ndim else thing.copy()
        view.setflags(write=False)
        return view
    if isinstance(thing, tuple):
        return tuple(read_only_view(part) for part in thing)
    if is_dataclass(thing) and not isinstance(thing, type):
        return replace(
            thing, **{f.name: read_only_view(getattr(thing, f.name)) for f in fields(thing)}
        )
    return thing
