"""Find the scene of a photo: the picture without its people, point maps, metric depth, and planes
that may be the floor.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.masks import dilate
from physic_core.errors import InputError, NoPersonError, PhysicError
from physic_core.interfaces import InpainterRequest, MetricDepthRequest, RelativePointmapRequest
from physic_core.types import DepthMap, Hints, Intrinsics, Pointmap
from physic_core.types.results import KNOWN_UP_SIGMA_DEG
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.engine.ground.floor import FloorCandidate, FloorEvidence
    from physic_core.engine.ground.floor_and_scale import Ground
    from physic_core.engine.photo_content import PhotoContent
    from physic_core.engine.placement.method import PlacementStageMethod
    from physic_core.geometry.depth_comparison import Comparison
    from physic_core.pipeline.find_people import FoundPeople
    from physic_core.pipeline.photo_run import PhotoRun
    from physic_core.types import (
        Bodies,
        BoolArray,
        FloatArray,
        Keypoints,
        Observations,
        People,
        UInt8Array,
    )


@dataclass(frozen=True)
class Inpainting(ShortRepr):
    """The photo without its people.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        hole: (H, W) bool, its inpainted pixels.
    """

    image: UInt8Array
    hole: BoolArray


@dataclass(frozen=True)
class Maps(ShortRepr):
    """Geometry of a photo before its scale is known.

    Attributes:
        inpainting: the photo without its people.
        scene: its point map, in a usual unit.
        original: of the photo; its shape is the people's.
        camera: of both.
        metric_depth: metric depth with a scale of its own, without the hole; None without one.
        hints: for the next backend, with the scene as it was measured or estimated.
        depth_comparison: of a depth or point map of a file; None without one.
    """

    inpainting: Inpainting
    scene: Pointmap
    original: Pointmap
    camera: Intrinsics
    metric_depth: DepthMap | None
    hints: Hints
    depth_comparison: Comparison | None = None


@dataclass(frozen=True)
class Floors(ShortRepr):
    """What a photo tells of its floor before bodies are estimated.

    Attributes:
        evidence: about the floor.
        candidates: planes that may be it.
        hints: for the next backend, with the best plane.
    """

    evidence: FloorEvidence
    candidates: tuple[FloorCandidate, ...]
    hints: Hints


def inpaint_people(run: PhotoRun, people: People) -> Inpainting:
    """Remove people, and what stands out as a person without a body, from the photo."""
    hole = np.logical_or.reduce(people.masks)
    if people.unposed_mask is not None:
        hole |= people.unposed_mask
    longest = max(run.image.shape[:2])
    hole = dilate(hole, max(4.0, run.plan.photo.mask_growth * longest))
    if not hole.any():
        return Inpainting(run.image, hole)
    return Inpainting(run.call("inpainting", InpainterRequest(run.image, hole)), hole)


def map_photo(run: PhotoRun, people: People, keypoints: Keypoints, inpainting: Inpainting) -> Maps:
    """Estimate the point maps of scene and photo; a measured depth gives both their shape."""
    from physic_core.engine.up import with_up_of_file

    hole = inpainting.hole
    camera = run.prepared.photo.intrinsics
    hints = Hints(camera, people, keypoints, hole, photo=run.image)
    scene = _pointmap(run, "scene point map", inpainting.image, hints)
    scene, doubt = with_up_of_file(scene, run.prepared.photo.up)
    run.stages.warn(*filter(None, (doubt,)))
    camera = camera or scene.intrinsics or _camera_of(scene)
    hints = replace(hints, intrinsics=camera, hole=None, photo=None, scene=scene)
    original = _pointmap(run, "photo point map", run.image, hints) if hole.any() else scene
    depth_comparison, references = _compared_points(run, original, camera) or (
        None,
        (original, scene),
    )
    maps = Maps(inpainting, scene, original, camera, None, hints, depth_comparison)
    if run.resolved("metric depth").backend.sees != "photo":
        return maps
    return _with_depth_of_photo(run, maps, references, people)


def _compared_points(
    run: PhotoRun, original: Pointmap, camera: Intrinsics
) -> tuple[Comparison, tuple[Pointmap, ...]] | None:
    """Compare a point map of a file with that of the network that it replaces, and return this map,
    too; None without a file, or without the network.

    Raises:
        InputError: the file does not show this photo.
    """
    if run.plan.config.choice("relative_pointmap") == run.plan.config.relative_pointmap:
        return None

    try:
        photo_points = run.call_replaced(
            "relative_pointmap", RelativePointmapRequest(run.image, Hints())
        )
    except PhysicError as error:
        run.stages.note(f"the given point map was not compared with the photo: {error}")
        return None
    z = np.where(original.valid, original.points[..., 2], np.nan)
    return _as_read("point map", z, (photo_points,), camera), (photo_points,)


def _as_read(
    name: str, depth: FloatArray, references: tuple[Pointmap, ...], camera: Intrinsics
) -> Comparison:
    """Compare the depth (H, W) of a file with point maps of a network.

    Raises:
        InputError: another reading of the file fits clearly better.
    """
    from physic_core.geometry.depth_comparison import SURELY, compare_depth

    comparison = compare_depth(depth, references, camera)
    if comparison.ratio <= SURELY:
        raise InputError(f"the given {name} does not fit this photo pixel by pixel: {comparison}")
    return comparison


def _with_depth_of_photo(
    run: PhotoRun, maps: Maps, references: tuple[Pointmap, ...], people: People
) -> Maps:
    """Return the maps in the shape of the depth by a backend that sees the photo, if it was
    measured.

    Args:
        run: of the photo.
        maps: without it.
        references: point maps of the photo by a network.
        people: in the photo.

    Raises:
        InputError: the depth does not show this photo.
    """
    from physic_core.engine.scene.measured_shape import in_usual_unit
    from physic_core.engine.sizes.evidence import is_measured
    from physic_core.prepare.depth import (
        mask_hole,
        photo_with_measured_depth,
        scene_with_measured_depth,
    )

    hole, scene, original = maps.inpainting.hole, maps.scene, maps.original
    whole = run.call("metric depth", MetricDepthRequest(run.image))
    maps = replace(maps, depth_comparison=_as_read("depth", whole.depth, references, maps.camera))
    visible_depth = mask_hole(whole, hole)
    if visible_depth is None or not is_measured(visible_depth):
        return replace(maps, metric_depth=visible_depth)
    scene, note = scene_with_measured_depth(scene, visible_depth, hole, maps.camera)
    run.stages.note(note)
    hints = replace(maps.hints, scene=scene)
    if hole.any():
        original = photo_with_measured_depth(
            original, scene, whole, visible_depth, people.masks, maps.camera
        )
    return replace(
        maps, scene=in_usual_unit(scene), original=original, metric_depth=visible_depth, hints=hints
    )


def _pointmap(run: PhotoRun, stage: str, image: UInt8Array, hints: Hints) -> Pointmap:
    """Estimate a relative point map of the inpainted or the original photo."""
    request = RelativePointmapRequest(image, hints)
    pointmap = run.call(stage, request, last=image is run.image)
    run.stages.note(*pointmap.notes)
    run.stages.warn(*pointmap.warnings)
    return pointmap


def _camera_of(pointmap: Pointmap) -> Intrinsics:
    from physic_core.engine.photo_content import PixelPoints
    from physic_core.geometry.pointmap import intrinsics_from_pointmap

    height, width = pointmap.valid.shape
    found = PixelPoints.of(pointmap)
    fx, fy, cx, cy = intrinsics_from_pointmap(found.points, found.valid)
    return Intrinsics(fx, fy, cx, cy, width, height, "point map")


def photo_content(
    people: FoundPeople,
    keypoints: Keypoints,
    observations: Observations,
    maps: Maps,
    settings: PlacementStageMethod,
) -> PhotoContent:
    """Return what the photo shows, with its point map aligned to the scene outside the hole."""
    from physic_core.engine.photo_content import PhotoContent
    from physic_core.geometry.tensors import tensor

    hole = tensor(maps.inpainting.hole)
    return PhotoContent(
        people=people.people,
        keypoints=keypoints,
        observations=observations,
        known=people.known,
        camera=maps.camera,
        hole=hole,
        scene_map=maps.scene,
        photo_map=maps.original,
        aligned_map=_align_to_scene(maps, hole, settings) if hole.any() else maps.scene,
    )


def _align_to_scene(maps: Maps, hole: Tensor, settings: PlacementStageMethod) -> Pointmap:
    from physic_core.engine.photo_content import PixelPoints
    from physic_core.engine.placement.solve import align_photo_points_to_scene
    from physic_core.geometry.alignment import apply_alignment

    photo, behind = map(PixelPoints.of, (maps.original, maps.scene))
    alignment = align_photo_points_to_scene(photo, hole, behind.points, behind.valid, settings)
    aligned = apply_alignment(photo.points, alignment).numpy()
    return replace(maps.original, points=aligned, unknown=maps.scene.unknown)


def find_floors(photo: PhotoContent, hints: Hints, *, searched: bool) -> Floors:
    """Find planes that may be the floor; none unless they are searched."""
    from physic_core.engine.ground.floor import describe_floor, index_of_best
    from physic_core.engine.ground.floor_and_scale import floor_evidence, scene_floor_candidates
    from physic_core.engine.up import surest_up

    evidence = floor_evidence(photo)
    floors = scene_floor_candidates(photo.scene_points, evidence, searched=searched)
    floor = describe_floor(floors, index_of_best(floors), evidence).plane
    up = surest_up(floor, evidence.up, photo.slope_sigma_deg)
    hints = replace(
        hints,
        floor=None if floor is None else floor.to_plane(),
        original=photo.aligned_map,
        observations=photo.observations,
        up=up.direction.numpy() if floor is not None or up.sigma < KNOWN_UP_SIGMA_DEG else None,
    )
    return Floors(evidence, floors, hints)


def find_scale(
    run: PhotoRun,
    photo: PhotoContent,
    bodies: Bodies,
    floors: Floors,
    backend_depth: DepthMap | None,
) -> Ground:
    """Find floor and scale by the people with bodies, and by a depth with a scale of its own."""
    from physic_core.engine.ground.floor_and_scale import find_ground, up_checked_in_photo
    from physic_core.engine.up import slope_warnings

    evidence = floors.evidence
    witness = backend_depth if run.plan.engine.scene.rescales_depth else None
    ground = find_ground(photo, bodies, run.model, floors.candidates, evidence, witness)
    plane = ground.search.plane
    run.stages.warn(
        *up_checked_in_photo(photo)[1],
        *slope_warnings(plane, evidence.up, evidence.slope_sigma_deg),
    )
    return ground


def metric_backend_depth(run: PhotoRun, maps: Maps, hints: Hints) -> DepthMap | None:
    """Return metric depth with a scale of its own: that of the photo, or by a backend that does not
    read the scale of the hints; None without one, and if it needs people and gets none.
    """
    if maps.metric_depth is not None or "scale" in _reads_of_depth(run):
        return maps.metric_depth
    with suppress(NoPersonError):
        return run.call("metric depth", MetricDepthRequest(maps.inpainting.image, hints))
    return None


def depth_at_scale(
    run: PhotoRun, ground: Ground, backend_depth: DepthMap | None, maps: Maps, hints: Hints
) -> DepthMap:
    """Return metric depth of the inpainted photo: its own, or at the scale that was found.

    If the backend needs people and gets none, it is the depth of the scene.
    """
    from physic_core.engine.sizes.scale_vote import scaled_depth

    depth = ground.depth or backend_depth
    if depth is None and "scale" in _reads_of_depth(run):
        hints = replace(hints, floor=ground.plane, scale=ground.scale)
        with suppress(NoPersonError):
            depth = run.call("metric depth", MetricDepthRequest(maps.inpainting.image, hints))
    if depth is None:
        depth = scaled_depth(maps.scene, ground.scale, maps.camera)
    run.stages.note(*depth.notes)
    return depth


def _reads_of_depth(run: PhotoRun) -> tuple[str, ...]:
    """Return the hints that the backend of metric depth reads."""
    return run.resolved("metric depth").backend.reads or ()
