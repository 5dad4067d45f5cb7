"""What a backend of each interface is asked, what its answer must look like, and whether two answers are the same."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.pipeline import validation as border
from physic_core.types import (
    Bodies,
    ContactProbability,
    DepthMap,
    Hands,
    Hints,
    Keypoints,
    People,
    Pointmap,
)
from physic_testing.conformance.cases import known_hints

if TYPE_CHECKING:
    from physic_testing.conformance.cases import Case

__all__ = ["ANSWERS", "arrays", "as_views", "changed", "difference", "form_faults", "inputs"]

ANSWERS: dict[str, type] = {
    "segmenter": People,
    "inpainter": np.ndarray,
    "metric_depth": DepthMap,
    "relative_pointmap": Pointmap,
    "keypoint_detector": Keypoints,
    "body_estimator": Bodies,
    "hand_estimator": Hands,
    "contact_prior": ContactProbability,
}
"""Interface -> what its backends answer."""

_SAME = 1e-3  # of the largest value; threads of a network add up in any order
_SAME_SHARE = 1e-3  # of the pixels of a mask or an image
_SAME_GREY = 2


def inputs(interface: str, case: Case) -> tuple[Any, ...]:
    """Arguments of ``infer``, copied: nobody else sees what a backend does to them."""
    seen = Hints(intrinsics=case.intrinsics, people=case.people, keypoints=case.keypoints, hole=case.hole)
    given: dict[str, tuple[Any, ...]] = {
        "segmenter": (case.photo,),
        "inpainter": (case.photo, case.hole),
        "metric_depth": (case.empty, known_hints(case)),
        "relative_pointmap": (case.empty, seen),
        "keypoint_detector": (case.photo, case.people),
        "body_estimator": (
            case.photo,
            case.people,
            case.intrinsics,
            case.keypoints,
            replace(seen, hole=None, scene=case.scene, original=case.original, floor=case.floor),
        ),
        "hand_estimator": (case.photo, case.people, case.keypoints),
        "contact_prior": (case.photo, case.people, case.bodies),
    }
    # Copies of read-only arrays can be written to: a backend that does must be found, not stopped.
    return deepcopy(given[interface])


def form_faults(interface: str, answer: Any, case: Case) -> list[str]:
    """What is wrong with an answer's type, shapes, dtypes and ranges; nothing about its truth."""
    expected = ANSWERS[interface]
    if not isinstance(answer, expected):
        return [f"infer must return a {_name(expected)}, got {_name(type(answer))}{border.tensor_advice(answer)}"]
    height, width = case.photo.shape[:2]
    count = len(case.people)
    faults: dict[str, Callable[[Any], list[str]]] = {
        "segmenter": lambda a: border.people_faults(a, height, width),
        "inpainter": lambda a: border.image_faults(a, height, width),
        "metric_depth": lambda a: border.depth_faults(a, height, width),
        "relative_pointmap": lambda a: border.pointmap_faults(a, height, width),
        "keypoint_detector": lambda a: border.keypoints_faults(a, count),
        "body_estimator": lambda a: border.bodies_faults(a, count),
        "hand_estimator": lambda a: border.hands_faults(a, count),
        # On which mesh is a check of its own.
        "contact_prior": lambda a: border.contact_faults(a, count, a.probability.shape[-1], a.topology),
    }
    try:
        return faults[interface](answer)
    except (AttributeError, IndexError, TypeError, ValueError) as error:
        return [f"the {_name(expected)} holds something that cannot be read: {type(error).__name__}: {error}"]


def arrays(thing: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every array and value in an argument or an answer, with its place ("people.masks")."""
    if is_dataclass(thing) and not isinstance(thing, type):
        for field in fields(thing):
            yield from arrays(getattr(thing, field.name), f"{path}.{field.name}" if path else field.name)
    elif isinstance(thing, tuple) and any(is_dataclass(t) or isinstance(t, np.ndarray) for t in thing):
        for i, part in enumerate(thing):
            yield from arrays(part, f"{path}[{i}]")
    else:
        yield path, thing


def changed(before: tuple[Any, ...], after: tuple[Any, ...]) -> list[str]:
    """Places of the arguments that are not what they were."""
    pairs = zip(arrays(before), arrays(after), strict=True)
    return [path or "image" for (path, old), (_, new) in pairs if not _identical(old, new)]


def as_views(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """The same arguments, every array read-only and with strides that are not those of a fresh one."""
    return tuple(_as_view(argument) for argument in arguments)


def difference(first: Any, second: Any) -> str:
    """What tells two answers apart beyond rounding, in words; empty where nothing does."""
    left, right = list(arrays(first)), list(arrays(second))
    if [path for path, _ in left] != [path for path, _ in right]:
        return "the answers hold different fields"
    for (path, a), (_, b) in zip(left, right, strict=True):
        words = _difference(a, b)
        if words:
            return f"{path or 'image'}: {words}"
    return ""


def _as_view(thing: Any) -> Any:
    if isinstance(thing, np.ndarray):
        # Backwards in memory and forwards again, as a photo that was turned by its EXIF tag.
        view = np.ascontiguousarray(thing[..., ::-1])[..., ::-1] if thing.ndim else thing.copy()
        view.setflags(write=False)
        return view
    if is_dataclass(thing) and not isinstance(thing, type):
        return replace(thing, **{f.name: _as_view(getattr(thing, f.name)) for f in fields(thing)})
    return thing


def _identical(old: Any, new: Any) -> bool:
    if isinstance(old, np.ndarray):
        return isinstance(new, np.ndarray) and old.shape == new.shape and np.array_equal(old, new, _has_nan(old))
    return bool(old == new) or (old != old and new != new)


def _difference(a: Any, b: Any) -> str:
    if not isinstance(a, np.ndarray) or not isinstance(b, np.ndarray):
        same = _close(float(a), float(b)) if isinstance(a, float) and isinstance(b, float) else bool(a == b)
        return "" if same else f"{a!r} and {b!r}"
    if a.shape != b.shape:
        return f"shapes {a.shape} and {b.shape}"
    if not a.size:
        return ""
    if a.dtype.kind == "f":
        scale = float(np.abs(a[np.isfinite(a)]).max(initial=0))
        alike = np.isclose(a, b, rtol=_SAME, atol=_SAME * scale, equal_nan=True)
        other = int((~alike).sum())
        if other <= (_SAME_SHARE * a.size if a.ndim > 1 else 0):
            return ""
        gap = float(np.nanmax(np.abs(np.where(alike, 0, a.astype(np.float64) - b))))
        return f"{other} of {a.size} numbers differ, by up to {gap:.3g} where the largest is {scale:.3g}"
    apart = np.abs(a.astype(np.int64) - b.astype(np.int64)) > (_SAME_GREY if a.dtype == np.uint8 else 0)
    return f"{int(apart.sum())} of {a.size} values differ" if apart.mean() > _SAME_SHARE else ""


def _close(a: float, b: float) -> bool:
    return bool(np.isclose(a, b, rtol=_SAME, equal_nan=True))


def _has_nan(array: Any) -> bool:
    return bool(array.dtype.kind == "f")


def _name(kind: type) -> str:
    return "numpy array" if kind is np.ndarray else kind.__name__
