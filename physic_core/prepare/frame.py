"""Find the picture in a photo of something that shows it: a screenshot, a scanned print, an album.

A frame is a smooth ground, whatever its colour, noise and ink, that straight lines part from the
picture. A plain background of a studio has no such lines, and a scene no four of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from physic_core.geometry.colors import lab_from_srgb
from physic_core.prepare.border import find_border, largest_channel
from physic_core.prepare.count_pictures import count_joined_pictures, count_pictures

if TYPE_CHECKING:
    from physic_core.prepare.border import Inside
    from physic_core.types import BoolArray, FloatArray, UInt8Array

_SIDE = 560  # px of the long side, at which the noise of a scan is averaged
_LAB_STEPS = (2.55, 1, 1)  # of 255 in L, a and b
_STEPS = (2, 6)  # difference of neighbours in a ground without noise, and in any, of 255 in Lab
_LAYERS = 3  # a scanner's bed, the white of a print, its mount
_GROUND = 0.02  # least share of the area, but of a strip across the photo
_FILLED = 0.8  # share of the box round such a strip
_PICTURE = 0.15  # least share of a picture that is cut out
_MOST = 0.9  # of the largest thing on the ground: a window beside a person is no picture
_ENCLOSED = 0.2  # the same of one whose frame does not reach the edge of the photo
_PART = 0.04  # the same of one of several
_PARTS = 0.4  # least share of several together
_LINE_PX = 2.5
_NEAR_PX = 6.0
_SEEN = 0.8  # share of a side that the ground ends at
_EDGE_PX = 4
_ROUGH = 0.2  # share of other pixels in a column of a blurred side
_MIXED_PX = 3.0  # that average the texture of wood and cloth
_ONE_GROUND = 26.0  # largest deviation of its colour, of 255 in Lab
_CUT_DEG = 6.0  # of a picture, turned or seen from the side: the rectangle in it shows most of it
_STRAIGHT_DEG = 0.5  # of a bar that crosses the photo: a screen draws it along the pixels
_PLAIN_BAR = 0.75  # mean deviation of such a bar's colour, of 255
_ONE_COLOUR = 4  # largest difference of a plain ground from its colour; walls have shading
_GROUND_SIDE = 400  # px of the long side, at which it is looked for
_PLAIN_GROUND = 0.3  # least share of the area
_BORDER = "a border of one color"


@dataclass(frozen=True)
class Frame:
    """The picture in its file.

    Attributes:
        inside: rows and columns of the picture, None for the whole photo.
        note: what was cut off, "" for nothing.
        warning: why the photo may be no picture of one scene, with the cure; or "".
        is_print: True if the photo shows a print, so that its camera is not the picture's.
    """

    inside: Inside | None = None
    note: str = ""
    warning: str = ""
    is_print: bool = False


@dataclass(frozen=True)
class _InnerPicture:
    """A part of a photo whose outline is four lines.

    Attributes:
        corners: (4, 2) px, clockwise from the upper left.
        share: of the area of the photo.
        inner: number of its sides that are not the photo's.
        turn_deg: largest angle of an inner side with the rows or columns.
        skew_deg: largest difference of a corner from 90 degrees.
        broken: number of inner sides that the ground reaches over.
    """

    corners: FloatArray
    share: float
    inner: int
    turn_deg: float
    skew_deg: float
    broken: int


class _Layer(NamedTuple):
    """What the outermost ground of a photo is round: a picture to cut out, or else those that
    cannot be cut out: several in one file, or one that is turned, skewed or broken.
    """

    cut: _InnerPicture | None = None
    uncut: tuple[_InnerPicture, ...] = ()


class _Line(NamedTuple):
    """Line along a side of a picture.

    Attributes:
        point: (2,) px.
        direction: (2,) of length 1.
        seen_share: share of the side on which the outline lies on the line; 0 along the edge.
        at_edge: True along the edge of the photo, where nothing shows it.
    """

    point: FloatArray
    direction: FloatArray
    seen_share: float
    at_edge: bool = False


def find_frame(image: UInt8Array) -> Frame:
    """Return what is round the picture in a photo (H, W, 3)."""
    border = find_border(image)
    if border is not None:
        several = len(_outermost_layer(image).uncut)
        if several > 2:  # their common border is no frame
            return Frame(warning=_several_warning(several))
    parted = count_pictures(image if border is None else image[border])
    if parted > 1:
        return Frame(border, "" if border is None else _BORDER, _several_warning(parted))
    frame = _remove_frames(image, border)
    if frame.inside is border and not frame.warning:
        joined = count_joined_pictures(image if border is None else image[border])
        return replace(frame, warning=_several_warning(joined) if joined > 1 else "")
    return frame


def _remove_frames(image: UInt8Array, inside: Inside | None) -> Frame:
    """Return the picture inside the border of a photo (H, W, 3) without bed, white and mount."""
    rows, columns = inside or (slice(0, image.shape[0]), slice(0, image.shape[1]))
    frame = Frame(inside, "" if inside is None else _BORDER)
    left, right, top, bottom = columns.start, columns.stop, rows.start, rows.stop
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]], float)
    part = image[rows, columns]
    for _ in range(_LAYERS):
        layer, uncut = _outermost_layer(part)
        if len(uncut) > 1:
            return replace(frame, warning=_several_warning(len(uncut)))
        if uncut:
            warning = (
                f"a photo of a picture? Four straight lines enclose {uncut[0].share:.0%} of it, as "
                "a screen or a print does: all distances and sizes are then wrong. Cut the picture "
                "out, straighten it, and run that"
            )
            return replace(frame, warning=warning)
        if layer is None:
            break
        corners = cv2.perspectiveTransform(
            layer.corners[None], np.linalg.inv(_homography_to_upright(corners))
        )[0]
        is_print = frame.is_print or layer.turn_deg > _STRAIGHT_DEG
        frame = Frame(_inner_rectangle(corners), "what surrounds the picture", is_print=is_print)
        width, height = _width_and_height(corners)
        part = cv2.warpPerspective(
            image, _homography_to_upright(corners), (round(width), round(height))
        )
    return frame


def smooth_background(image: UInt8Array) -> BoolArray | None:
    """Return where (H, W) an image (H, W, 3) shows a ground of one colour that reaches its edge, as
    of a studio or a cut-out; None if there is little of it.
    """
    height, width = image.shape[:2]
    scale = max(1.0, max(height, width) / _GROUND_SIDE)
    size = max(1, round(width / scale)), max(1, round(height / scale))
    small = cv2.medianBlur(cv2.resize(image, size, interpolation=cv2.INTER_AREA), 3).astype(int)
    outermost = np.concatenate([small[0], small[:, 0], small[:, -1]])
    near = largest_channel(np.abs(small - np.median(outermost, axis=0))) <= _ONE_COLOUR
    _, labels = cv2.connectedComponents(near.astype(np.uint8), connectivity=4)
    edge = np.concatenate([labels[0], labels[:, 0], labels[:, -1]])
    ground = near & np.isin(labels, edge)
    if ground.mean() < _PLAIN_GROUND:
        return None
    whole = cv2.resize(ground.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    return np.asarray(whole > 0)


def _width_and_height(corners: FloatArray) -> tuple[float, float]:
    """Return width and height of a picture with corners (4, 2), clockwise from the upper left."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return float(sides[[0, 2]].mean()), float(sides[[1, 3]].mean())


def _homography_to_upright(corners: FloatArray) -> FloatArray:
    """Return the homography (3, 3) that puts corners (4, 2) at those of an upright picture."""
    width, height = _width_and_height(corners)
    upright = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    return np.asarray(cv2.getPerspectiveTransform(corners.astype(np.float32), upright))


def _outermost_layer(image: UInt8Array) -> _Layer:
    """Return what the outermost ground of an image (H, W, 3) is round; the picture to cut out in px
    of the image.
    """
    scale = max(1.0, max(image.shape[:2]) / _SIDE)
    height, width = (max(1, round(side / scale)) for side in image.shape[:2])
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    small = cv2.medianBlur(small, 3)
    outer, enclosing = _background_masks(small)
    pictures = _inner_pictures(outer) if outer.any() else []
    if len(pictures) > 1 and sum(picture.share for picture in pictures) >= _PARTS:
        return _Layer(uncut=tuple(pictures))
    for picture in pictures[:1]:
        if picture.share < max(_PICTURE, _MOST * _largest_share(~outer)):
            break
        if picture.broken or max(picture.turn_deg, picture.skew_deg) > _CUT_DEG:
            return _Layer(uncut=(picture,))
        # inwards by what the scale and the median blur
        middle = picture.corners.mean(0)
        size = np.array([width, height])
        at_edge = (picture.corners < _EDGE_PX) | (picture.corners > size - 1 - _EDGE_PX)
        corners = np.where(
            at_edge,
            np.where(picture.corners < middle, 0, size),
            picture.corners + np.where(picture.corners < middle, 2, -1),
        )
        return _Layer(replace(picture, corners=corners * (np.array(image.shape[1::-1]) / size)))
    for ground in enclosing:
        for picture in _inner_pictures(ground):
            if picture.share >= _ENCLOSED and picture.inner == 4:
                return _Layer(uncut=(picture,))
    return _Layer()


def _largest_share(parts: BoolArray) -> float:
    """Return the share of the largest connected part of a photo (H, W)."""
    *_, stats, _ = cv2.connectedComponentsWithStats(parts.astype(np.uint8), connectivity=4)
    return float(stats[1:, cv2.CC_STAT_AREA].max(initial=0)) / parts.size


def _several_warning(number: int) -> str:
    return (
        f"{number} pictures in one file? Straight seams or a plain background separate them. "
        "Distances between people in two pictures are meaningless: cut them apart, and run each"
    )


def _background_masks(small: UInt8Array) -> tuple[BoolArray, list[BoolArray]]:
    """Return where a smooth ground is round or beside pictures (H, W), and the grounds that may
    enclose one inside the photo.
    """
    height, width = small.shape[:2]
    values = np.rint(lab_from_srgb(small) * _LAB_STEPS).astype(np.int16)
    smooth = _smooth_pixels(values)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(smooth, connectivity=4)
    outer = _blurred_sides(smooth > 0)
    enclosing = [_textured_ground(values)]
    for label, (x, y, w, h, area) in list(enumerate(stats.tolist()))[1:]:
        is_strip = (w == width or h == height) and area > _FILLED * w * h
        if area < _GROUND * height * width and not is_strip:
            continue
        # the pixels between a ground and the picture belong to neither
        ground = cv2.dilate((labels == label).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        if x > 0 and y > 0 and x + w < width and y + h < height:
            enclosing.append(ground)
        elif any(_is_frame(one, small[labels == label]) for one in _inner_pictures(ground)):
            outer |= ground
    return outer, enclosing


def _blurred_sides(smooth: BoolArray) -> BoolArray:
    """Return the smooth sides (H, W) of equal width beside an upright film; nowhere without."""
    width = smooth.shape[1]
    rough = smooth.mean(0) < 1 - _ROUGH
    left, right = int(rough.argmax()), int(rough[::-1].argmax())
    sides = np.zeros(smooth.shape, bool)
    ends = smooth[:, left : left + 3], smooth[:, width - right - 3 : width - right]
    if (
        min(left, right) > _GROUND * width
        and abs(left - right) <= _LINE_PX
        and all((~end).any(1).mean() >= _SEEN for end in ends)
    ):
        sides[:, :left] = sides[:, width - right :] = True
    return sides


def _smooth_pixels(values: NDArray[np.int16]) -> UInt8Array:
    """Return where colours (H, W, 3) change no more than by the noise at the edge of a photo."""
    steps = [largest_channel(np.abs(np.diff(values, axis=axis))) for axis in (0, 1)]
    noise = np.mean([*steps[0][:, 0], *steps[0][:, -1], *steps[1][0], *steps[1][-1]])
    most = min(_STEPS[0] + 3 * noise, _STEPS[1])
    smooth = np.ones(values.shape[:2], np.uint8)
    for axis, step in enumerate(steps):
        before, after = (np.insert(step <= most, end, True, axis) for end in (step.shape[axis], 0))
        smooth &= before & after
    return smooth


def _textured_ground(values: NDArray[np.int16]) -> BoolArray:
    """Return where (H, W) a photo with colours (H, W, 3) shows what is all along its edge, such as
    wood or cloth; nowhere if its edge shows several things.
    """
    mixed = cv2.GaussianBlur(values, (0, 0), _MIXED_PX).astype(float)
    edge = np.concatenate([mixed[0], mixed[-1], mixed[:, 0], mixed[:, -1]])
    middle = np.median(edge, axis=0)
    spread = np.quantile(np.abs(edge - middle), 0.9, axis=0)
    if spread.max() > _ONE_GROUND:
        return np.zeros(mixed.shape[:2], bool)
    ground: BoolArray = (np.abs(mixed - middle) <= 2 * np.maximum(spread, _STEPS[1])).all(-1)
    return ground


def _is_frame(picture: _InnerPicture, colors: UInt8Array) -> bool:
    """Return whether a ground is the frame of a picture, not a wall or a sky beside a scene: it is
    on two sides that meet, or a bar of one colour along the pixels.
    """
    if picture.inner >= 3:
        return True
    if picture.inner == 0 or picture.turn_deg > _STRAIGHT_DEG:
        return False
    return bool(np.abs(colors - np.median(colors, axis=0)).mean(0).max() <= _PLAIN_BAR)


def _inner_pictures(ground: BoolArray) -> list[_InnerPicture]:
    """Return the parts beside a ground (H, W) whose outline is four lines, the largest first."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        (~ground).astype(np.uint8), connectivity=4
    )
    area = ground.size
    pictures = [
        one
        for label in range(1, count)
        if stats[label, cv2.CC_STAT_AREA] >= _PART * area
        and (one := _inner_picture(labels == label)) is not None
    ]
    return sorted(pictures, key=lambda one: -one.share)


def _inner_picture(part: BoolArray) -> _InnerPicture | None:
    """Return the picture that a part of a photo (H, W) is, None without four lines."""
    # without the crumbs of a ground with texture
    clean = cv2.morphologyEx(part.astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    outlines, _ = cv2.findContours(clean, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return None
    outline = max(outlines, key=len)
    hull = cv2.convexHull(outline)
    starts = [cv2.boxPoints(cv2.minAreaRect(hull)).astype(float)]
    length = cv2.arcLength(hull, True)
    for share in np.linspace(0.01, 0.05, 9):
        corners = cv2.approxPolyDP(hull, share * length, True)
        if len(corners) <= 4:
            starts += [corners[:, 0].astype(float)] if len(corners) == 4 else []
            break
    candidates = [
        _inner_picture_from_corners(start, outline[:, 0].astype(float), part.shape)
        for start in starts
    ]
    return min(filter(None, candidates), key=lambda one: one.broken, default=None)


def _inner_picture_from_corners(
    start: FloatArray, points: FloatArray, size: tuple[int, int]
) -> _InnerPicture | None:
    """Return the picture whose sides are the lines nearest to those of four corners (4, 2); None if
    the points (P, 2) of its outline lie elsewhere.
    """
    sides = [
        side
        for corner, end in zip(start, np.roll(start, -1, axis=0), strict=True)
        if (side := _line_at_side(corner, end, points, size)) is not None
    ]
    inner = [side for side in sides if not side.at_edge]
    broken = sum(side.seen_share < _SEEN for side in inner)
    if len(sides) < 4 or not inner or broken > (len(inner) == 4):
        return None
    normals = np.array([[y, -x] for x, y in (side.direction for side in sides)])
    corners = _line_intersections(normals, (normals * [side.point for side in sides]).sum(1))
    if corners is None:
        return None
    angles = np.degrees(np.arctan2(normals[:, 1], normals[:, 0]))
    turns = np.abs((angles + 45) % 90 - 45).tolist()
    return _InnerPicture(
        corners,
        cv2.contourArea(corners.astype(np.float32)) / math.prod(size),
        len(inner),
        max(turn for turn, side in zip(turns, sides, strict=True) if not side.at_edge),
        float(np.abs((angles - np.roll(angles, 1)) % 180 - 90).max()),
        broken,
    )


def _line_intersections(normals: FloatArray, offsets: FloatArray) -> FloatArray | None:
    """Return where each of four lines crosses the one before, (4, 2), clockwise from the upper
    left; None if two are almost parallel.

    Args:
        normals: (4, 2) of length 1.
        offsets: (4,) of the lines along them, px.
    """
    pairs = np.stack([np.roll(normals, 1, axis=0), normals], axis=1)
    if np.abs(np.linalg.det(pairs)).min() < 0.5:
        return None
    both = np.stack([np.roll(offsets, 1), offsets], axis=1)
    return _clockwise(np.linalg.solve(pairs, both[..., None])[..., 0])


def _clockwise(corners: FloatArray) -> FloatArray:
    """Return corners (4, 2) clockwise from the upper left."""
    away = corners - corners.mean(0)
    around = corners[np.argsort(np.arctan2(away[:, 1], away[:, 0]))]
    return np.roll(around, -int(around.sum(1).argmin()), axis=0)


def _line_at_side(
    corner: FloatArray, end: FloatArray, points: FloatArray, size: tuple[int, int]
) -> _Line | None:
    """Return the line nearest to a side by the points of the outline (P, 2); None if the side is
    too short.
    """
    length = float(np.linalg.norm(end - corner))
    if length < 4 * _EDGE_PX:
        return None
    along = (end - corner) / length
    for axis in (0, 1):
        for limit in (0, size[1 - axis] - 1):
            if max(abs(corner[axis] - limit), abs(end[axis] - limit)) <= _EDGE_PX:
                direction = np.array([axis == 1, axis == 0], float)
                return _Line(np.where(direction, corner, limit), direction, 0.0, at_edge=True)
    positions = (points - corner) @ along
    apart = (points - corner) @ np.array([-along[1], along[0]])
    near = (np.abs(apart) <= _NEAR_PX) & (positions > 0.1 * length) & (positions < 0.9 * length)
    if near.sum() < 0.3 * length:
        return _Line(corner, along, 0.0)
    x, y, px, py = cv2.fitLine(
        points[near].astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01
    ).ravel()
    base = np.array([px, py], float)
    direction = np.array([x, y], float)
    on_line = np.abs((points[near] - base) @ np.array([-y, x])) <= _LINE_PX
    share = len(np.unique(positions[near][on_line].astype(int))) / (0.8 * length)
    return _Line(base, direction, share)


def _inner_rectangle(corners: FloatArray) -> Inside:
    """Return the rows and columns inside four corners (4, 2), px."""
    rows, columns = (
        slice(math.ceil(values[1] - 1e-3), math.floor(values[2] + 1e-3))
        for values in (np.sort(corners[:, 1]), np.sort(corners[:, 0]))
    )
    return rows, columns
