"""Outputs of networks in the cache of backend results: a backend whose other inputs changed need not run them again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.cache.result_cache import ResultCache

    Arrays = tuple[NDArray[Any], ...]

_CACHE: ContextVar[ResultCache | None] = ContextVar("cache of network results", default=None)


@contextmanager
def network_results_in(cache: ResultCache | None) -> Iterator[None]:
    """Keep outputs of networks in a cache inside the block, in this thread; None keeps none."""
    token = _CACHE.set(cache)
    try:
        yield
    finally:
        _CACHE.reset(token)


def cached_network_result(
    name: str, made_of: str, inputs: Mapping[str, NDArray[Any]], compute: Callable[[], Arrays]
) -> Arrays:
    """Return the outputs of a network for these inputs from the cache, or compute and keep them.

    Args:
        name: of the network, a part of the name of the file.
        made_of: what determines the outputs beside the inputs: weights, runtime, names of the outputs.
        inputs: of the network, by name.
        compute: runs the network.
    """
    cache = _CACHE.get()
    if cache is None:
        return compute()
    key = cache.network_key(name, made_of, inputs)
    found: Any = cache.read(key)
    if found is None:
        found = compute()
        cache.write(key, found)
    return tuple(found)
