"""Requests for a backend, built from a photo of the conformance kit."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.interfaces import INTERFACES
from physic_core.types import Hints, mirrored_order

if TYPE_CHECKING:
    from physic_core.interfaces import Request
    from physic_testing.conformance.cases import Case


OF_PIXELS = ("people", "keypoints", "hole", "photo", "intrinsics")
"""Hints that belong to the pixels of a photo."""


def build_request(interface: str, case: Case) -> Request[Any]:
    """Build the request for a case; its arrays are writable copies."""
    kind = INTERFACES[interface]
    inputs: dict[str, Any] = {
        "image": case.empty if kind.sees == "inpainted" else case.photo,
        "mask": case.hole,
        "people": case.people,
        "intrinsics": case.intrinsics,
        "keypoints": case.keypoints,
        "bodies": case.bodies,
        "hints": Hints(**{name: getattr(case, name) for name in kind.hints}),
    }
    arguments = {
        field.name: inputs[field.name] for field in fields(kind.Request) if not field.kw_only
    }
    # deepcopy makes the arrays writable: a backend that writes to them is then detected.
    return deepcopy(kind.Request(**arguments))


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


def mirrored(request: Any) -> Any:
    """Return the request for the mirrored photo, without the hints that belong to pixels."""
    width = request.image.shape[1]

    def of_people(people: Any) -> Any:
        boxes = people.boxes[:, [2, 1, 0, 3]] * [-1, 1, -1, 1] + [width, 0, width, 0]
        return replace(people, masks=np.ascontiguousarray(people.masks[..., ::-1]), boxes=boxes)

    def of_keypoints(keypoints: Any) -> Any:
        joints = mirrored_order(keypoints.joint_set.names)
        points = [width - 1, 0] + keypoints.points[:, joints] * [-1, 1]
        return replace(keypoints, points=points, confidence=keypoints.confidence[:, joints])

    makes: dict[str, Callable[[Any], Any]] = {
        "image": lambda image: np.ascontiguousarray(image[:, ::-1]),
        "people": of_people,
        "keypoints": of_keypoints,
        "intrinsics": lambda camera: replace(camera, cx=width - 1 - camera.cx),
        "hints": lambda hints: replace(hints, **dict.fromkeys(OF_PIXELS)),
    }
    return replace(
        request,
        **{
            name: make(getattr(request, name))
            for name, make in makes.items()
            if name in vars(request)
        },
    )
