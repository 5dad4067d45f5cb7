"""Estimate a relative point map from Depth Anything V2, a focal length and the disparity at
infinity.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.backends.masks import dilate
from physic_core.errors import BackendError
from physic_core.interfaces import Options, RelativePointmap
from physic_core.types import CameraTrust, Intrinsics, Pointmap
from physic_embedded.networks.depth_anything import (
    disparity_and_tokens,
    patch_tokens,
    predict_disparity,
)
from physic_embedded.networks.line_segments import detect_line_segments, segments_outside_mask
from physic_embedded.networks.sessions import PackagedBackend, Products, open_packaged_session
from physic_embedded.single_view.disparity_floor import fit_disparity_floor
from physic_embedded.single_view.disparity_offset import InfinityEstimate, disparity_at_infinity
from physic_embedded.single_view.flying_pixels import flying_pixels
from physic_embedded.single_view.focal import (
    DEFAULT_FOCAL_SIGMA,
    focal_of_segments,
    manhattan_frame,
)
from physic_embedded.single_view.gravity import (
    PICTURE_PATCHES,
    PICTURE_SIDE_PX,
    UpInPhoto,
    fitted_numbers,
    up_from_edges,
    up_from_tokens,
)
from physic_embedded.single_view.scene_disparity import line_through, scene_disparity
from physic_embedded.single_view.vertical_costs import (
    NO_PLANES,
    body_planes,
    local_disparity_planes,
)
from physic_networks.canonical_depth import known_camera
from physic_networks.pictures import resize_map

if TYPE_CHECKING:
    from physic_core.types import (
        BoolArray,
        Float32Array,
        Float64Array,
        FloatArray,
        Hints,
        UInt8Array,
    )
    from physic_embedded.networks.patch_tokens import PatchTokens
    from physic_networks.onnx_sessions import OnnxSession


_DEPTH = "depth_anything_v2_vits"
_LINES = "mlsd_large_512"
_MIN_GAP = 0.002  # ranges of the disparity from infinity to the farthest point: depth stays finite
_SKY_DISPARITY = 0.004  # ranges: the network answers 0 for the sky
_MIN_RELIABLE_GAP = 0.01  # ranges; beyond, the noise of the network is larger than its signal

_SURE_FOCAL_SIGMA = 0.1  # of log focal length: up to it, vanishing points count as an estimate
_DOUBTFUL_FACTOR = 3.0  # by which the background may be off; a fifth of the photos exceed it
_FEW_LABELS = 0.1  # share of the photo; fewer labels say less
_HORIZON_GAP = 0.03  # of the photo's height, between the labels of sky and ground
_HORIZON_SHARE = 0.15  # of the photo's columns that show it
_BLEEDS = 0.015  # of the long side: the depth of a person beyond the outline
_MARGIN = 0.008  # the same beyond the hole
_PEOPLE_FARTHER = (0.180, 0.123)  # median and spread of 166 people on their feet in labelled photos
_PHOTO_SHORT_SIDE_PX = 406  # of the photo with its people
# Of the photo without them, beside that look. 252 px lose what lies behind people. Up by these
# tokens is as good as by those of the size that they are fitted to: 20 photos are 17.6 degrees off,
# and 17.8 (rms, domes among them).
_INPAINTED_SHORT_SIDE_PX = 322
_DEFAULT_FOCAL = 0.85  # long sides, where neither file, user nor edges give a focal length


class EmbeddedPointmapOptions(Options):
    """Settings of the embedded relative point map.

    The default focal length lies between those of phones and of other cameras. Main cameras of
    phones are stated as 24 to 28 mm in 35 mm terms, by the diagonal: .69 to .81 of the long side of
    a 4:3 photo. Kit zooms start at 24 to 28 mm and are mostly used at 35 to 50 mm, .97 to 1.39 of
    the long side of a 3:2 photo.
    """

    short_side: int = Field(
        518,
        ge=70,
        le=4096,
        description="px of the short side that the network sees, 518 as trained; of a photo with "
        "people at most 406, and 322 of the inpainted one",
    )
    max_tokens: int = Field(
        3600,
        ge=64,
        le=100_000,
        description="cap on 14 px patches, which limits the time of long panoramas",
    )
    focal_from_edges: bool = Field(
        True, description="look for a focal length in the straight edges of the photo"
    )
    products: Products = Field(
        "float32",
        description="arithmetic of the depth network's matrix products; auto is int8 on the CPU "
        "and float32 elsewhere. "
        "int8 takes two thirds of the time, but one level of one pixel can then move the scene by "
        "centimeters",
    )
    threads: int = Field(
        2, ge=0, le=256, description="threads of the network; 0: one for each core of the process"
    )


class EmbeddedPointmap(PackagedBackend, RelativePointmap):
    """Relative point map by Depth Anything V2.

    The first call, for the inpainted photo, finds the focal length and the disparity at infinity.
    With ``hints.photo`` it joins a small look at the inpainted photo with one at the photo, whose
    details it has beside the people. A call with ``hints.scene`` takes both from it: the same
    camera, and the disparity that agrees with it outside the people. It uses the look at the photo
    again.
    """

    written_for = 1
    weights_license = "Apache-2.0 (Depth Anything V2 Small, DINOv2, M-LSD)"
    Options = EmbeddedPointmapOptions
    options: EmbeddedPointmapOptions

    networks = (_DEPTH,)
    _photo: tuple[bytes, FloatArray] | None = None  # digest of the last photo, and its disparity

    def build(self, device: str) -> dict[str, OnnxSession]:
        """Open the depth network and, if ``focal_from_edges`` is set, the line segment network."""
        lines = {}
        if self.options.focal_from_edges:
            lines = {_LINES: open_packaged_session(_LINES, self.options.threads, device)}
        return super().build(device) | lines

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Return points whose inverse depth is known up to scale and shift, with median depth 1.

        Points farther than the network resolves, and points between a near and a far surface, are
        not valid.

        Raises:
            BackendError: the networks are not loaded.
        """
        height, width = image.shape[:2]
        tokens = None
        if hints.scene is not None:
            raw = self._disparity_of_photo(image)
            self._photo = None  # the same photo again needs tokens again
        else:
            raw, tokens = self._disparity_of_scene(image, hints)
        camera, segments, notes = self._camera(image, hints)
        scene_match = _match_to_scene(raw, hints)
        up = None
        disparity_sigma: float | None = None
        warnings: list[str] = []
        if scene_match is None:
            if hints.scene is not None:
                notes.append(
                    "depth with people could not be matched to depth without them, so gaps between "
                    "people and scene may be wrong. Try --set inpainter.backend=telea"
                )
            look = up_from_tokens(tokens or self._tokens_at_small_size(image), fitted_numbers())
            frame = manhattan_frame(segments, width, height, camera.fx)
            up = up_from_edges(frame, _outdoor_sign(hints), look)
            estimate = _disparity_at_infinity(raw, camera, hints, frame, up)
            up = up or look
            infinity = estimate.disparity
            disparity_sigma = estimate.disparity_sigma
            factor = float(np.exp(estimate.sigma))
            (warnings if factor > _DOUBTFUL_FACTOR else notes).append(
                f"the farthest background may be {factor:.2g} times farther or nearer (one "
                f"standard deviation). Do not measure there, or give --depth FILE. The error is "
                "smaller for people and things near them"
            )
        else:
            infinity, scale = scene_match
        gap, is_unreliable = _disparity_above_infinity(raw, infinity)
        unit = float(np.median(gap[~is_unreliable])) if scene_match is None else 1 / scale
        depth = 1 / resize_map((gap / unit).astype(np.float32), height, width)
        shift_sigma = None if disparity_sigma is None else disparity_sigma / unit
        return Pointmap(
            _unproject(depth, camera),
            resize_map(is_unreliable.astype(np.float32), height, width) < 0.5,
            "inverse_scale_shift",
            camera,
            tuple(notes),
            shift_sigma,
            people_farther=_PEOPLE_FARTHER,
            warnings=tuple(warnings),
            up=None if up is None else up.up,
            up_sigma=None if up is None else up.sigma,
            up_source="" if up is None else up.source,
        )

    def _disparity_of_photo(self, photo: UInt8Array) -> FloatArray:
        """Return the disparity of a photo with people: that of the call before, or a new one, which
        is kept.
        """
        digest = hashlib.blake2b(np.ascontiguousarray(photo).data).digest()
        if self._photo is None or self._photo[0] != digest:
            side = min(self.options.short_side, _PHOTO_SHORT_SIDE_PX)
            raw = predict_disparity(
                self.network[_DEPTH], photo, side, self.options.max_tokens, keep_tokens=True
            )
            self._photo = digest, raw
        return self._photo[1]

    def _disparity_of_scene(
        self, image: UInt8Array, hints: Hints
    ) -> tuple[FloatArray, PatchTokens | None]:
        """Return the disparity of a photo without its people, and the tokens of a small look at
        it, if there was one.
        """
        network = self.network[_DEPTH]
        options = self.options
        if hints.photo is None or hints.hole is None or not hints.hole.any():
            return predict_disparity(network, image, options.short_side, options.max_tokens), None
        side = min(options.short_side, _INPAINTED_SHORT_SIDE_PX)
        small, tokens = disparity_and_tokens(network, image, side, options.max_tokens)
        photo = self._disparity_of_photo(hints.photo)
        return scene_disparity(small, photo, _pixels_away_from(hints.hole, _MARGIN, photo)), tokens

    def _tokens_at_small_size(self, image: UInt8Array) -> PatchTokens:
        network = self.network[_DEPTH]
        return patch_tokens(
            network.name, lambda _: network, image, PICTURE_SIDE_PX, PICTURE_PATCHES
        )

    def _camera(
        self, image: UInt8Array, hints: Hints
    ) -> tuple[Intrinsics, Float64Array, list[str]]:
        """Return the known, edge-based or default camera, line segments (M, 2, 2), and notes.

        M is 0 where no edges are looked for.
        """
        height, width = image.shape[:2]
        camera = known_camera(hints, image)
        notes = []
        segments = np.zeros((0, 2, 2))
        if self.options.focal_from_edges and hints.scene is None:
            # Inpainted pixels have lines of their own, which a hole one pixel wider changes.
            segments = detect_line_segments(
                self.network[_LINES], image if hints.photo is None else hints.photo
            )
            if hints.hole is not None:
                segments = segments_outside_mask(segments, hints.hole)
        if camera is None:
            camera, note = self._estimated_camera(segments, width, height)
            notes = [note]
        return camera, segments, notes

    def _estimated_camera(
        self, segments: Float64Array, width: int, height: int
    ) -> tuple[Intrinsics, str]:
        """Return the camera by the default and the segments, and a note."""
        default = _DEFAULT_FOCAL
        focal = default * max(width, height)
        sigma = DEFAULT_FOCAL_SIGMA
        source = f"default ({default:g} x the long side)"
        estimated_focal = focal_of_segments(segments, width, height, focal, sigma)
        if estimated_focal is not None:
            focal, sigma = estimated_focal
            source += " and vanishing points"
        trust = CameraTrust.ESTIMATED if sigma <= _SURE_FOCAL_SIGMA else CameraTrust.GUESSED
        camera = Intrinsics.from_focal(focal, width, height, source, trust)
        how = "a default" if estimated_focal is None else "estimated from straight edges"
        note = (
            f"the focal length is {how}, so all distances may be off by {sigma:.0%} (one standard "
            f"deviation). Run the original file, whose EXIF data may state it, or give --focal-px "
            "PX"
        )
        return replace(camera, focal_sigma=sigma), note


def _disparity_above_infinity(raw: FloatArray, infinity: float) -> tuple[FloatArray, BoolArray]:
    """Return the disparities (h, w) above that of infinity, and where depth is not reliable.

    Raises:
        BackendError: it is nowhere.
    """
    low = np.percentile(raw, 1)
    span = max(float(np.percentile(raw, 99) - low), 1e-6)
    gap = np.maximum(raw - infinity, _MIN_GAP * span)
    too_far = (raw - infinity < _MIN_RELIABLE_GAP * span) | (raw < _SKY_DISPARITY * span)
    lost = flying_pixels(gap) | too_far
    if lost.all():
        raise BackendError(
            "the depth network detects no structure in the photo: no pixel has a reliable depth"
        )
    return gap, lost


def _unproject(depth: FloatArray, camera: Intrinsics) -> Float32Array:
    """Return the points (H, W, 3) float32 at depths (H, W)."""
    height, width = depth.shape
    columns = np.arange(width, dtype=np.float32)
    rows = np.arange(height, dtype=np.float32)
    points = np.empty((height, width, 3), np.float32)
    points[..., 0] = depth * ((columns - camera.cx) / camera.fx)[None, :]
    points[..., 1] = depth * ((rows - camera.cy) / camera.fy)[:, None]
    points[..., 2] = depth
    return points


def _disparity_at_infinity(
    raw: FloatArray,
    camera: Intrinsics,
    hints: Hints,
    frame: tuple[FloatArray, float] | None,
    up: UpInPhoto | None,
) -> InfinityEstimate:
    """Estimate the disparity at infinity from the photo's cues."""
    rows, columns = raw.shape
    focal = camera.fx * columns / camera.width
    labels = None if hints.people is None else hints.people.surfaces

    def labelled(*names: str) -> BoolArray | None:
        return None if labels is None else _shrink_labels(labels.mask(*names), rows, columns)

    ground = labelled("floor", "ground", "rug")
    walls = labelled("wall", "cabinet")
    hole = None if hints.hole is None else _shrink_mask(hints.hole, rows, columns)
    is_visible = np.ones(raw.shape, bool) if hole is None else ~hole
    return disparity_at_infinity(
        raw,
        fit_disparity_floor(raw, hole, ground),
        focal,
        pitch=None if up is None else up.pitch,
        focal_sigma=0.0 if camera.known else camera.focal_sigma or 0.0,
        walls=NO_PLANES if walls is None else local_disparity_planes(raw, walls, focal),
        bodies=body_planes(hints.keypoints, (camera.cx, camera.cy), camera.fx),
        frame=frame,
        surfaces=NO_PLANES if frame is None else local_disparity_planes(raw, is_visible, focal),
        open_air=_outdoor_sign(hints),
        horizon=_horizon(labelled("sky"), labelled("water", "ground")),
    )


def _outdoor_sign(hints: Hints) -> float:
    """Return whether labels are of outdoors, 1, or of rooms, -1; 0 for neither or both."""
    labels = None if hints.people is None else hints.people.surfaces
    if labels is None:
        return 0.0
    outdoors, indoors = labels.outdoor_and_indoor_shares
    return (outdoors - indoors) / (outdoors + indoors + _FEW_LABELS)


def _horizon(sky: BoolArray | None, ground: BoolArray | None) -> FloatArray | None:
    """Return the pixels (M, 2) between sky and the ground or water right below it."""
    if sky is None or ground is None:
        return None
    rows = np.arange(len(sky))[:, None]
    top = np.where(ground.any(0), ground.argmax(0), len(sky))
    last = np.where(sky & (rows < top), rows, -len(sky)).max(0)
    columns = np.flatnonzero((top < len(sky)) & (top - last <= _HORIZON_GAP * len(sky)))
    if len(columns) < _HORIZON_SHARE * sky.shape[1]:
        return None
    return np.stack([columns, (top + last)[columns] / 2], 1)


def _shrink_mask(mask: BoolArray, rows: int, columns: int) -> BoolArray:
    """Resize a mask to network resolution; True if any pixel is."""
    import cv2

    small = cv2.resize(mask.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(small > 0)


def _shrink_labels(mask: BoolArray, rows: int, columns: int) -> BoolArray:
    """Resize a mask to network resolution by its nearest pixels."""
    import cv2

    return np.asarray(
        cv2.resize(mask.astype(np.uint8), (columns, rows), interpolation=cv2.INTER_NEAREST_EXACT)
        > 0
    )


def _match_to_scene(raw: FloatArray, hints: Hints) -> tuple[float, float] | None:
    """Return infinity and scale of the map ``scale * (disparity - infinity)`` to the inverse depth
    of the scene, fitted outside the people by reweighted least squares; None without a scene, or if
    they do not match.
    """
    import cv2

    if hints.scene is None:
        return None
    rows, columns = raw.shape
    z = np.where(hints.scene.valid, hints.scene.points[..., 2], np.inf)
    target = cv2.resize(
        (1 / z).astype(np.float32), (columns, rows), interpolation=cv2.INTER_NEAREST
    )
    usable = target > 0
    if hints.people is not None and len(hints.people):
        anybody = np.asarray(hints.people.masks.any(0))
        usable &= _pixels_away_from(anybody, _BLEEDS, raw)
    if usable.mean() < 0.05:
        return None
    line = line_through(raw[usable], target[usable])
    return None if line is None else (-line[1] / line[0], line[0])


def _pixels_away_from(mask: BoolArray, margin: float, raw: FloatArray) -> BoolArray:
    """Return the pixels of a map (h, w) that are farther from a mask (H, W) than a share of its
    long side.
    """
    wider = dilate(mask, max(2, round(margin * max(mask.shape))))
    return ~_shrink_mask(wider, *raw.shape)
