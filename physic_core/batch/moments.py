"""Photos of one moment in a batch: each is reconstructed alone, and a plugin joins them (group ``physic.moments``)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.discovery.installed import Installed, call_target, find_only_entry
from physic_core.discovery.records import TargetRecord
from physic_core.discovery.registration import MOMENTS_GROUP
from physic_core.errors import NoPersonError, PluginError

if TYPE_CHECKING:
    from physic_core.batch.photos import PhotoItem
    from physic_core.configuration.model import Config
    from physic_core.types import Reconstruction

_DISTRIBUTION = "physic-scene"


@dataclass(frozen=True)
class MomentPhoto:
    """One photo of a moment.

    Attributes:
        name: of its file.
        settings: of the table ``[photo]`` for it alone.
        result: of the photo alone; None if it has no people and the configuration requires some.
    """

    name: str
    settings: Mapping[str, Any]
    result: Reconstruction | None


def require_moments() -> Installed[TargetRecord]:
    """Return the entry point that joins photos of one moment, without importing its plugin.

    Raises:
        PackageMissingError: no plugin does.
        ConfigError: several do.
    """
    return find_only_entry(MOMENTS_GROUP, "photos of one moment are joined by", _DISTRIBUTION)


def reconstruct_moment(
    item: PhotoItem, config: Config, reconstruct: Callable[[str, Mapping[str, Any]], Reconstruction]
) -> tuple[Reconstruction, Mapping[str, bytes]]:
    """Reconstruct all photos of a moment; return the result, and the content of each file to write beside it.

    The function of the plugin gets a sequence of :class:`MomentPhoto` and the configuration of the batch, and returns
    one :class:`physic_core.Reconstruction` with ``cameras``, or a tuple of it and a mapping from names to contents
    (bytes) of files that belong beside it.

    Args:
        item: the first photo, with the others.
        config: of the batch.
        reconstruct: called with path and settings of each photo.

    Raises:
        PhysicError: a photo cannot be reconstructed, or the photos cannot be joined.
    """
    from physic_core.types import Reconstruction

    found, photos = require_moments(), []
    for one in (item, *item.others):
        try:
            result = reconstruct(one.path, one.settings)
        except NoPersonError:
            result = None
        photos.append(MomentPhoto(Path(one.path).name, one.settings, result))
    answer = call_target(found, "moment", photos, config)
    joined, files = answer if isinstance(answer, tuple) and len(answer) == 2 else (answer, {})
    if not isinstance(joined, Reconstruction):
        raise PluginError(
            f"the moment '{found.record.name}' of {found.origin} should be a Reconstruction, got "
            f"{type(joined).__name__}"
        )
    return joined, files
