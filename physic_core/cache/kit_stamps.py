"""Which backends passed the conformance kit on this machine.

A stamp is an empty file of the cache, with a digest of the code in its name, and one of all else
that the results of the backend depend on: its options, the files that they name, its fingerprint,
and the versions of what its distribution and this one require.
"""

from __future__ import annotations

import glob
import hashlib
import json
import re
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.cache.digests import CodeDigester, files_named_by
from physic_core.cache.folders import CACHES, claimed_cache, plain_name
from physic_core.discovery.catalog import PACKAGES
from physic_core.discovery.entry_points import distributions_of, required_versions
from physic_core.discovery.local_modules import split_folder

if TYPE_CHECKING:
    from physic_core.interfaces import Backend

_SUFFIX = CACHES["kit"][1]


def has_passed_kit(interface: str, target: str, backend: Backend | None = None) -> bool:
    """Return whether a backend ships with the project, or has a stamp.

    Args:
        interface: of the backend.
        target: "package.module:Class", which is not imported.
        backend: need not be loaded; None for any options.

    Raises:
        Exception: raised by the backend's ``fingerprint``.
    """
    if re.split("[.:]", target, maxsplit=1)[0] in PACKAGES:
        return True
    place = _stamp_place(interface, target)
    if place is None:
        return False
    folder, start = place
    if backend is None:
        return any(folder.glob(f"{glob.escape(start)}*"))
    return (folder / f"{start}{_settings(backend)}{_SUFFIX}").is_file()


def remember_passed(interface: str, backend: Backend) -> None:
    """Remember that a backend passed the kit of an interface."""
    if (place := _stamp_place(interface, target_of(type(backend)))) is not None:
        folder, start = place
        with suppress(OSError):
            (folder / f"{start}{_settings(backend)}{_SUFFIX}").touch()


def target_of(kind: type) -> str:
    """Return "package.module:Class"; one that is defined in a function has no stamp."""
    return f"{kind.__module__}:{kind.__qualname__}"


def _settings(backend: Backend) -> str:
    """Return the digest of what results depend on beside code and inputs."""
    top = type(backend).__module__.partition(".")[0]
    options = backend.options.model_dump(mode="json")
    parts = [
        options,
        list(files_named_by(options)),
        str(backend.fingerprint()),
        [required_versions(one) for one in ("metricbody", *distributions_of(top))],
    ]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def _stamp_place(interface: str, target: str) -> tuple[Path, str] | None:
    """Return the folder of a stamp and the start of its name; None if there is no cache, or the
    code has no reliable digest.

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
    return cache.path, f"{interface}-{plain_name(f'{top}.{name}')}-{code}-"
