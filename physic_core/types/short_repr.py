"""Short ``repr`` of dataclasses: arrays and tensors are printed as dtype and shape."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

_MAX_PRINTED_VALUES = 4
_MAX_TEXT_LENGTH = 60


class ShortRepr:
    """Base class of dataclasses with arrays; their ``repr`` prints dtype and shape of each
    array.
    """

    def __init_subclass__(cls, **settings: Any) -> None:
        super().__init_subclass__(**settings)
        if "__repr__" not in vars(cls):
            cls.__repr__ = _repr  # type: ignore[method-assign]  # else @dataclass writes its own


def _repr(self: Any) -> str:
    shown = ", ".join(f"{f.name}={_format(getattr(self, f.name))}" for f in fields(self))
    return f"{type(self).__name__}({shown})"


def _format(value: Any) -> str:
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        shape = tuple(value.shape)
        if math.prod(shape) <= _MAX_PRINTED_VALUES and shape:
            return f"[{', '.join(f'{number:.4g}' for number in value.reshape(-1).tolist())}]"
        return f"{str(value.dtype).removeprefix('torch.')} {shape}"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, str) and len(value) > _MAX_TEXT_LENGTH:
        return repr(f"{value[:_MAX_TEXT_LENGTH]}...")
    if isinstance(value, Mapping) and value:
        return f"<{len(value)} keys>"
    if isinstance(value, (tuple, list)) and value:
        return f"<{len(value)} x {type(value[0]).__name__}>"
    return repr(value)
