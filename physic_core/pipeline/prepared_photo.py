"""Prepare a photo for the backends: camera, border, size, undistortion, and the user's data in px of the result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.io.people_prompt import check_prompt, read_masks, resize_prompt
from physic_core.io.photo import Photo, limit_size
from physic_core.pipeline.border import Border, cut_border, find_inside, limit_inside
from physic_core.pipeline.undistort import move_pixels, undistort
from physic_core.types import CameraTrust, Intrinsics, KnownSizes, Lens, PeoplePrompt

if TYPE_CHECKING:
    from physic_core.configuration.model import PhotoSettings


@dataclass(frozen=True)
class PreparedPhoto:
    """A photo as given to the backends.

    Attributes:
        photo: with the camera of the config, no larger than its limit, undistorted.
        people: the people to reconstruct, px of the picture; None for all people.
        known: sizes that the user knows, px of the picture.
        lens: of the file; None without distortion.
        border: that was cut off the photo; None without one.
    """

    photo: Photo
    people: PeoplePrompt | None
    known: KnownSizes
    lens: Lens | None
    border: Border | None = None


def prepare_photo(
    photo: Photo, settings: PhotoSettings, people: PeoplePrompt | None, known: KnownSizes | None
) -> PreparedPhoto:
    """Prepare a photo. A border is not looked for if the photo has lens distortion, or its depth is in a file.

    Args:
        photo: as read.
        settings: of the config; its camera, people and sizes replace the given ones.
        people: px of the upright file; None for all people.
        known: px of the upright file, or None.

    Raises:
        InputError: people or distortion cannot be used.
    """
    file_size = photo.file_size or photo.image.shape[1::-1]
    photo = _with_camera(photo, settings)
    of_whole = settings.distortion or settings.depth or settings.pointmap
    inside = None if of_whole else find_inside(photo.image)
    if inside is None:
        photo = limit_size(photo, settings.max_side)
    else:
        photo, inside = limit_inside(photo, inside, settings.max_side)
    height, width = photo.image.shape[:2]
    prompt, note = _prompt(people, settings, file_size, (width, height))
    photo = replace(photo, notes=(*photo.notes, note)) if note else photo
    sizes = settings.known_sizes(known).resized(width / file_size[0], height / file_size[1])
    if inside is not None:
        corner, border = np.array([inside[1].start, inside[0].start]), Border(photo.image, inside)
        moved = move_pixels(prompt, sizes, lambda pixels: pixels - corner, lambda mask: mask[inside])
        return PreparedPhoto(cut_border(photo, inside), *moved, None, border)
    if settings.distortion is None or photo.intrinsics is None:
        return PreparedPhoto(photo, prompt, sizes, None)
    lens = Lens(photo.intrinsics.resized(*file_size), settings.distortion)
    return PreparedPhoto(*undistort(photo, prompt, sizes, lens.distortion), lens)


def _with_camera(photo: Photo, settings: PhotoSettings) -> Photo:
    """Return the photo with the camera of the config (in px of the file), if the config has one."""
    height, width = photo.image.shape[:2]
    file_width, file_height = photo.file_size or (width, height)
    if settings.intrinsics is not None:
        given = Intrinsics(*settings.intrinsics, file_width, file_height, trust=CameraTrust.KNOWN)
    elif settings.focal_px is not None:
        given = Intrinsics.from_focal(settings.focal_px, file_width, file_height, trust=CameraTrust.KNOWN)
    else:
        return photo
    return replace(photo, intrinsics=given.resized(width, height))


def _prompt(
    people: PeoplePrompt | None, settings: PhotoSettings, file_size: tuple[int, int], size: tuple[int, int]
) -> tuple[PeoplePrompt | None, str]:
    """Return the user's choice of people, px of the image to reconstruct, None for all people; and a note, or "".

    Args:
        people: in px of the upright file; the config's choice if None.
        settings: of the config.
        file_size: width and height of the upright file, px.
        size: width and height of the image to reconstruct, px.
    """
    is_set = settings.person or settings.box or settings.masks
    if people is None and not is_set:
        return None, ""
    note = ""
    if people is None:
        masks, note = (None, "") if settings.masks is None else read_masks(settings.masks)
        people = PeoplePrompt(settings.person, settings.box, masks)
    return resize_prompt(check_prompt(people, *file_size), file_size, size), note
