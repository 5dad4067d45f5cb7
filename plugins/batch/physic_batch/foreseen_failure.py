"""What can be known of a photo's failure before a network runs, for a dry run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.configuration.resolve import check_input_files, resolve_one
from physic_core.discovery.plugin_code import named_plugin_code
from physic_core.errors import ConfigError, InputError, PhysicError
from physic_core.files import unreadable
from physic_core.types import Hints

if TYPE_CHECKING:
    from physic_batch.photos import PhotoItem
    from physic_core.configuration.model import Config

_MAPS = {"depth": "metric_depth", "pointmap": "relative_pointmap"}
"""Settings of a photo that name a file, and the interface whose backend reads it."""


def expected_failure(item: PhotoItem, config: Config) -> str:
    """Return why a photo will fail; "" if nothing is known against it.

    The start of the photo's file is read, and its settings must agree with the configuration; a
    depth map and a point map are read.
    """
    from physic_core.io.photo import check_photo_file

    try:
        check_photo_file(Path(item.path))
        if item.settings:
            _check_settings(item, config.with_photo(item.settings))
    except OSError as error:
        return unreadable(error)
    except PhysicError as error:
        return " ".join(str(error).split())
    return ""


def _check_settings(item: PhotoItem, config: Config) -> None:
    """Raise PhysicError if the settings of a photo cannot be followed.

    Raises:
        OSError: the photo cannot be read.
    """
    photo = config.photo
    chosen = len(photo.person) + len(photo.box)
    max_people = chosen or config.segmenter.options.get("max_people")
    for name in ("stature", "age"):
        num_given = len(getattr(photo, name) or ())
        if (
            num_given > 1
            and max_people is not None
            and (num_given > max_people or (chosen and num_given != chosen))
        ):
            raise ConfigError(f"{num_given} {name}s were given for {max_people} people")
    check_input_files(config)
    maps = [interface for name, interface in _MAPS.items() if name in item.settings]
    if maps:
        from physic_core import read_photo
        from physic_core.prepare.photo import prepare_photo

        image = prepare_photo(read_photo(Path(item.path)), photo, None, None).photo.image
        for interface in maps:
            choice = config.choice(interface)
            resolved = resolve_one(interface, choice.backend, choice.options)
            with named_plugin_code(resolved.title, type(resolved.backend), kind=InputError):
                resolved.backend.infer(image, Hints())
