"""Third-party pickles, read by the core's numpy-only reader: anything but numbers is refused by its name."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

from physic_bench.damage import DamagedFrameError
from physic_core.body.files.array_pickle import (
    InvalidArrayError,
    PickledObject,
    UnsafePickleError,
    as_array,
    escape_unprintable,
    read_pickle,
)

_DAMAGED = (pickle.UnpicklingError, EOFError, ValueError, KeyError, IndexError, TypeError, AttributeError)
"""What the standard library raises for a pickle that is cut off or damaged."""


def pickled_arrays(path: Path) -> dict[str, Any]:
    """Return the content of a pickle, Python 2's too: arrays, numbers, texts, lists and dictionaries of them.

    Raises:
        DamagedFrameError: the file does not exist, is cut off, or names anything that could run code.
    """
    try:
        return {name: _plain(value) for name, value in read_pickle(path).items()}
    except FileNotFoundError as error:
        raise DamagedFrameError(f"there is no file {path}") from error
    except OSError as error:
        raise DamagedFrameError(f"{path} cannot be read: {error.strerror}") from error
    except UnsafePickleError as error:
        raise DamagedFrameError(
            f"{path} holds {error}, which is refused: only arrays of numbers are read from a pickle, since others can "
            "run code. Save NumPy arrays instead (tensor.detach().cpu().numpy())"
        ) from error
    except InvalidArrayError as error:
        raise DamagedFrameError(f"{path} {error}") from error
    except RecursionError as error:
        raise DamagedFrameError(f"{path} is nested too deeply to be a result") from error
    except _DAMAGED as error:
        reason = escape_unprintable(str(error)) or type(error).__name__
        raise DamagedFrameError(
            f"{path} is not a complete pickle ({reason}): it is damaged or truncated, copy it again"
        ) from error


def _plain(value: Any, depth: int = 0) -> Any:
    if depth > 20:
        raise InvalidArrayError("is nested too deeply to be a result")
    if isinstance(value, PickledObject):
        return as_array(value)
    if isinstance(value, dict):
        return {key: _plain(part, depth + 1) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part, depth + 1) for part in value]
    return value
