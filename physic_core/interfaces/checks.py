"""Checks of single values, shared by the interfaces. Each yields a sentence per violation, or nothing.

NumPy is imported inside functions: a command that only lists plugins must not wait for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from numbers import Real
from typing import TYPE_CHECKING, Any

from physic_core.errors import InputError
from physic_core.types import Intrinsics

if TYPE_CHECKING:
    from physic_core.types import BoolArray

__all__ = [
    "check_array",
    "check_camera",
    "check_faces",
    "check_finite",
    "check_notes",
    "check_type",
    "check_unit_range",
    "finite_rows",
    "is_finite",
    "length",
    "require_image",
    "rows_to_check",
    "tensor_advice",
]


def require_image(image: object) -> None:
    """Refuse what is no photo. Its values are integers, and so finite.

    Raises:
        InputError: it is not a numpy array (H, W, 3) of uint8 with at least one pixel.
    """
    import numpy as np

    wanted = "the image must be a numpy array (H, W, 3) of uint8 RGB"
    if not isinstance(image, np.ndarray):
        raise InputError(f"{wanted}, got {type(image).__name__}{tensor_advice(image)}")
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
        raise InputError(f"{wanted}, got {image.shape} {image.dtype}: convert it before the call")


def check_type(value: object, expected: type, name: str = "") -> Iterator[str]:
    """The value is an instance of a class."""
    if not isinstance(value, expected):
        subject = f"{name} must be" if name else "expected"
        yield f"{subject} {expected.__name__}, got {type(value).__name__}{tensor_advice(value)}"


def check_array(name: str, value: Any, shape: tuple[int, ...], kind: str) -> Iterator[str]:
    """The value is a numpy array of a shape, and of "float" (any width) or of a dtype such as "bool"."""
    import numpy as np

    if not isinstance(value, np.ndarray):
        yield f"{name} must be a numpy array {_text(shape)}, got {type(value).__name__}{tensor_advice(value)}"
        return
    if tuple(value.shape) != shape:
        yield f"{name} must be {_text(shape)}, got {_text(tuple(value.shape))}"
    if not (value.dtype.kind == "f" if kind == "float" else value.dtype == kind):
        yield f"{name} must be {kind}, got {value.dtype}"


def check_finite(name: str, value: Any) -> Iterator[str]:
    """No value is NaN or infinite."""
    finite = is_finite(value)
    if not finite.all():
        yield f"{name} must be finite, {int((~finite).sum())} values are not"


def check_unit_range(name: str, value: Any) -> Iterator[str]:
    """All values lie in [0, 1]."""
    low, high = float(value.min(initial=0)), float(value.max(initial=0))
    if not (low >= 0 and high <= 1):
        yield f"{name} must lie in [0, 1], got {low:g} to {high:g}"


def check_faces(name: str, faces: Any, vertices: int) -> Iterator[str]:
    """Triangles (F, 3), integers of any width that index ``vertices`` vertices."""
    count = length(faces)
    if getattr(faces, "dtype", None) is not None and faces.dtype.kind not in "iu":
        yield f"{name} must be integers, got {faces.dtype}"
        return
    wrong = list(check_array(name, faces, (count, 3), str(getattr(faces, "dtype", ""))))
    yield from wrong
    if not wrong and count and not 0 <= int(faces.min()) <= int(faces.max()) < vertices:
        yield f"{name} must number the {vertices} vertices from 0, got {int(faces.min())} to {int(faces.max())}"


def check_camera(camera: Intrinsics | None, height: int, width: int) -> Iterator[str]:
    """A camera that a backend returns with its result is a camera of the image that it was given."""
    if camera is None:
        return
    wrong_type = list(check_type(camera, Intrinsics, "intrinsics"))
    if wrong_type:
        yield from wrong_type
        return
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    if not all(isinstance(v, Real) and math.isfinite(v) for v in numbers) or min(camera.fx, camera.fy) <= 0:
        given = ", ".join(map(str, numbers))
        yield f"intrinsics must be finite numbers fx, fy, cx, cy with fx > 0 and fy > 0, got {given}"
    if (camera.width, camera.height) != (width, height):
        yield f"intrinsics must be for {width} x {height} px, got {camera.width} x {camera.height}"
    yield from check_type(camera.source, str, "intrinsics.source")


def check_notes(notes: Any) -> Iterator[str]:
    """Notes for the user are a sequence of texts."""
    if not (isinstance(notes, tuple | list) and all(isinstance(note, str) for note in notes)):
        yield f"notes must be a tuple of texts, got {notes!r}"


def is_finite(value: Any) -> BoolArray:
    """Which values are neither NaN nor infinite."""
    import numpy as np

    finite: BoolArray = np.isfinite(value)
    return finite


def finite_rows(arrays: Iterable[Any], rows: int) -> BoolArray:
    """(rows,) bool: rows of arrays (rows, ...) that are finite in every array."""
    import numpy as np

    finite = np.ones(rows, bool)
    for array in arrays:
        finite &= np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    return finite


def rows_to_check(finite: BoolArray) -> BoolArray:
    """The rows whose values are checked: the finite ones, or all rows if none is finite."""
    return finite if finite.any() else ~finite


def length(value: Any) -> int:
    """Number of rows of an array; 0 for anything else."""
    return len(value) if getattr(value, "ndim", 0) else 0


def tensor_advice(value: object) -> str:
    """How to make a numpy array of a torch tensor; empty for anything else."""
    return ": write .detach().cpu().numpy()" if type(value).__module__.partition(".")[0] == "torch" else ""


def _text(shape: tuple[int, ...]) -> str:
    return "(" + ", ".join(map(str, shape)) + ")"
