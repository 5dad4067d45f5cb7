"""Damaged files: the error of everything that a file may hold wrongly, and checked access to its content."""

from __future__ import annotations

import errno
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_SYSTEM_ERRORS = (errno.EACCES, errno.EPERM, errno.EIO, errno.ESTALE)
"""Of the operating system, where a copy of the file would not help either."""

GENDERS = ("neutral", "male", "female")
"""Of the body model files."""


class DamagedFrameError(InputError):
    """Raised if a file is missing, cut off, or has another content than its format states.

    It costs the frame of the file. Any other exception while a frame is read is an error of this program.
    """


def damaged_file_error(path: Path, error: BaseException, what: str = "") -> DamagedFrameError:
    """Return the error of a file that a library could not read.

    Args:
        path: of the file.
        error: of the library or the operating system, which gives the reason if it is not damage.
        what: before the path, such as "the picture ".
    """
    if isinstance(error, OSError) and error.errno in _SYSTEM_ERRORS:
        return DamagedFrameError(f"{what}{path} cannot be read: {error.strerror}")
    return DamagedFrameError(f"{what}{path} cannot be read: it is damaged or truncated, copy it again")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Add the path to the message of a DamagedFrameError that does not have it; errors of permissions become one."""
    try:
        yield
    except PermissionError as error:
        raise damaged_file_error(Path(error.filename or path), error) from error
    except DamagedFrameError as error:
        if str(path) in str(error):
            raise
        raise DamagedFrameError(f"{path}: {error}") from error


def as_numbers(value: Any, what: str) -> Array:
    """Return float64.

    Args:
        value: an array, or nested lists.
        what: the file and the name of the value, for the message.

    Raises:
        DamagedFrameError: the value is not an array of real numbers.
    """
    import numpy as np

    try:
        found = np.asarray(value)
        if found.dtype.kind not in "biuf":
            raise TypeError
        return found.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise DamagedFrameError(f"{what} holds no numbers") from error


def item(values: Mapping[str, Any], name: str, path: Path) -> Any:
    """Return an entry of a file.

    Raises:
        DamagedFrameError: the file has no such entry.
    """
    if name not in values:
        raise DamagedFrameError(f"{path} has no '{name}'; it has: {', '.join(sorted(map(str, values))) or 'nothing'}")
    return values[name]


def number_array(values: Mapping[str, Any], name: str, path: Path, shape: tuple[int, ...] | None = None) -> Array:
    """Return an array of a file, reshaped if ``shape`` is given; -1 is any length above 0.

    Raises:
        DamagedFrameError: the file has no such array, or it is not numeric or of another size.
    """
    found = as_numbers(item(values, name, path), f"{path}: '{name}'")
    return found if shape is None else _reshaped(found, shape, f"{path}: '{name}'")


def require_finite(values: Array, what: str) -> Array:
    """Return values.

    Raises:
        DamagedFrameError: some are not finite.
    """
    import numpy as np

    if not np.isfinite(values).all():
        raise DamagedFrameError(f"{what} has values that are not finite")
    return values


def require_rotation(matrix: Array, what: str) -> Array:
    """Return a matrix (3, 3).

    Raises:
        DamagedFrameError: it is not a rotation: scaled, a mirror image, or not finite.
    """
    import numpy as np

    require_finite(matrix, what)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-2 or np.linalg.det(matrix) < 0:
        raise DamagedFrameError(f"{what} is not a rotation: it is scaled or a mirror image")
    return matrix


def _reshaped(found: Array, shape: tuple[int, ...], what: str) -> Array:
    size = 1
    for side in shape:
        size *= side if side > 0 else 1
    if found.size == 0 or found.size % size or (-1 not in shape and found.size != size):
        raise DamagedFrameError(f"{what} must have the shape {shape}, got {found.shape}")
    return found.reshape(shape)
