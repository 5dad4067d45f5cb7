"""Convert arrays of backends to tensors of the engine and back; convert dataclasses of tensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch

if TYPE_CHECKING:
    from physic_core.types import AnyArray

_Record = TypeVar("_Record")


def tensor(array: AnyArray) -> torch.Tensor:
    """Convert an array to a tensor: floats to float32, other types unchanged.

    Data is copied only if the type changes or the array is read-only or not contiguous.
    """
    kind = np.float32 if array.dtype.kind == "f" else array.dtype
    return torch.from_numpy(np.require(array, kind, ["C", "W"]))


def tensors(*arrays: AnyArray) -> tuple[torch.Tensor, ...]:
    """Convert each array as :func:`tensor` does."""
    return tuple(map(tensor, arrays))


def optional_tensors(*arrays: AnyArray | None) -> tuple[torch.Tensor | None, ...]:
    """Convert each array as :func:`tensor` does; None stays None."""
    return tuple(None if array is None else tensor(array) for array in arrays)


def arrays(**named: torch.Tensor) -> dict[str, Any]:
    """Convert tensors to arrays by their names: floats to float32, other types unchanged."""
    return {
        name: (values.float() if values.is_floating_point() else values).numpy()
        for name, values in named.items()
    }


def exact_arrays(*given: torch.Tensor) -> tuple[AnyArray, ...]:
    """Convert each tensor to an array: floats to float64, other types unchanged."""
    exact = (values.double() if values.is_floating_point() else values for values in given)
    return tuple(values.detach().numpy() for values in exact)


def to_dtype(record: _Record, dtype: torch.dtype) -> _Record:
    """Return a copy of a dataclass with its floating-point tensors in another type.

    Args:
        record: its fields are tensors, dataclasses, mappings and tuples of these, and others, which
            stay.
        dtype: of the copy.
    """
    copy: Any = record
    if isinstance(record, torch.Tensor):
        copy = record.to(dtype) if record.is_floating_point() else record
    elif is_dataclass(record) and not isinstance(record, type):
        parts = {
            field.name: to_dtype(getattr(record, field.name), dtype) for field in fields(record)
        }
        copy = replace(record, **parts)
    elif isinstance(record, Mapping):
        copy = {name: to_dtype(item, dtype) for name, item in record.items()}
    elif isinstance(record, tuple):
        copy = tuple(to_dtype(item, dtype) for item in record)
    return copy  # type: ignore[no-any-return]
