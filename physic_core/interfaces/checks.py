"""Checks of single values for all interfaces; each yields one sentence per violation.

Numbers have bounds far beyond every real estimate, and within what the engine and every output file
can hold. A person with a number beyond them is treated as a person with a NaN.

NumPy is imported inside functions: a command that only lists plugins must not wait for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import fields
from numbers import Real
from typing import TYPE_CHECKING, Any

from physic_core.errors import InputError
from physic_core.types import Intrinsics

if TYPE_CHECKING:
    from physic_core.types import BoolArray


PIXELS = 1e5
"""Largest magnitude of a keypoint's coordinate, px."""

METRES = 1e4
"""Largest magnitude of a coordinate of a body, its joints or its vertices, m."""

RADIANS = 2 * math.pi
"""Largest magnitude of a component of a rotation vector, rad; degrees are beyond."""

SHAPE = 100.0
"""Largest magnitude of a shape or expression component.

Its unit is a standard deviation among people.
"""

DEPTH_M = (1e-3, 1e5)
"""Smallest and largest median of a depth map, m.

Single pixels may be beyond: of the sky, for example.
"""

RELATIVE_DEPTH = (1e-9, 1e9)
"""Smallest and largest median z of a relative point map."""

FOCAL_SHARE = (1e-4, 1e4)
"""Smallest and largest focal length, as shares of the long side of the image."""

PRINCIPAL_SHARE = 100.0
"""Largest distance of the principal point from the image's corner, as a share of the long side."""

SIGMA = 1e3
"""Largest standard deviation of a logarithm."""


def require_image(image: object) -> None:
    """Raise InputError unless an image is a numpy array (H, W, 3) of uint8 with at least one
    pixel.
    """
    import numpy as np

    wanted = "the image must be a numpy array (H, W, 3) of uint8 RGB"
    if not isinstance(image, np.ndarray):
        raise InputError(f"{wanted}, got {type(image).__name__}{tensor_advice(image)}")
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
        raise InputError(f"{wanted}, got {image.shape} {image.dtype}: convert it before the call")


def check_type(value: object, expected: type, name: str = "") -> Iterator[str]:
    """Check that a value is an instance of a class."""
    if not isinstance(value, expected):
        subject = f"{name} must be" if name else "expected"
        yield f"{subject} {expected.__name__}, got {type(value).__name__}{tensor_advice(value)}"


def check_array(name: str, value: Any, shape: tuple[int, ...], kind: str) -> Iterator[str]:
    """Check the type, shape and dtype of a numpy array; "float" accepts floats of up to 64 bits,
    "int" all integers.
    """
    import numpy as np

    # Subclasses change the meaning of operators, and a masked array has values that are not
    # results.
    if type(value) not in (np.ndarray, np.memmap):
        yield (
            f"{name} must be a numpy array {_shape_text(shape)}, got "
            f"{type(value).__name__}{_array_advice(value)}"
        )
        return
    if tuple(value.shape) != shape:
        yield f"{name} must be {_shape_text(shape)}, got {_shape_text(tuple(value.shape))}"
    # Neither torch nor SciPy's filters take the wider floats of some machines.
    is_float = value.dtype.kind == "f" and value.dtype.itemsize <= 8
    fits = {"float": is_float, "int": value.dtype.kind in "iu"}
    if not fits.get(kind, value.dtype == kind):
        yield f"{name} must be {kind}, got {value.dtype}"


_KINDS = {"BoolArray": "bool", "FloatArray": "float", "IntArray": "int", "UInt8Array": "uint8"}


def check_fields(record: Any, name: str = "", **sizes: int) -> list[str]:
    """Check the arrays of a dataclass: their shapes by the metadata of its fields, their dtypes by
    the types of these.

    Args:
        record: of :mod:`physic_core.types`.
        name: of the record, with a dot at its end, for messages.
        sizes: by letter of the shapes; that of another letter is the size in the first array with
            it.
    """
    wrong: list[str] = []
    for one in fields(record):
        value = getattr(record, one.name)
        kind, _, optional = str(one.type).partition(" | ")
        dims = one.metadata.get("shape")
        if dims is None or (optional and value is None):
            continue
        shape = getattr(value, "shape", ())
        if len(shape) == len(dims):
            sizes = dict(zip(map(str, dims), shape, strict=True)) | sizes
        wanted = tuple(n if isinstance(n, int) else sizes.get(n, 0) for n in dims)
        wrong += check_array(name + one.name, value, wanted, _KINDS[kind])
    return wrong


def check_finite(name: str, value: Any) -> Iterator[str]:
    """Check that all values of an array are finite."""
    finite = is_finite(value)
    if not finite.all():
        yield f"{name} must be finite, {int((~finite).sum())} values are not"


def check_limit(name: str, value: Any, limit: float, unit: str = "") -> Iterator[str]:
    """Check that all values of an array are finite, and at most ``limit`` in magnitude."""
    yield from check_finite(name, value)
    finite = value[is_finite(value)]
    if not within_limit(finite, limit).all():
        extreme = max(finite.min(), finite.max(), key=abs)
        advice = {"rad": ": is it in degrees?", "m": ": is it in millimeters?"}.get(unit, "")
        bound = f"+-{limit:.6g}{unit and ' ' + unit}"
        yield f"{name} must lie within {bound}, got {float(extreme):g}{advice}"


def check_median(
    name: str, value: Any, limits: tuple[float, float], unit: str = ""
) -> Iterator[str]:
    """Check that the median of an array lies within limits."""
    import numpy as np

    low, high = limits
    median = float(np.median(value))
    if not low <= median <= high:
        yield (
            f"the median of {name} must lie between {low:g} and {high:g}{unit and ' ' + unit}, "
            f"got {median:g}"
        )


def check_unit_range(name: str, value: Any) -> Iterator[str]:
    """Check that all values of an array lie in [0, 1]."""
    low = float(value.min(initial=0))
    high = float(value.max(initial=0))
    if not (low >= 0 and high <= 1):
        yield f"{name} must lie in [0, 1], got {low:g} to {high:g}"


def check_faces(name: str, faces: Any, vertices: int) -> Iterator[str]:
    """Check that faces (F, 3) are in [0, ``vertices``)."""
    if len(faces) and not 0 <= int(faces.min()) <= int(faces.max()) < vertices:
        yield (
            f"{name} must number the {vertices} vertices from 0, got {int(faces.min())} to "
            f"{int(faces.max())}"
        )


def check_camera(camera: Intrinsics | None, height: int, width: int) -> Iterator[str]:
    """Check that intrinsics are finite, positive and for an image of ``height`` x ``width`` px;
    None is valid.
    """
    if camera is None:
        return
    wrong_type = list(check_type(camera, Intrinsics, "intrinsics"))
    if wrong_type:
        yield from wrong_type
        return
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    if not all(isinstance(v, Real) and math.isfinite(v) for v in numbers):
        stated = ", ".join(map(str, numbers))
        yield (
            f"intrinsics must be finite numbers fx, fy, cx, cy with fx > 0 and fy > 0, got {stated}"
        )
    else:
        side = max(height, width)
        low, high = (share * side for share in FOCAL_SHARE)
        if not low <= min(camera.fx, camera.fy) <= max(camera.fx, camera.fy) <= high:
            yield (
                f"fx and fy must lie between {low:g} and {high:g} px for this image, got "
                f"{camera.fx:g}, {camera.fy:g}"
            )
        if max(abs(camera.cx), abs(camera.cy)) > PRINCIPAL_SHARE * side:
            yield (
                f"cx and cy must lie within +-{PRINCIPAL_SHARE * side:g} px for this image, got "
                f"{camera.cx:g}, {camera.cy:g}"
            )
    if (camera.width, camera.height) != (width, height):
        yield f"intrinsics must be for {width} x {height} px, got {camera.width} x {camera.height}"
    yield from check_type(camera.source, str, "intrinsics.source")
    if camera.focal_sigma is not None:
        yield from check_log_sigma("intrinsics.focal_sigma", camera.focal_sigma)


def check_log_sigma(name: str, sigma: Any) -> Iterator[str]:
    """Check that a standard deviation of a logarithm is a number from 0 to the limit."""
    if not (isinstance(sigma, Real) and 0 <= float(sigma) <= SIGMA):
        yield f"{name} must be a number from 0 to {SIGMA:g} or None, got {sigma!r}"


def check_notes(notes: Any, name: str = "notes") -> Iterator[str]:
    """Check that notes or warnings are a tuple or list of texts."""
    if not (isinstance(notes, tuple | list) and all(isinstance(note, str) for note in notes)):
        yield f"{name} must be a tuple of texts, got {notes!r}"


def is_finite(value: Any) -> BoolArray:
    """Return a bool array: True for values that are neither NaN nor infinite."""
    import numpy as np

    finite: BoolArray = np.isfinite(value)
    return finite


def within_limit(value: Any, limit: float) -> BoolArray:
    """Return a bool array: True for values that are finite, and at most ``limit`` in magnitude."""
    import numpy as np

    inside: BoolArray = (value >= -limit) & (value <= limit) & np.isfinite(value)
    return inside


def valid_rows(arrays: Iterable[tuple[Any, float]], rows: int) -> BoolArray:
    """Return (rows,) bool: True for rows that are within its limit in every one of the arrays
    (rows, ...).
    """
    import numpy as np

    valid = np.ones(rows, bool)
    for array, limit in arrays:
        valid &= within_limit(array, limit).all(axis=tuple(range(1, array.ndim)))
    return valid


def rows_to_check(valid: BoolArray) -> BoolArray:
    """Return a mask of the rows to validate: the valid rows, or all rows if no row is valid."""
    return valid if valid.any() else ~valid


def length(value: Any) -> int:
    """Return the number of rows of an array; 0 for any other value."""
    return len(value) if getattr(value, "ndim", 0) else 0


def tensor_advice(value: object) -> str:
    """Return advice to convert a torch tensor to numpy; "" if the value is not a tensor."""
    return (
        ": write .detach().cpu().numpy()"
        if type(value).__module__.partition(".")[0] == "torch"
        else ""
    )


def _array_advice(value: object) -> str:
    import numpy as np

    if isinstance(value, np.ma.MaskedArray):
        return ": write .filled(...), with NaN or False where it is masked"
    return ": write numpy.asarray(...)" if isinstance(value, np.ndarray) else tensor_advice(value)


def _shape_text(shape: tuple[int, ...]) -> str:
    return "(" + ", ".join(map(str, shape)) + ")"
