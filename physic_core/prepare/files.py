"""Files of bodies and masks that the settings of a photo name, and the same as arrays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.errors import ConfigError
from physic_core.io.body_file import bodies_in_python, read_bodies
from physic_core.io.mask_file import read_masks
from physic_core.types import FileOfPhoto, PeoplePrompt

if TYPE_CHECKING:
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.io.body_file import GivenBodies
    from physic_core.io.photo import Photo
    from physic_core.types import Bodies, BoolArray


def read_bodies_of(
    photo: Photo, plan: ResolvedPipeline, bodies: Bodies | None
) -> GivenBodies | None:
    """Return the bodies that the user gives, as a record or in a file; None without any.

    Raises:
        ConfigError: both are given.
        InputError: they cannot be used.
    """
    settings = plan.photo
    if settings.bodies is None:
        given_bodies = None if bodies is None else bodies_in_python(bodies)
    elif bodies is not None:
        raise ConfigError("bodies are given, and photo.bodies names a file: give only one")
    else:
        file = _file_of_photo(photo, settings.bodies, settings.bodies_frame)
        given_bodies = read_bodies(file, settings.bodies_model or plan.config.body_model.path)
    if given_bodies is None:
        if settings.bodies_final:
            raise ConfigError("photo.bodies_final is set without bodies: give both")
        return None
    sigma = settings.bodies_sigma
    return given_bodies if sigma is None else replace(given_bodies, sigma_m=sigma)


def read_masks_of(
    photo: Photo, plan: ResolvedPipeline, people: PeoplePrompt | None, masks: BoolArray | None
) -> tuple[PeoplePrompt | None, BoolArray | None]:
    """Return the people to reconstruct, those of the user's masks if these are of people, and
    masks (M, H, W) of the file that may be people's.

    Raises:
        ConfigError: people are given in more than one way.
        InputError: the file cannot be used.
    """
    path = plan.photo.masks
    if path is None and masks is None:
        return people, None
    if people is not None or (path is not None and masks is not None):
        raise ConfigError("masks choose the people to reconstruct: give them in one way only")
    if path is None:
        return PeoplePrompt(masks=masks), None
    masks_in_file = read_masks(_file_of_photo(photo, path))
    return (
        (PeoplePrompt(masks=masks_in_file.masks), None)
        if masks_in_file.are_people
        else (None, masks_in_file.masks)
    )


def _file_of_photo(photo: Photo, path: str, frame: int | None = None) -> FileOfPhoto:
    height, width = photo.image.shape[:2]
    return FileOfPhoto(Path(path), photo.name, photo.file_size or (width, height), frame)
