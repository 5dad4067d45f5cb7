"""What a backend is given for a case, whether its interface allows the result, and whether two results agree."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.interfaces import INTERFACES
from physic_core.interfaces.backend import violations as check_result
from physic_core.types import Hints, People

if TYPE_CHECKING:
    from physic_core.interfaces import Backend, Request
    from physic_testing.conformance.cases import Case

__all__ = ["arrays", "as_views", "changed", "difference", "form_faults", "inputs", "request_for", "violations"]

_SAME = 1e-3  # of the largest value; threads of a network add up in any order
_SAME_SHARE = 1e-3  # of the pixels of a mask or an image
_SAME_GREY = 2


def request_for(interface: str, case: Case) -> Request[Any]:
    """What a backend of an interface is given for a case, copied: nobody else sees what a backend does to it."""
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
    # Copies of read-only arrays can be written to: a backend that does must be found, not stopped.
    return deepcopy(kind.Request(**given))


def inputs(interface: str, case: Case) -> tuple[Any, ...]:
    """Arguments of ``infer`` for a case, copied."""
    return request_for(interface, case).arguments


def form_faults(interface: str, answer: Any, case: Case) -> list[str]:
    """What is wrong with a result's type, shapes, dtypes and ranges; nothing about its truth."""
    return check_result(INTERFACES[interface], answer, request_for(interface, case))


def violations(
    interface: type[Backend], result: object, *, height: int = 1, width: int = 1, people: int = 0, **more: Any
) -> list[str]:
    """How a result violates its interface, one sentence each: for unit tests that call no backend.

    Args:
        interface: such as ``MetricDepth``.
        result: what ``infer`` returned.
        height: of the image that was given, px.
        width: of the same.
        people: number of people that were given.
        more: keyword-only fields of the interface's request.
    """
    image = np.zeros((height, width, 3), np.uint8)
    masks = np.zeros((people, height, width), bool)
    known = {"image": image, "people": People(masks, np.zeros((people, 4)), np.zeros(people))}
    given: dict[str, Any] = {
        field.name: known.get(field.name) for field in fields(interface.Request) if not field.kw_only
    }
    return check_result(interface, result, interface.Request(**given, **more))


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
