"""Run the backends on one photo, in the order of the paper.

Bodies come before metric depth, so that a classical depth backend can estimate its scale from the
size of people. OpenCV camera frame.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from physic_core.pipeline.find_people import (
    add_hands,
    estimate_bodies,
    estimate_contact,
    find_keypoints,
    find_people,
    hints_with_bodies,
    observe_people,
    resize_bodies,
    use_given_bodies,
)
from physic_core.pipeline.find_scene import (
    depth_at_scale,
    find_floors,
    find_scale,
    inpaint_people,
    map_photo,
    metric_backend_depth,
    photo_content,
)
from physic_core.types.arrays import select_people

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physic_core.engine.ground.floor_and_scale import Ground
    from physic_core.engine.photo_content import PhotoContent
    from physic_core.engine.state import Estimates
    from physic_core.pipeline.find_scene import Floors, Maps
    from physic_core.pipeline.photo_run import PhotoRun
    from physic_core.types import Bodies, BoolArray, DepthMap, Hints


def run_backends(run: PhotoRun) -> Estimates:
    """Run all backends on a photo.

    Raises:
        InputError: the number of known statures differs from that of the people, given keypoints
            are of no person or joint, or a given depth or point map does not show this photo.
        NoPersonError: a prompt selects no person, or people are required and the segmenter found
            none.
        BackendError: a required backend failed.
        BackendOutputError: a required backend returned an invalid result.
    """
    from physic_core.engine.state import Estimates

    plan = run.plan
    segmented = find_people(run)
    joints = find_keypoints(run, segmented.people)
    inpainting = inpaint_people(run, segmented.people)
    maps = map_photo(run, segmented.people, joints.keypoints, inpainting)
    observations, joints = observe_people(run, segmented.people, joints, maps.camera)
    with run.stages.time_engine("floor candidates"):
        photo = photo_content(
            segmented, joints.keypoints, observations, maps, plan.engine.placement
        )
        floors = find_floors(photo, maps.hints, searched=plan.engine.scene.floor != "off")
    bodies, no_body = estimate_bodies(run, photo, floors.hints)
    bodies, no_hands = add_hands(run, photo, bodies)
    bodies = resize_bodies(run, photo, bodies)
    bodies, no_body, matched_bodies = use_given_bodies(run, photo, segmented.body, bodies, no_body)
    has_body = ~no_body
    people = select_people(photo, has_body)
    posed = select_people(bodies, has_body)
    hints = hints_with_bodies(run, people, posed, floors.hints)
    contact, no_contact = estimate_contact(run, hints, has_body)
    ground, depth = _ground_and_depth(run, people, posed, floors, maps, hints)
    missing = {
        "segmenter": segmented.missing,
        "keypoint_detector": joints.missing,
        "body_estimator": no_body,
        "hand_estimator": no_hands,
        "contact_prior": no_contact,
    }
    return Estimates(
        image=run.image,
        camera_by_user_or_file=run.prepared.photo.intrinsics is not None,
        photo=photo,
        inpainted=inpainting.image,
        ground=ground.expanded(has_body),
        bodies=bodies,
        contact=contact,
        depth=depth,
        depth_backend=plan.backends["metric_depth"].title,
        missing_results=_missing_results(missing, len(no_body)),
        known=run.prepared.known,
        is_given_keypoint=joints.is_changed,
        contradicted_px=joints.contradicted_px,
        file_px_per_px=joints.file_px_per_px,
        given_bodies=matched_bodies,
        depth_comparison=maps.depth_comparison,
    )


def _ground_and_depth(
    run: PhotoRun, photo: PhotoContent, bodies: Bodies, floors: Floors, maps: Maps, hints: Hints
) -> tuple[Ground, DepthMap]:
    """Return floor and scale by the people with a body, and the depth at that scale."""
    own = metric_backend_depth(run, maps, hints)
    with run.stages.time_engine("floor and scale"):
        ground = find_scale(run, photo, bodies, floors, own)
    depth = depth_at_scale(run, ground, own, maps, hints)
    return _without_replaced_statements(ground, own, depth), depth


def _missing_results(
    missing: Mapping[str, BoolArray | None], count: int
) -> tuple[tuple[str, ...], ...]:
    """Return the interfaces without a result for each of N people."""
    return tuple(
        tuple(name for name, who in missing.items() if who is not None and who[i])
        for i in range(count)
    )


def _without_replaced_statements(
    ground: Ground, photo_depth: DepthMap | None, depth: DepthMap
) -> Ground:
    """Return the ground without the statements that a metric depth of its own scale replaces."""
    if photo_depth is not None:  # the metres of a depth that did not vote stay
        ground = replace(
            ground, is_scaled_by_people=ground.is_scaled_by_people and ground.depth is not None
        )
    if depth.scale_sigma is not None or photo_depth is not None:
        ground = replace(ground, guess_warning="")
    return ground
