"""Check the shapes and types of a metric's inputs before they broadcast to a wrong result."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from physic_core.types import AnyArray, BoolArray


def require_same_shape(what: str, predicted: AnyArray, truth: AnyArray) -> None:
    """Raise PhysicError if two arrays differ in shape; ``what`` is their plural name for the
    message.
    """
    if predicted.shape != truth.shape:
        raise PhysicError(
            f"Predicted and true {what} must have the same shape, got {predicted.shape} and "
            f"{truth.shape}: match the people first, and bring both to one joint set or mesh."
        )


def require_bool_dtype(what: str, values: AnyArray) -> BoolArray:
    """Return the array, or raise PhysicError if it is not bool.

    A probability converted to bool would count every value above zero.
    """
    if values.dtype != np.bool_:
        raise PhysicError(
            f"The {what} must be bool, got {values.dtype}: threshold it first, as in probability "
            f">= 0.5."
        )
    return values
