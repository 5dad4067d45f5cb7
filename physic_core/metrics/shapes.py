"""Checks of the shapes of a metric's inputs: a wrong shape is refused before it broadcasts into a wrong number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray

__all__ = ["require_flags", "require_same_shape"]


def require_same_shape(what: str, predicted: NDArray[Any], truth: NDArray[Any]) -> None:
    """Raise unless both have one shape.

    Args:
        what: plural name for the message, "joints".
        predicted: any array.
        truth: any array.

    Raises:
        PhysicError: the shapes differ.
    """
    if predicted.shape != truth.shape:
        raise PhysicError(
            f"Predicted and true {what} must have one shape, got {predicted.shape} and {truth.shape}: "
            "match the people first, and bring both to one joint set or mesh."
        )


def require_flags(what: str, values: NDArray[Any]) -> BoolArray:
    """The array itself, when it is bool.

    Args:
        what: name for the message, "predicted contact".
        values: any array.

    Raises:
        PhysicError: the values are not bool; a probability cast to bool would count everything over zero.
    """
    if values.dtype != np.bool_:
        raise PhysicError(f"The {what} must be bool, got {values.dtype}: threshold it first, as in probability >= 0.5.")
    return values
