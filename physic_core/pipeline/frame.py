"""Find the picture in a photo of something that shows it: a screenshot, a scanned print, an album.

A frame is a smooth ground, whatever its colour, noise and ink, that straight lines part from the
picture. A plain background of a studio has no such lines, and a scene no four of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from physic_core.geometry.colors import lab_from_srgb
from physic_core.io.photo import MIN_SIDE
from physic_core.pipeline.border import find_inside

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array

    Inside = tuple[slice, slice]

_SIDE = 400  # px of the long side, at which the noise of a scan is averaged
_STEPS = (2, 6)  # difference of neighbours in a ground without noise, and in any, of 255 in Lab
_LAYERS = 3  # a scanner's bed, the white of a print, its mount
_GROUND = 0.02  # least share of the area, but of a strip across the photo
_FILLED = 0.8  # share of the box round such a strip
_PICTURE = 0.15  # least share of a picture that is cut out
_ENCLOSED = 0.2  # the same of one whose frame does not reach the edge of the photo
_PART = 0.04  # the same of one of several
_PARTS = 0.4  # least share of several together
_LINE_PX = 2.5
_NEAR_PX = 6.0
_SEEN = 0.8  # share of a side that the ground ends at
_EDGE_PX = 4
_CUT_DEG = 6.0  # the rectangle inside a picture that is turned more has too little of it
_STRAIGHT_DEG = 0.5  # of a bar that crosses the photo: a screen draws it along the pixels
_PLAIN_BAR = 0.75  # mean deviation of such a bar's colour, of 255
_SQUARE_DEG = 6.0  # a corner of a picture that is looked at from the front
_ONE_COLOUR = 4  # largest difference of a plain ground from its colour; walls have shading
_PLAIN_GROUND = 0.3  # least share of the area
_TWIN_SIDE = 240
_BLOCK = 24
_SHIFT = 0.12  # of the width of a half: largest disparity of two views
_TWINS = 0.72  # median correlation of the blocks of two views
_TEXTURE = 4.0
_TEXTURED = 0.3
_SEAM = 0.55  # share of the rows with a step in the middle


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
class _Picture:
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


def find_frame(image: UInt8Array) -> Frame:
    """Return what is round the picture in a photo (H, W, 3)."""
    inside = find_inside(image)
    rows, columns = inside or (slice(0, image.shape[0]), slice(0, image.shape[1]))
    frame = Frame(inside, "" if inside is None else "a border of one colour")
    corners = np.array([
        [columns.start, rows.start],
        [columns.stop, rows.start],
        [columns.stop, rows.stop],
        [columns.start, rows.stop],
    ], float)  # fmt: skip
    part = image[rows, columns]
    warning = ""
    found = None
    for _ in range(_LAYERS):
        found = _layer(part)
        if found is None:
            break
        if isinstance(found, tuple):
            warning = _several(len(found)) if len(found) > 1 else _askew(found[0])
            break
        upright = _upright(corners)
        corners = cv2.perspectiveTransform(found.corners[None], np.linalg.inv(upright))[0]
        rows, columns = _rectangle_in(corners)
        is_print = frame.is_print or found.turn_deg > _STRAIGHT_DEG
        frame = Frame((rows, columns), "what is round the picture", is_print=is_print)
        width, height = _size(corners)
        part = cv2.warpPerspective(image, _upright(corners), (round(width), round(height)))
    # of more pictures than two, as of a sheet for a passport, half is no picture
    is_sheet = isinstance(found, tuple) and len(found) > 2
    half = None if is_sheet else _one_of_twins(image[rows, columns])
    if half is None:
        return replace(frame, warning=warning)
    axis, length = half
    kept = slice((rows, columns)[axis].start, (rows, columns)[axis].start + length)
    which = ("upper", "left")[axis]
    return replace(
        frame,
        inside=(kept, columns) if axis == 0 else (rows, kept),
        note=f"all but the {which} half",
        warning="the photo shows the same twice, as a stereo card does: its "
        f"{which} half alone was reconstructed. If people in it look squeezed, stretch the half to "
        "twice its length, and run that",
    )


def plain_ground(image: UInt8Array) -> BoolArray | None:
    """Return where (H, W) an image (H, W, 3) shows a ground of one colour that reaches its edge, as
    of a studio or a cut-out; None if there is little of it.
    """
    height, width = image.shape[:2]
    scale = max(1.0, max(height, width) / _SIDE)
    size = max(1, round(width / scale)), max(1, round(height / scale))
    small = cv2.medianBlur(cv2.resize(image, size, interpolation=cv2.INTER_AREA), 3).astype(int)
    outermost = np.concatenate([small[0], small[:, 0], small[:, -1]])
    near = np.abs(small - np.median(outermost, axis=0)).max(-1) <= _ONE_COLOUR
    _, labels = cv2.connectedComponents(near.astype(np.uint8), connectivity=4)
    edge = np.concatenate([labels[0], labels[:, 0], labels[:, -1]])
    ground = near & np.isin(labels, edge)
    if ground.mean() < _PLAIN_GROUND:
        return None
    whole = cv2.resize(ground.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    return np.asarray(whole > 0)


def _size(corners: FloatArray) -> tuple[float, float]:
    """Return width and height of a picture with corners (4, 2), clockwise from the upper left."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return float(sides[[0, 2]].mean()), float(sides[[1, 3]].mean())


def _upright(corners: FloatArray) -> FloatArray:
    """Return the homography (3, 3) that puts corners (4, 2) at those of an upright picture."""
    width, height = _size(corners)
    upright = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    return np.asarray(cv2.getPerspectiveTransform(corners.astype(np.float32), upright))


def _layer(image: UInt8Array) -> _Picture | tuple[_Picture, ...] | None:
    """Return the picture in the outermost ground, px of the image (H, W, 3); several in one file,
    or one that cannot be cut out, in a tuple; None without a frame.
    """
    scale = max(1.0, max(image.shape[:2]) / _SIDE)
    height, width = (max(1, round(side / scale)) for side in image.shape[:2])
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    small = cv2.medianBlur(small, 3)
    outer, enclosing = _grounds(small)
    pictures = _pictures(outer) if outer.any() else []
    if len(pictures) > 1 and sum(one.share for one in pictures) >= _PARTS:
        return tuple(pictures)
    for one in pictures[:1]:
        if one.share < _PICTURE:
            break
        if one.broken or one.turn_deg > _CUT_DEG or one.skew_deg > _SQUARE_DEG:
            return (one,)
        # inwards by what the scale and the median blur
        middle = one.corners.mean(0)
        size = np.array([width, height])
        at_edge = (one.corners < _EDGE_PX) | (one.corners > size - 1 - _EDGE_PX)
        corners = np.where(
            at_edge,
            np.where(one.corners < middle, 0, size),
            one.corners + np.where(one.corners < middle, 2, -1),
        )
        return replace(one, corners=corners * (np.array(image.shape[1::-1]) / size))
    for ground in enclosing:
        for one in _pictures(ground):
            if one.share >= _ENCLOSED and one.inner == 4:
                return (one,)
    return None


def _several(number: int) -> str:
    return f"{number} pictures in one file? A plain ground parts them: cut them apart, and run each"


def _askew(picture: _Picture) -> str:
    return (
        f"a photo of a picture? Four straight lines enclose {picture.share:.0%} of it, as a screen "
        "or a print does: distances are then those to nothing. Cut the picture out, straighten it, "
        "and run that"
    )


def _is_plain(colors: UInt8Array) -> bool:
    return bool(np.abs(colors - np.median(colors, axis=0)).mean(0).max() <= _PLAIN_BAR)


def _grounds(small: UInt8Array) -> tuple[BoolArray, list[BoolArray]]:
    """Return where a ground is round or beside pictures (H, W), and the grounds inside the photo
    that enclose something.
    """
    height, width = small.shape[:2]
    flat = np.ones((height, width), np.uint8)
    values = np.rint(lab_from_srgb(small) * [2.55, 1, 1]).astype(np.int16)
    outermost = np.concatenate([values[0], values[-1], values[:, 0], values[:, -1]])
    noise = float(np.abs(np.diff(outermost, axis=0)).max(-1).mean())
    most = min(_STEPS[0] + 3 * noise, _STEPS[1])
    for axis in (0, 1):
        steps = np.abs(np.diff(values, axis=axis)).max(-1) > most
        before = (slice(None),) * axis
        flat[(*before, slice(1, None))] &= ~steps
        flat[(*before, slice(None, -1))] &= ~steps
    count, labels, stats, _ = cv2.connectedComponentsWithStats(flat, connectivity=4)
    outer = np.zeros((height, width), bool)
    enclosing = []
    for label in range(1, count):
        x, y, w, h, area = stats[label]
        is_strip = (w == width or h == height) and area > _FILLED * w * h
        if area < _GROUND * height * width and not is_strip:
            continue
        # the pixels between a ground and the picture belong to neither
        ground = cv2.dilate((labels == label).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        at_edge = (x == 0) + (y == 0) + (x + w == width) + (y + h == height)
        if not at_edge:
            enclosing.append(ground)
            continue
        found = _pictures(ground)
        if any(_is_frame(one, small[labels == label]) for one in found):
            outer |= ground
    return outer, enclosing


def _is_frame(picture: _Picture, colors: UInt8Array) -> bool:
    """Return whether a ground is the frame of a picture, not a wall or a sky beside a scene: it is
    on two sides that meet, or a bar of one colour along the pixels.
    """
    if picture.inner >= 3:
        return True
    return picture.inner > 0 and picture.turn_deg <= _STRAIGHT_DEG and _is_plain(colors)


def _pictures(ground: BoolArray) -> list[_Picture]:
    """Return the parts beside a ground (H, W) whose outline is four lines, the largest first."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        (~ground).astype(np.uint8), connectivity=4
    )
    area = ground.size
    found = [
        one
        for label in range(1, count)
        if stats[label, cv2.CC_STAT_AREA] >= _PART * area
        and (one := _picture(labels == label)) is not None
    ]
    return sorted(found, key=lambda one: -one.share)


def _picture(part: BoolArray) -> _Picture | None:
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
    found = [_on_lines(start, outline[:, 0].astype(float), part.shape) for start in starts]
    return min(filter(None, found), key=lambda one: one.broken, default=None)


def _on_lines(start: FloatArray, points: FloatArray, size: tuple[int, int]) -> _Picture | None:
    """Return the picture whose sides are the lines nearest to those of four corners (4, 2); None if
    the points (P, 2) of its outline lie elsewhere.
    """
    sides = [
        _side(corner, end, points, size)
        for corner, end in zip(start, np.roll(start, -1, axis=0), strict=True)
    ]
    if any(one is None for one in sides):
        return None
    lines = np.array([[*line, along[1], -along[0]] for line, along, _ in filter(None, sides)])
    inner = np.array([seen is not None for _, _, seen in filter(None, sides)])
    broken = sum(seen is not None and seen < _SEEN for _, _, seen in filter(None, sides))
    if not inner.any() or broken > (inner.sum() == 4):
        return None
    normals: FloatArray = lines[:, 2:]
    offsets = (normals * lines[:, :2]).sum(1)
    corners: FloatArray = np.empty((4, 2))
    for number in range(4):  # of the line before and this one
        pair = [number - 1, number]
        if abs(np.linalg.det(normals[pair])) < 0.5:
            return None
        corners[number] = np.linalg.solve(normals[pair], offsets[pair])
    corners = _clockwise(corners)
    angles = np.degrees(np.arctan2(normals[:, 1], normals[:, 0]))
    turns = np.abs((angles + 45) % 90 - 45)
    skew = np.abs((angles - np.roll(angles, 1)) % 180 - 90)
    return _Picture(
        corners,
        cv2.contourArea(corners.astype(np.float32)) / math.prod(size),
        int(inner.sum()),
        float(turns[inner].max()),
        float(skew.max()),
        broken,
    )


def _clockwise(corners: FloatArray) -> FloatArray:
    """Return corners (4, 2) clockwise from the upper left."""
    away = corners - corners.mean(0)
    around = corners[np.argsort(np.arctan2(away[:, 1], away[:, 0]))]
    return np.roll(around, -int(around.sum(1).argmin()), axis=0)


def _side(
    corner: FloatArray, end: FloatArray, points: FloatArray, size: tuple[int, int]
) -> tuple[FloatArray, FloatArray, float | None] | None:
    """Return a point (2,) and the direction (2,) of the line nearest to a side, and the share of
    the side on which points of the outline (P, 2) lie on it, None at the edge of the photo; None
    without a line.
    """
    length = float(np.linalg.norm(end - corner))
    if length < 4 * _EDGE_PX:
        return None
    along = (end - corner) / length
    for axis in (0, 1):
        for limit in (0, size[1 - axis] - 1):
            if max(abs(corner[axis] - limit), abs(end[axis] - limit)) <= _EDGE_PX:
                direction = np.array([axis == 1, axis == 0], float)
                return np.where(direction, corner, limit), direction, None
    places = (points - corner) @ along
    apart = (points - corner) @ np.array([-along[1], along[0]])
    near = (np.abs(apart) <= _NEAR_PX) & (places > 0.1 * length) & (places < 0.9 * length)
    if near.sum() < 0.3 * length:
        return corner, along, 0.0
    x, y, px, py = cv2.fitLine(
        points[near].astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01
    ).ravel()
    base = np.array([px, py], float)
    direction = np.array([x, y], float)
    on_line = np.abs((points[near] - base) @ np.array([-y, x])) <= _LINE_PX
    seen = len(np.unique(places[near][on_line].astype(int))) / (0.8 * length)
    return base, direction, seen


def _rectangle_in(corners: FloatArray) -> Inside:
    """Return the rows and columns inside four corners (4, 2), px."""
    rows, columns = (
        slice(math.ceil(values[1] - 1e-3), math.floor(values[2] + 1e-3))
        for values in (np.sort(corners[:, 1]), np.sort(corners[:, 0]))
    )
    return rows, columns


def _one_of_twins(image: UInt8Array) -> tuple[int, int] | None:
    """Return the axis and the length of the half of an image (H, W, 3) if both halves show the
    same, side by side or one over the other; None if not.
    """
    for axis in (1, 0):
        across = image if axis == 1 else image.transpose(1, 0, 2)
        height, width = across.shape[:2]
        gap = _gap(across)
        half = (width - gap) // 2
        if half < MIN_SIDE:
            continue
        scale = _TWIN_SIDE / max(height, half)
        size = max(_BLOCK, round(half * scale)), max(_BLOCK, round(height * scale))
        grey = [
            cv2.resize(
                cv2.cvtColor(np.ascontiguousarray(part), cv2.COLOR_RGB2GRAY),
                size,
                interpolation=cv2.INTER_AREA,
            ).astype(np.float32)
            for part in (across[:, :half], across[:, -half:])
        ]
        views = grey if axis == 1 else [one.T for one in grey]
        if _agreement(*(np.ascontiguousarray(one) for one in views)) >= _TWINS and (
            gap or _has_seam(across)
        ):
            return axis, half
    return None


def _gap(image: UInt8Array) -> int:
    """Return the width of a strip of one colour in the middle of an image (H, W, 3), px."""
    middle = image.shape[1] // 2
    reach = image.shape[1] // 16
    columns = image[:: max(1, len(image) // _TWIN_SIDE), middle - reach : middle + reach]
    plain = columns.astype(np.int16).std(0).max(-1) <= _STEPS[1]
    if not plain[reach]:
        return 0
    before = reach - int(plain[reach::-1].argmin() if not plain[reach::-1].all() else 0)
    after = reach + int(plain[reach:].argmin() if not plain[reach:].all() else 0)
    return max(0, int(after - before - 1))


def _has_seam(image: UInt8Array) -> bool:
    """Return whether two pictures meet in the middle of an image (H, W, 3): the step there is
    larger than those beside it in most rows.
    """
    middle = image.shape[1] // 2
    steps = np.abs(np.diff(image[:, middle - 8 : middle + 8].astype(np.int16), axis=1)).sum(-1)
    largest = steps[:, 5:10].max(1)
    beside = np.concatenate([steps[:, :4], steps[:, 11:]], axis=1).max(1)
    return bool((largest > beside).mean() >= _SEAM)


def _agreement(left: FloatArray, right: FloatArray) -> float:
    """Return the median correlation of the blocks of one view (H, W) with those of the other, each
    at its best place nearby; 0 if few have texture.
    """
    height, width = left.shape
    reach = round(_SHIFT * width)
    slack = max(2, round(0.02 * height))
    wide = cv2.copyMakeBorder(right, slack, slack, reach, reach, cv2.BORDER_REPLICATE)
    found = []
    count = 0
    for y in range(0, height - _BLOCK + 1, _BLOCK):
        for x in range(0, width - _BLOCK + 1, _BLOCK):
            count += 1
            block = left[y : y + _BLOCK, x : x + _BLOCK]
            if block.std() >= _TEXTURE:
                around = wide[y : y + _BLOCK + 2 * slack, x : x + _BLOCK + 2 * reach]
                found.append(cv2.matchTemplate(around, block, cv2.TM_CCOEFF_NORMED).max())
    return float(np.median(found)) if len(found) >= _TEXTURED * max(count, 1) else 0.0
