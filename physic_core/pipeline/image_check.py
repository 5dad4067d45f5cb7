"""How the core calls a backend: never with what is no photo, so that no backend has to look."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from physic_core.errors import InputError
from physic_core.pipeline.validation import tensor_advice

if TYPE_CHECKING:
    from physic_core.interfaces import Backend

__all__ = ["check_photo", "infer"]


def infer(backend: Backend, inputs: tuple[Any, ...]) -> object:
    """What a backend returns for the arguments of its interface, of which the photo is the first.

    Raises:
        InputError: the first argument is no photo; the backend is not called.
    """
    check_photo(inputs[0])
    call: Any = backend
    answer: object = call.infer(*inputs)
    return answer


def check_photo(image: object) -> None:
    """Refuse what is no photo; as its values are whole numbers, they are finite.

    Raises:
        InputError: it is not a numpy array (H, W, 3) of uint8 with at least one pixel.
    """
    import numpy as np

    wanted = "the image must be a numpy array (H, W, 3) of uint8 RGB"
    if not isinstance(image, np.ndarray):
        raise InputError(f"{wanted}, got {type(image).__name__}{tensor_advice(image)}")
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
        raise InputError(f"{wanted}, got {image.shape} {image.dtype}: convert it before the call")
