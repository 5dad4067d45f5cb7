"""Prepare a photo for the backends: camera, border, size, undistortion, and the user's data in px
of the result.

A photo is undistorted once, after reading; the user's pixels are those of the file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import ConfigError
from physic_core.io.keypoint_file import GivenKeypoints, read_keypoints
from physic_core.io.photo import Photo, limit_size
from physic_core.prepare.border import Border, cut_border, limit_inside
from physic_core.prepare.frame import Frame, find_frame
from physic_core.prepare.photo_warnings import photo_warnings
from physic_core.types import CameraTrust, Intrinsics, KnownSizes, Lens, PeoplePrompt

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from physic_core.configuration.model import PhotoSettings
    from physic_core.io.body_file import GivenBodies
    from physic_core.types import BoolArray, FloatArray

    Move = Callable[[FloatArray], FloatArray]

_EDGE_POINTS = 9  # along each side of a box
# Relative difference of width and height of a picture by the principal point in its centre.
_SAME_CENTRE = 0.03
_OTHER_SIZE = 0.1  # relative difference of its size from the photo's that no lens explains


@dataclass(frozen=True)
class PreparedPhoto:
    """A photo as given to the backends.

    Attributes:
        photo: with the camera of the config, no larger than its limit, undistorted.
        people: whom to reconstruct or to leave out, px of the picture; None for all people.
        known: sizes that the user knows, px of the picture.
        lens: of the file; None without distortion.
        border: that was cut off the photo; None without one.
        keypoints: that the user gives, px of the picture; None if there are none.
        bodies: that the user gives, px of the picture; None if there are none.
        masks: (M, H, W) that replace those of detected people whom they cover; None if there are
            none.
    """

    photo: Photo
    people: PeoplePrompt | None
    known: KnownSizes
    keypoints: GivenKeypoints | None = None
    bodies: GivenBodies | None = None
    masks: BoolArray | None = None
    lens: Lens | None = None
    border: Border | None = None

    def moved(
        self, photo: Photo, move: Move, move_mask: Callable[[BoolArray], BoolArray]
    ) -> PreparedPhoto:
        """Return another picture of the same photo, with the user's pixels in it.

        Args:
            photo: the other picture.
            move: from pixels (n, 2) to those of the other picture.
            move_mask: from a mask (H, W) to that of the other picture.
        """
        prompt = self.people
        if prompt is not None:
            moved_points = move(np.array(prompt.points).reshape(-1, 2))
            masks = prompt.masks
            prompt = replace(
                prompt,
                points=tuple((float(x), float(y)) for x, y in moved_points),
                boxes=tuple(_undistorted_box(box, move) for box in prompt.boxes),
                masks=None if masks is None else np.stack([move_mask(mask) for mask in masks]),
            )
        lengths = []
        for length in self.known.lengths:
            start, end = move(np.array([length.start, length.end])).tolist()
            lengths.append(replace(length, start=(start[0], start[1]), end=(end[0], end[1])))
        return replace(
            self,
            photo=photo,
            people=prompt,
            known=replace(self.known, lengths=tuple(lengths)),
            keypoints=self.keypoints and self.keypoints.moved(move),
            bodies=self.bodies and self.bodies.moved(move),
            masks=None if self.masks is None else np.stack([move_mask(m) for m in self.masks]),
        )


def prepare_photo(
    photo: Photo,
    settings: PhotoSettings,
    people: PeoplePrompt | None,
    known: KnownSizes | None,
    bodies: GivenBodies | None = None,
    masks: BoolArray | None = None,
) -> PreparedPhoto:
    """Prepare a photo.

    A frame is not looked for if the photo has lens distortion, or its depth is in a file. The
    camera of a file that shows a print is not the picture's.

    Args:
        photo: as read.
        settings: of the config; its camera, people and sizes replace the given ones.
        people: px of the upright file; None for all people.
        known: px of the upright file, or None.
        bodies: px of the upright file, or None.
        masks: (M, H, W) of the upright file, or None.

    Raises:
        ConfigError: camera, people, known sizes or distortion cannot be used.
        InputError: the keypoints cannot be used.
    """
    width, height = photo.file_size or photo.image.shape[1::-1]
    file_size = width, height
    of_whole = settings.distortion or settings.depth or settings.pointmap
    frame = Frame() if of_whole else find_frame(photo.image)
    photo = _with_camera(_with_frame_notes(photo, frame), settings)
    inside = frame.inside
    if inside is None:
        photo = limit_size(photo, settings.max_side)
    else:
        photo, inside = limit_inside(photo, inside, settings.max_side)
    prompt = _people_prompt(people, settings)
    if prompt is not None:
        prompt = checked_prompt(prompt, *file_size)
    sizes = check_lengths(settings.known_sizes(known), *file_size)
    keypoints = None
    if settings.keypoints is not None:
        keypoints = read_keypoints(settings.keypoints, *file_size, photo.name)
        keypoints = replace(keypoints, file_px_per_px=file_size[0] / photo.image.shape[1])
    prepared_given = PreparedPhoto(photo, prompt, sizes, keypoints, bodies, masks)
    prepared = _in_px_of_picture(prepared_given, file_size)
    if inside is not None:
        prepared = _without_border(prepared, inside, frame.note)
    elif settings.distortion is not None and photo.intrinsics is not None:
        prepared = _undistorted(prepared, Lens(photo.intrinsics, settings.distortion), file_size)
    photo = prepared.photo
    if not frame.warning:
        photo = replace(photo, warnings=(*photo.warnings, *photo_warnings(photo.image)))
    return replace(prepared, photo=photo)


def _with_frame_notes(photo: Photo, frame: Frame) -> Photo:
    """Return the photo with the warning of its frame, and without the camera of a file that shows a
    print.
    """
    if frame.is_print and photo.intrinsics and photo.intrinsics.source.startswith("EXIF"):
        note = "the focal length in the EXIF data was ignored: it is of a photo of a print"
        photo = replace(photo, intrinsics=None, notes=(*photo.notes, note))
    return replace(photo, warnings=(*photo.warnings, *filter(None, (frame.warning,))))


def _in_px_of_picture(given: PreparedPhoto, file_size: tuple[int, int]) -> PreparedPhoto:
    """Return a photo whose user's pixels are those of a file, width and height, with those of its
    picture.

    Masks are sampled at the nearest pixel.

    Raises:
        ConfigError: no pixel of a mask is left.
    """
    import cv2

    width, height = size = given.photo.image.shape[1::-1]
    if size == file_size:
        return given
    factors = np.divide(size, file_size)
    scaled = given.moved(
        given.photo,
        lambda pixels: (pixels + 0.5) * factors - 0.5,
        lambda mask: cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0,
    )
    if scaled.people is not None and scaled.people.masks is not None:
        empty = ~scaled.people.masks.any((1, 2))
        if empty.any():
            raise ConfigError(
                f"mask {int(empty.argmax()) + 1} has no pixels at {width} x {height} px: enlarge "
                "it, or raise photo.max_side"
            )
    return scaled


def _without_border(
    prepared: PreparedPhoto, inside: tuple[slice, slice], what: str
) -> PreparedPhoto:
    """Return the part of a photo inside what is cut off, with the user's pixels in it."""
    photo = prepared.photo
    corner = np.array([inside[1].start, inside[0].start])
    cut = prepared.moved(
        cut_border(photo, inside, what), lambda pixels: pixels - corner, lambda mask: mask[inside]
    )
    return replace(cut, border=Border(photo.image, inside))


def _people_prompt(people: PeoplePrompt | None, settings: PhotoSettings) -> PeoplePrompt | None:
    """Return the given people, or those of the settings; None for all people.

    Raises:
        ConfigError: people are both chosen and left out.
    """
    if people is None and (settings.person or settings.box):
        people = PeoplePrompt(settings.person, settings.box)
    if not settings.ignore:
        return people
    if people is not None:
        raise ConfigError("photo.ignore leaves people out, and people are chosen: give only one")
    return PeoplePrompt(settings.ignore, ignored=True)


def _with_camera(photo: Photo, settings: PhotoSettings) -> Photo:
    """Return the photo with the camera of the config (in px of the file), if the config has one."""
    height, width = photo.image.shape[:2]
    file_width, file_height = photo.file_size or (width, height)
    if settings.intrinsics is not None:
        _check_principal_point(settings.intrinsics, file_width, file_height)
        stated = Intrinsics(*settings.intrinsics, file_width, file_height, trust=CameraTrust.KNOWN)
    elif settings.focal_px is not None:
        stated = Intrinsics.from_focal(
            settings.focal_px, file_width, file_height, trust=CameraTrust.KNOWN
        )
    else:
        return photo
    return replace(photo, intrinsics=stated.resized(width, height))


def _check_principal_point(intrinsics: Sequence[float], width: int, height: int) -> None:
    """Check that the principal point is not the centre of the same picture in another size, or
    turned.

    Raises:
        ConfigError: it is.
    """
    fx, fy, cx, cy = intrinsics
    for (w, h), turned in (((width, height), ""), ((height, width), ", turned")):
        across = (cx + 0.5) * 2 / w
        down = (cy + 0.5) * 2 / h
        if min(across, down) <= 0 or abs(across / down - 1) > _SAME_CENTRE:
            continue
        scale = (across + down) / 2
        if not turned and abs(scale - 1) <= _OTHER_SIZE:
            return
        right = (fy, fx, cy, cx) if turned else (fx, fy, cx, cy)
        suggested = ",".join(f"{value / scale:.0f}" for value in right)
        raise ConfigError(
            f"the principal point ({cx:g}, {cy:g}) fits a picture of about "
            f"{scale * w:.0f} x {scale * h:.0f} px{turned}, but the photo has {width} x {height} "
            f"px: give intrinsics of this photo, about {suggested}; for an off-center crop, pass "
            "Intrinsics in Python"
        )


def _undistorted(prepared: PreparedPhoto, lens: Lens, file_size: tuple[int, int]) -> PreparedPhoto:
    """Return an undistorted photo, with the user's pixels in it.

    Args:
        prepared: the photo.
        lens: with the intrinsics of its picture.
        file_size: width and height of the file.

    Raises:
        ConfigError: the distortion folds the image.
    """
    # It imports torch, which other photos load beside the first network.
    from physic_core.geometry.camera import check_distortion, undistort_image, undistort_pixels

    photo = prepared.photo
    check_distortion(lens.intrinsics, lens.distortion)
    note = (
        "the image was undistorted; its pixels are not those of the file (Reconstruction.lens "
        "maps them back)"
    )
    image = undistort_image(photo.image, lens.intrinsics, lens.distortion)
    straight = prepared.moved(
        replace(photo, image=image, notes=(*photo.notes, note)),
        lambda pixels: undistort_pixels(pixels, lens.intrinsics, lens.distortion),
        lambda mask: _undistorted_mask(mask, lens),
    )
    return replace(straight, lens=replace(lens, intrinsics=lens.intrinsics.resized(*file_size)))


def _undistorted_box(
    box: tuple[float, float, float, float], move: Move
) -> tuple[float, float, float, float]:
    """Return the smallest box around the undistorted border of a box."""
    # edges of a box are half open, pixels have their centres at integers
    x0, y0, x1, y1 = (v - 0.5 for v in box)
    x = np.linspace(x0, x1, _EDGE_POINTS)
    y = np.linspace(y0, y1, _EDGE_POINTS)
    border = np.concatenate(
        [np.stack([x, 0 * x + edge], -1) for edge in (y0, y1)]
        + [np.stack([0 * y + edge, y], -1) for edge in (x0, x1)]
    )
    moved = move(border) + 0.5
    left, top = moved.min(0).tolist()
    right, bottom = moved.max(0).tolist()
    return left, top, right, bottom


def _undistorted_mask(mask: BoolArray, lens: Lens) -> BoolArray:
    """Sample a mask (H, W) at the nearest pixel of the distorted image."""
    height, width = mask.shape
    y, x = np.mgrid[:height, :width]
    at = np.rint(lens.file_pixels(np.stack([x, y], -1), lens.intrinsics)).astype(int)
    inside = ((at >= 0) & (at < [width, height])).all(-1)
    clipped: FloatArray = np.clip(at, 0, [width - 1, height - 1])
    inside_mask: BoolArray = inside & mask[clipped[..., 1], clipped[..., 0]]
    return inside_mask


def checked_prompt(prompt: PeoplePrompt, width: int, height: int) -> PeoplePrompt:
    """Return valid prompts of a photo of ``width`` x ``height`` px, as tuples and a bool array.

    Raises:
        ConfigError: there is no prompt; a point or box lies outside the photo; masks are of another
            size, are empty or overlap.
    """
    points = tuple(_finite_numbers(point, 2, "a point needs x, y in px") for point in prompt.points)
    boxes = tuple(
        _finite_numbers(box, 4, "a box needs x0, y0, x1, y1 in px") for box in prompt.boxes
    )
    masks = None if prompt.masks is None else np.atleast_1d(prompt.masks)
    checked = replace(prompt, points=points, boxes=boxes, masks=masks)  # type: ignore[arg-type]
    if not len(checked):
        raise ConfigError(
            "no person is chosen: give at least one point, box or mask, or omit the prompt for "
            "all people"
        )
    size = f"the upright photo of {width} x {height} px"
    numbers = np.array([value for place in (*points, *boxes) for value in place])
    if ((numbers >= 0) & (numbers <= 1)).all() and (numbers % 1).any():
        raise ConfigError(
            f"the coordinates of people look like fractions of the picture: give px of {size}"
        )
    for i, (x, y) in enumerate(checked.points):
        if not (-0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
            raise ConfigError(f"{checked.describe(i)} lies outside {size}: give x, y in its px")
    for i, (x0, y0, x1, y1) in enumerate(checked.boxes, len(points)):
        if not (x0 < x1 and y0 < y1):
            raise ConfigError(
                f"{checked.describe(i)} is empty: give x0, y0, x1, y1 with x0 < x1 and y0 < y1"
            )
        if not (x1 > 0 and y1 > 0 and x0 < width and y0 < height):
            raise ConfigError(
                f"{checked.describe(i)} lies outside {size}: give x0, y0, x1, y1 in px of the photo"
            )
    if masks is not None:
        _check_masks(masks, width, height)
    return checked


def check_lengths(known: KnownSizes, width: int, height: int) -> KnownSizes:
    """Return the known sizes if the pixels of all lengths are in the photo of ``width`` x
    ``height`` px.

    Raises:
        ConfigError: one lies outside.
    """
    for length in known.lengths:
        for x, y in (length.start, length.end):
            if not (-0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
                raise ConfigError(
                    f"the known length of {length.metres:g} m has an end at ({x:g}, {y:g}), "
                    f"outside the upright photo "
                    f"of {width} x {height} px: give x, y in its px"
                )
    return known


def _finite_numbers(values: Any, count: int, wanted: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(v) for v in values)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ConfigError(f"{wanted}: give {count} finite numbers (got {values!r})")
    return numbers


def _check_masks(masks: Any, width: int, height: int) -> None:
    if masks.ndim != 3 or masks.dtype != bool:
        raise ConfigError(
            f"masks of people must be (M, H, W) bool, got {masks.shape} {masks.dtype}: convert them"
        )
    if masks.shape[1:] != (height, width):
        raise ConfigError(
            f"the masks have {masks.shape[2]} x {masks.shape[1]} px, but the upright photo has "
            f"{width} x {height} "
            f"px: give masks of the photo's size"
        )
    empty = [i + 1 for i in range(len(masks)) if not masks[i].any()]
    if empty:
        raise ConfigError(f"mask {empty[0]} has no pixels: omit it, or mark the person's pixels")
    if len(masks) and masks.sum(0, dtype=np.int64).max() > 1:
        raise ConfigError("masks of two people overlap: assign each pixel to at most one person")
