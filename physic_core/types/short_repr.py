"""A ``repr`` of dataclasses that fits on a screen: arrays and tensors as their type and shape."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

__all__ = ["ShortRepr"]

_FEW = 4
_LONGEST_TEXT = 60


class ShortRepr:
    """Base of dataclasses that hold arrays."""

    def __init_subclass__(cls, **settings: Any) -> None:
        super().__init_subclass__(**settings)
        if "__repr__" not in vars(cls):
            cls.__repr__ = _repr  # type: ignore[method-assign]  # else @dataclass writes its own


def _repr(self: Any) -> str:
    return f"{type(self).__name__}({', '.join(f'{f.name}={_shown(getattr(self, f.name))}' for f in fields(self))})"


def _shown(value: Any) -> str:
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        shape = tuple(value.shape)
        if math.prod(shape) <= _FEW and shape:
            return f"[{', '.join(f'{number:.4g}' for number in value.reshape(-1).tolist())}]"
        return f"{str(value.dtype).removeprefix('torch.')} {shape}"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, str) and len(value) > _LONGEST_TEXT:
        return repr(f"{value[:_LONGEST_TEXT]}...")
    if isinstance(value, Mapping) and value:
        return f"<{len(value)} keys>"
    if isinstance(value, (tuple, list)) and value:
        return f"<{len(value)} x {type(value[0]).__name__}>"
    return repr(value)
