"""Which backends passed the conformance kit on this machine, by the digest of their code.

A stamp is an empty file of the cache. It says nothing of another version of the code, nor of the
packages ``physic_*`` that it imports.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.cache.digests import CodeDigester
from physic_core.cache.folders import CACHES, claimed_cache, plain_name
from physic_core.discovery.catalog import BACKENDS
from physic_core.discovery.local_modules import split_folder

if TYPE_CHECKING:
    from physic_core.interfaces import Backend


def is_vouched_for(interface: str, name: str, distribution: str, target: str) -> bool:
    """Return whether a backend ships with the project, or has a stamp.

    Args:
        interface: of the backend.
        name: of the backend.
        distribution: that offers it.
        target: "package.module:Class", which is not imported.
    """
    if BACKENDS.get(name) == distribution:
        return True
    stamp = _stamp_path(interface, target)
    return stamp is not None and stamp.is_file()


def remember_passed(interface: str, kind: type[Backend]) -> None:
    """Remember that a class of backends passed the kit of an interface."""
    if (path := _stamp_path(interface, target_of(kind))) is not None:
        with suppress(OSError):
            path.touch()


def target_of(kind: type) -> str:
    """Return "package.module:Class"; one that is defined in a function has no stamp."""
    return f"{kind.__module__}:{kind.__qualname__}"


def _stamp_path(interface: str, target: str) -> Path | None:
    """Return the path of a stamp; None if there is no cache, or the code has no reliable digest.

    A class may be offered by another module of its package than the one that defines it.
    """
    cache = claimed_cache("kit")
    folder, target = split_folder(target)
    module, _, name = target.rpartition(":")
    top = module.partition(".")[0]
    if cache is None or "<locals>" in name:
        return None
    loaded = sys.modules.get(top)
    origin = getattr(loaded, "__file__", None)
    if loaded is None and folder is None:
        with suppress(ImportError, ValueError):
            origin = getattr(find_spec(top), "origin", None)
    code = CodeDigester().digest_of([Path(origin)]) if origin else None
    if code is None:
        return None
    return cache.path / f"{interface}-{plain_name(f'{top}.{name}')}-{code}{CACHES['kit'][1]}"
