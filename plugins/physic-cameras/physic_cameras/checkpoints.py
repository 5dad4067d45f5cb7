"""Fill networks with published parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from physic_core.errors import BackendError

if TYPE_CHECKING:
    from pathlib import Path


def fill(network: Any, state: dict[str, Any], path: Path) -> None:
    """Load all parameters of a network; buffers that it computes itself may be missing.

    Raises:
        BackendError: parameters are missing, or of other shapes.
    """
    try:
        missing = set(network.load_state_dict(state, strict=False)[0])
    except (RuntimeError, TypeError, AttributeError) as error:
        raise BackendError(f"{path} is not a checkpoint of {type(network).__name__}: {error}") from error
    named = dict(network.named_parameters(remove_duplicate=False))
    # A tensor with several names can be in the file once.
    filled = {id(tensor) for name, tensor in named.items() if name not in missing}
    absent = sorted(name for name, tensor in named.items() if id(tensor) not in filled)
    if absent:
        raise BackendError(
            f"{path} is not a checkpoint of {type(network).__name__}: {len(absent)} tensors are missing, such as "
            f"{absent[0]}"
        )
