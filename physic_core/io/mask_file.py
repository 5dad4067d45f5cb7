"""Masks of people that the user gives in a file of another program, which a plugin reads."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_core.files.atomic import unreadable
from physic_core.io.body_file import (
    WRONG_FORM,
    read_by_plugin,
    scale_of_picture,
    unusable_message,
)

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FileOfPhoto, MasksInFile


def read_masks(file: FileOfPhoto) -> MasksInFile:
    """Read the masks of one photo, of the size of the upright photo file and without overlap.

    A pixel of several masks is of the first one. Masks of another size of the same picture are
    resized to the nearest pixel.

    Raises:
        InputError: the file cannot be read, its format is unknown, or its masks are of another
            picture.
        PackageMissingError: no installed plugin reads it.
    """
    try:
        masks_in_file: MasksInFile = read_by_plugin("physic_mask_readers", "masks", file)
        if not masks_in_file.masks.any():
            raise ValueError("it has no mask with a pixel: was a mask of 0 and 1 read as 0 to 255?")
        masks = _resized_masks(masks_in_file.masks[masks_in_file.masks.any((1, 2))], file.size)
        if masks_in_file.are_people and masks.sum() > masks[0].size:
            raise ValueError("its masks overlap in much of the picture: are they inverted?")
    except OSError as error:
        raise InputError(f"cannot read the masks {file.path}: {unreadable(error)}") from error
    except WRONG_FORM as error:
        raise InputError(
            f"the masks {file.path} cannot be used: {unusable_message(error)}"
        ) from error
    if masks_in_file.are_people:
        taken = np.zeros(masks.shape[1:], bool)
        for mask in masks:
            mask &= ~taken
            taken |= mask
        masks = masks[masks.any((1, 2))]
    left_out = len(masks_in_file.masks) - len(masks)
    notes = (f"left out {left_out} given masks that have no pixel of their own",) * bool(left_out)
    return replace(masks_in_file, masks=masks, notes=(*masks_in_file.notes, *notes))


def _resized_masks(masks: BoolArray, size: tuple[int, int]) -> BoolArray:
    """Return a copy of masks (N, H, W) resized to the photo's width and height."""
    height, width = masks.shape[1:]
    if (width, height) == size:
        return np.array(masks)
    factors = scale_of_picture((width, height), size)
    columns, rows = (
        np.minimum((np.arange(new) + 0.5) / factor, old - 1).astype(int)
        for new, factor, old in zip(size, factors, (width, height), strict=True)
    )
    return masks[:, rows][:, :, columns]
