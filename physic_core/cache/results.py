"""Cache of results: with equal inputs, a backend is neither called nor loaded, and a network does
not run.

The key is a digest of everything that can change a result: the inputs; the backend (interface,
name, distribution, version, code, required libraries, options, device, files in the options, and
its ``fingerprint``); and the version of its interface. If you change one backend, only it and the
backends whose inputs change run again. A backend whose other inputs changed can still take the
outputs of its networks from the cache.

The folder is ``$XDG_CACHE_HOME/physic/results``, or the system's default cache folder. Set
``PHYSIC_CACHE`` to another folder, or to "off".
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_origin

import numpy as np
from numpy.typing import NDArray

from physic_core.cache.digests import CodeDigester, Digester, files_named_by
from physic_core.cache.folders import CACHES, LruFolder, claimed_cache, plain_name
from physic_core.discovery.entry_points import required_versions
from physic_core.errors import OutputError
from physic_core.files.npz import MAX_ARRAY_BYTES
from physic_core.files.serialization import (
    Arrays,
    DamagedFileError,
    join,
    read_value,
    split,
    write_value,
)
from physic_core.interfaces import INTERFACES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.interfaces import Backend
    from physic_core.types import AnyArray, Provenance

_T = TypeVar("_T")

KINDS = (
    *(interface.Result for interface in INTERFACES.values() if interface.Result is not object),
    NDArray[Any],
    tuple[NDArray[Any], ...],
)
"""Types of results that can be stored: of interfaces, and of networks."""


def canonicalize(result: _T) -> _T:
    """Convert a result to the form that the cache returns, so that runs with and without cache
    agree bit for bit.

    Arrays become C-contiguous copies in the machine's order of bytes, the only one that torch
    takes: their order in memory changes sums, and the backend may use its arrays again. NumPy
    scalars become Python numbers. A result that cannot be stored is copied deeply.
    """
    try:
        return restored(result, copies=True)
    except TypeError:
        return copy.deepcopy(result)


def restored(result: _T, *, copies: bool = False) -> _T:
    """Return a result as it is after it was stored, with its own arrays or with C-contiguous
    copies.

    Raises:
        TypeError: it cannot be stored.
    """
    arrays: Arrays = {}
    kind = next((one for one in KINDS if type(result) is (get_origin(one) or one)), None)
    if kind is None:
        raise TypeError(f"a {type(result).__name__} cannot be stored.")
    document = split(result, arrays)
    if any(array.dtype.hasobject for array in arrays.values()):
        raise TypeError("an array of Python objects cannot be stored.")
    if copies:
        arrays = {
            name: np.array(array, array.dtype.newbyteorder("="), order="C")
            for name, array in arrays.items()
        }
    try:
        same: _T = join(kind, document, arrays)
    except ValueError as error:
        raise TypeError(f"{error}: it cannot be stored.") from error
    return same


def made_of(backend: Backend, who: Provenance, code: str) -> dict[str, Any]:
    """Return what a backend's results depend on beside its inputs, options, device and the files
    that options name.

    Args:
        backend: need not be loaded.
        who: the backend is.
        code: digest of the source code of its class.

    Raises:
        Exception: raised by the backend's ``fingerprint``.
    """
    kind = type(backend)
    return {
        "api": INTERFACES[who.interface].api,
        "class": f"{kind.__module__}.{kind.__qualname__}",
        "code": code,
        "distribution": who.distribution,
        "fingerprint": str(backend.fingerprint()),
        "libraries": required_versions("metricbody") | required_versions(who.distribution),
        "version": who.version,
    }


@dataclass(frozen=True)
class CacheKey:
    """Cache key of one backend call.

    Attributes:
        name: of the cache file.
        backend: description of the backend, stored in the file.
    """

    name: str
    backend: Mapping[str, Any]


_VERSION = 4
"""Version of the file format; increase it if old files would be read differently or fail a stricter
validation.
"""


class ResultCache:
    """Cache of backend results in one folder.

    Attributes:
        notes: problems with cache files, as sentences for the user.
    """

    def __init__(self, folder: Path, limit: int, code: CodeDigester | None = None) -> None:
        """Open the cache in a folder.

        Args:
            folder: created when the first result is stored.
            limit: maximum size of all files, bytes.
            code: computes digests of the backends' source code.
        """
        self.notes: list[str] = []
        self._files = LruFolder(folder, CACHES["results"][1])
        self._folder = folder
        self._limit = limit
        self._written = False
        self._code = code or CodeDigester()
        self._digester = Digester()

    @classmethod
    def in_users_folder(
        cls, megabytes: int, code: CodeDigester | None = None
    ) -> ResultCache | None:
        """Open the cache in the user's cache folder; None if it is disabled, or belongs to another
        user.
        """
        kept = claimed_cache("results")
        return None if kept is None else cls(kept.path, megabytes * 1_000_000, code)

    def key(
        self, backend: Backend, who: Provenance, device: str, inputs: tuple[object, ...]
    ) -> CacheKey | None:
        """Compute the cache key of a backend call; None if results of this backend are not cached.

        Raises:
            Exception: raised by the backend's ``fingerprint``.
        """
        kind = type(backend)
        code = self._code.digest(kind) if kind.cacheable else None
        if code is None:
            return None
        parts = {
            **asdict(who),
            **made_of(backend, who, code),
            "device": device,
            "files": list(files_named_by(who.options)),
        }
        try:
            name = self._digester.digest(_VERSION, parts, inputs)
        except TypeError:
            return None
        return CacheKey(
            f"{who.interface}-{plain_name(who.backend)}-{name}{self._files.suffix}", parts
        )

    def network_key(self, name: str, made_of: str, inputs: Mapping[str, AnyArray]) -> CacheKey:
        """Compute the cache key of the outputs of a network; see
        :mod:`physic_core.cache.results`.
        """
        # a separate one does not keep the inputs alive
        digest = Digester().digest(_VERSION, made_of, inputs)
        return CacheKey(
            f"network-{plain_name(name)}-{digest}{self._files.suffix}",
            {"interface": "network", "name": name},
        )

    def read(self, key: CacheKey) -> object | None:
        """Read a cached result; None if the cache has none.

        Delete a file that is damaged or has another key.
        """
        path = self._folder / key.name
        try:
            result: object = read_value(path, KINDS, {"name": key.name})
        except OSError:
            return None
        except DamagedFileError as error:
            self.discard(key, str(error))
            return None
        self._files.mark_used(key.name)
        return result

    def discard(self, key: CacheKey, why: str) -> None:
        """Delete an invalid cached result, and add a note with the reason."""
        path = self._folder / key.name
        try:
            path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink(
                missing_ok=True
            )
            self.notes.append(
                f"discarded a damaged cache file, and computed its result again: {path} ({why})"
            )
        except OSError as error:
            self.notes.append(
                f"cannot remove a damaged cache file: {path} ({why}): {error.strerror}; remove it "
                f"yourself"
            )

    def write(self, key: CacheKey, result: object) -> None:
        """Write a result to the cache if its types can be stored; a disk error only adds a note."""
        try:
            arrays: Arrays = {}
            split(restored(result), arrays)
        except TypeError:
            return
        if sum(array.nbytes for array in arrays.values()) > min(self._limit, MAX_ARRAY_BYTES // 2):
            return
        try:
            write_value(self._folder / key.name, result, {"name": key.name, "backend": key.backend})
            self._written = True
        except (OSError, OutputError) as error:
            if (self._folder / key.name).is_dir():  # it blocks only this file
                note = f"a result of a backend cannot be cached: {error}"
            else:
                cure = "set PHYSIC_CACHE to another folder, or to off"
                note = f"results of backends cannot be cached: {error}; {cure}"
            if note not in self.notes:
                self.notes.append(note)

    def trim(self) -> None:
        """Delete the least recently used files beyond the size limit, and release the inputs of
        this run.
        """
        self._digester = Digester()
        if self._written:
            self._files.trim(self._limit)
            self._written = False


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
    name: str,
    made_of: str,
    inputs: Mapping[str, AnyArray],
    compute: Callable[[], tuple[AnyArray, ...]],
) -> tuple[AnyArray, ...]:
    """Return the outputs of a network for these inputs from the cache, or compute and keep them.

    Args:
        name: of the network, a part of the name of the file.
        made_of: what determines the outputs beside the inputs: weights, runtime, names of the
            outputs.
        inputs: of the network, by name.
        compute: runs the network.
    """
    cache = _CACHE.get()
    if cache is None:
        return compute()
    key = cache.network_key(name, made_of, inputs)
    result: Any = cache.read(key)
    if result is None:
        result = compute()
        cache.write(key, result)
    return tuple(result)
