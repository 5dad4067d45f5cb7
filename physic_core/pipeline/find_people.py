"""Find the people in a photo: masks, keypoints, what they do, and their bodies.

Each function calls one backend. People for whom it gives no valid values are returned as a mask.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError, NoPersonError
from physic_core.interfaces import (
    BodyEstimatorRequest,
    ContactPriorRequest,
    HandEstimatorRequest,
    KeypointDetectorRequest,
    PersonObserverRequest,
    SegmenterRequest,
)
from physic_core.interfaces.bodies import valid_body_rows
from physic_core.pipeline.backend_results import (
    convert_to_configured,
    discard_invalid_bodies,
    discard_invalid_hands,
    discard_invalid_keypoints,
    expand_contact,
    implausible_contact,
    is_real_person,
    replace_hands,
    transfer_contact,
    without_implausible_wrists,
)
from physic_core.prepare.people import (
    expand_known,
    is_ignored_person,
    known_people,
    order_left_to_right,
    select_chosen,
    with_given_masks,
    with_people_of_masks,
    without_bodies,
)
from physic_core.types import (
    FOUND_TWICE,
    NOT_CHOSEN,
    Bodies,
    ContactProbability,
    Keypoints,
    Observations,
    People,
)
from physic_core.types.arrays import PER_PERSON, select_people
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SURE_CONFIDENCE

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.engine.photo_content import PhotoContent
    from physic_core.engine.state import MatchedBodies
    from physic_core.pipeline.photo_run import PhotoRun
    from physic_core.types import BoolArray, FloatArray, Hints, IntArray, Intrinsics, PeoplePrompt
    from physic_core.types.known_sizes import KnownPeople

_POINT_AT_PEOPLE = "if the photo shows people, mark each with --person x,y or --box x0,y0,x1,y1"


_INSIDE = 0.8  # share of a person's keypoints in a mask of them


@dataclass(frozen=True)
class SegmentedPeople(ShortRepr):
    """N people in a photo.

    Attributes:
        people: masks, boxes and scores.
        missing: (N,) bool, people with invalid keypoints by the segmenter; None if it gives none.
    """

    people: People = field(metadata=PER_PERSON)
    missing: BoolArray | None = field(metadata=PER_PERSON)


@dataclass(frozen=True)
class FoundPeople(SegmentedPeople):
    """The N people to reconstruct.

    Attributes:
        known: what the user knows of them.
        body: (N,) the body of each that the user gives, -1 for none.
    """

    known: KnownPeople = field(metadata=PER_PERSON)
    body: IntArray = field(metadata=PER_PERSON)


@dataclass(frozen=True)
class FoundKeypoints(ShortRepr):
    """Keypoints of N people.

    Attributes:
        keypoints: by the detector, with those that the user gave.
        missing: (N,) bool, people with invalid ones by the detector; None if it was not called.
        is_changed: (N, J) keypoints that the user changed, or None.
        contradicted_px: (N, J) how far mask and detector contradict them, px, or None.
        file_px_per_px: as of :class:`physic_core.engine.state.Estimates`.
    """

    keypoints: Keypoints
    missing: BoolArray | None = None
    is_changed: BoolArray | None = None
    contradicted_px: FloatArray | None = None
    file_px_per_px: float = 1.0


def find_people(run: PhotoRun) -> FoundPeople:
    """Find the people, all from left to right or those whom the user chose in that order, and what
    the user knows of them.
    """
    prompt = run.prepared.people
    ignored = None
    if prompt is not None and prompt.ignored:
        ignored = prompt
        prompt = None
    segmented = _segment_with_masks(run, prompt, required=run.plan.photo.require_people)
    if run.prepared.masks is not None:
        _check_masks(segmented.people.masks, run.prepared.masks)
        people, count = with_given_masks(segmented.people, run.prepared.masks)
        run.stages.note(f"given masks of {count} of {len(people)} people")
        segmented = replace(segmented, people=people)
    if ignored is not None:
        segmented = _without_ignored(segmented, ignored)
    real = is_real_person(segmented.people, prompt)
    every = segmented.people
    same = f"{FOUND_TWICE}: if these are two people, give --person x,y for each"
    segmented = _keep_people(segmented, real, same)
    if run.plan.photo.require_people and not len(segmented.people):
        raise NoPersonError("a person is required, but all people of the photo were left out")
    sizes = run.prepared.known
    if prompt is None:
        segmented, body = _with_given_bodies(run, segmented)
        order = order_left_to_right(segmented.people)
        segmented = select_people(segmented, order)
        known = known_people(sizes, len(segmented.people))
        return FoundPeople(segmented.people, segmented.missing, known, body[order])
    known = select_people(known_people(sizes, len(every)), real)
    if not real.all():
        # The others have their pixels back only in a segmentation without the false persons.
        chosen_people = _segment(run, prompt.select(real), required=True)
        segmented = replace(
            chosen_people, people=replace(chosen_people.people, unposed=segmented.people.unposed)
        )
    chosen, body = _with_given_bodies(run, segmented)
    added = np.arange(len(chosen.people)) < len(segmented.people)
    return FoundPeople(chosen.people, chosen.missing, expand_known(known, added), body)


def _with_given_bodies(
    run: PhotoRun, segmented: SegmentedPeople
) -> tuple[SegmentedPeople, IntArray]:
    """Return the people with those whom only the given bodies show, and the body (N,) of each, -1
    for none; without other people if the given bodies are final.
    """
    given_bodies = run.bodies
    rows = np.full(len(segmented.people), -1)
    if given_bodies is None or not given_bodies.is_placed:
        return segmented, rows
    from physic_core.prepare.bodies import match_to_people

    camera = run.prepared.photo.intrinsics
    rows, outlines = match_to_people(given_bodies, run.model, camera, segmented.people)
    if run.plan.photo.bodies_final and (rows < 0).any():
        segmented = _move_to_unposed(segmented, rows < 0, "no given body is there")
        rows = rows[rows >= 0]
    others = np.setdiff1d(np.arange(len(given_bodies)), rows)
    free = outlines[others] & ~segmented.people.masks.any(0)
    is_free = free.any((1, 2))
    if not is_free.all():
        run.stages.note(
            f"left out {(~is_free).sum()} of {len(given_bodies)} given bodies: the photo "
            f"shows nothing of them"
        )
    if not is_free.any():
        return segmented, rows
    run.stages.note(f"added {is_free.sum()} people whom only the given bodies show")
    people = with_people_of_masks(segmented.people, free[is_free])
    return SegmentedPeople(people, None), np.concatenate([rows, others[is_free]])


def _segment_with_masks(
    run: PhotoRun, prompt: PeoplePrompt | None, *, required: bool
) -> SegmentedPeople:
    """Segment people as :func:`_segment`; unless keypoints lie in the masks of the prompt, compare
    these with the people who are found without them.

    Raises:
        InputError: the masks are inverted, or those of a turned picture.
        NoPersonError: they are of no person.
    """
    masks = None if prompt is None else prompt.masks
    try:
        segmented = _segment(run, prompt, required=required)
    except NoPersonError:
        if masks is not None:
            _check_masks(masks, _segment(run, None, required=False).people.masks)
        raise
    if masks is not None and _share_of_keypoints_inside(segmented.people) < _INSIDE:
        _check_masks(masks, _segment(run, None, required=False).people.masks)
    return segmented


def _check_masks(given_masks: BoolArray, detected_masks: BoolArray) -> None:
    """Raise InputError if masks (M, H, W) fit others clearly better turned or inverted."""
    from physic_core.geometry.depth_comparison import turned_masks

    if turned := turned_masks(given_masks, detected_masks):
        raise InputError(f"the given masks are of a picture that is {turned}")


def _share_of_keypoints_inside(people: People) -> float:
    """Return the share of the certain keypoints of people that lie in their masks; 0 without
    any.
    """
    keypoints = people.keypoints
    if keypoints is None:
        return 0.0
    height, width = people.masks.shape[1:]
    inside = [
        mask[np.rint(y).astype(int).clip(0, height - 1), np.rint(x).astype(int).clip(0, width - 1)]
        for mask, points, sure in zip(
            people.masks, keypoints.points, keypoints.confidence, strict=True
        )
        for x, y in [points[sure >= SURE_CONFIDENCE].T]
    ]
    return float(np.concatenate(inside).mean()) if any(map(len, inside)) else 0.0


def _segment(run: PhotoRun, prompt: PeoplePrompt | None, *, required: bool) -> SegmentedPeople:
    """Segment the people in the photo, or those whom the user chose."""
    segmenter = run.resolved("people")
    takes_prompt = getattr(segmenter.backend, "takes_prompt", False)
    request = SegmenterRequest(run.image, prompt=prompt if takes_prompt else None)
    people = run.call("people", request)
    run.stages.note(*people.notes)
    if prompt is not None and not takes_prompt:
        people = select_chosen(people, prompt)
    missing = None
    if people.keypoints is not None:
        valid_keypoints, missing = discard_invalid_keypoints(people.keypoints)
        people = replace(people, keypoints=valid_keypoints)
    if not len(people):
        cure = (
            _POINT_AT_PEOPLE
            if takes_prompt
            else "if the photo shows a person, use another segmenter"
        )
        if required and run.prepared.bodies is None:
            height, width = run.image.shape[:2]
            raise NoPersonError(
                f"no person was found in the photo of {width} x {height} px by {segmenter.title}: "
                f"{cure}; without require_people, the result is the scene alone"
            )
        run.stages.note(
            f"no person was found: the result is only the scene, and all its lengths may be wrong; "
            f"{cure}"
        )
    return SegmentedPeople(people, missing)


def _without_ignored(segmented: SegmentedPeople, ignored: PeoplePrompt) -> SegmentedPeople:
    """Return the people whom the user does not ignore; others' pixels show no scene."""
    return _move_to_unposed(segmented, is_ignored_person(segmented.people, ignored), NOT_CHOSEN)


def _move_to_unposed(segmented: SegmentedPeople, is_out: BoolArray, reason: str) -> SegmentedPeople:
    """Return the people who are not left out (N,); others' pixels show no scene."""
    people = segmented.people
    masks: BoolArray = np.logical_or.reduce(people.masks[is_out])
    if people.unposed_mask is not None:
        masks |= people.unposed_mask
    kept = _keep_people(segmented, ~is_out, reason)
    return replace(kept, people=replace(kept.people, unposed_mask=masks))


def _keep_people(segmented: SegmentedPeople, rows: BoolArray, reason: str) -> SegmentedPeople:
    """Return some (N,) bool of the people; the others have no body, for this reason."""
    kept = select_people(segmented, rows)
    unposed = kept.people.unposed + without_bodies(segmented.people, ~rows, reason)
    return replace(kept, people=replace(kept.people, unposed=unposed))


def find_keypoints(run: PhotoRun, people: People) -> FoundKeypoints:
    """Detect keypoints, and take those that the user gave."""
    no_keypoints = FoundKeypoints(
        Keypoints(np.zeros((0, 17, 2), np.float32), np.zeros((0, 17), np.float32), "coco17")
    )
    if run.wants("keypoints", people):
        detected = run.call("keypoints", KeypointDetectorRequest(run.image, people))
        no_keypoints = FoundKeypoints(*discard_invalid_keypoints(detected))
    given_keypoints = run.prepared.keypoints
    if given_keypoints is None:
        return no_keypoints
    from physic_core.prepare.keypoints import contradicted_keypoints, corrected_keypoints

    keypoints, changed, notes = corrected_keypoints(no_keypoints.keypoints, given_keypoints, people)
    run.stages.note(*notes)
    contradicted = contradicted_keypoints(no_keypoints.keypoints, keypoints, changed, people)
    return FoundKeypoints(
        keypoints, no_keypoints.missing, changed, contradicted, given_keypoints.file_px_per_px
    )


def observe_people(
    run: PhotoRun, people: People, joints: FoundKeypoints, camera: Intrinsics
) -> tuple[Observations, FoundKeypoints]:
    """Tell what people do; unknown without a backend, and if it fails. Also return the keypoints,
    turned round for people whose back is taken for a front; not where the user gave some.
    """
    from physic_core.engine.ground.posture import seems_reversed, weigh_posture

    keypoints = joints.keypoints
    observed = None
    if run.wants("observations", people):
        observed = run.call_optional(
            "observations",
            PersonObserverRequest(run.image, people, keypoints, camera),
            otherwise="what people do is estimated from their joints alone",
        )
    if observed is None:
        return Observations.unknown(len(people)), joints
    turned = seems_reversed(observed, keypoints)
    if joints.is_changed is not None:
        turned &= ~joints.is_changed.any(1)
    keypoints = keypoints.mirrored_in_depth(turned)
    weighed = weigh_posture(observed.with_swapped_sides(turned), keypoints)
    return weighed, replace(joints, keypoints=keypoints)


def estimate_bodies(run: PhotoRun, photo: PhotoContent, hints: Hints) -> tuple[Bodies, BoolArray]:
    """Estimate bodies of the configured body model; NaN for people (N,) without finite results."""
    people = photo.people
    if not run.wants("bodies", people):
        return _no_bodies(run.model), np.zeros(0, bool)
    request = BodyEstimatorRequest(run.image, people, photo.camera, photo.keypoints, hints)
    bodies, missing = discard_invalid_bodies(run.call("bodies", request))
    if bodies.body_model != run.model.name:
        bodies = convert_to_configured(bodies, run.model, run.resolved("bodies").title, run.stages)
        missing |= ~valid_body_rows(bodies)
    return bodies, missing


def _no_bodies(model: BodyModel) -> Bodies:
    """Return zero bodies of a body model."""
    from physic_core.body.bones import parameters_from_rotations

    rotations, betas, transl = model.zero_pose(0)
    expression = betas.new_zeros(0, model.num_expression)
    return Bodies(parameters_from_rotations(rotations, betas, expression, transl), model.name)


def add_hands(
    run: PhotoRun, photo: PhotoContent, bodies: Bodies
) -> tuple[Bodies, BoolArray | None]:
    """Give bodies estimated finger rotations; also return the people (N,) without valid ones, or
    None without a backend.
    """
    people = photo.people
    if not run.wants("hands", people):
        return bodies, None
    hands = run.call_optional(
        "hands",
        HandEstimatorRequest(run.image, people, photo.keypoints),
        otherwise="fingers keep the pose from the body_estimator",
    )
    if hands is None:
        return bodies, np.ones(len(people), bool)
    hands, missing = discard_invalid_hands(hands)
    hands = without_implausible_wrists(hands, bodies, run.resolved("hands"), run.stages)
    return replace_hands(bodies, hands, run.model), missing


def resize_bodies(run: PhotoRun, photo: PhotoContent, bodies: Bodies) -> Bodies:
    """Give bodies the statures that the user knows, and children the size of children."""
    from physic_core.engine.sizes.stature import bodies_of_stature, resize_children

    model = run.model
    if photo.known.stature is not None:
        bodies = bodies_of_stature(bodies, model, photo.known.stature)
    bodies, notes = resize_children(bodies, model, photo.known, photo.observations.child)
    run.stages.note(*notes)
    return bodies


def use_given_bodies(
    run: PhotoRun, photo: PhotoContent, rows: IntArray, bodies: Bodies, no_body: BoolArray
) -> tuple[Bodies, BoolArray, MatchedBodies | None]:
    """Return bodies with those that the user gives in place of estimated ones, the people (N,)
    without a body, and whose the given ones are; None without any.

    Args:
        run: of the photo.
        photo: of N people.
        rows: (N,) the given body of each, -1 for none.
        bodies: estimated.
        no_body: (N,) bool, people without one.
    """
    given_bodies = run.bodies
    if given_bodies is None or not len(photo.people):
        return bodies, no_body, None
    from physic_core.prepare.bodies import place_by_keypoints, with_given_bodies

    if not given_bodies.is_placed:
        given_bodies, rows = place_by_keypoints(given_bodies, run.model, photo), np.zeros(1, int)
    bodies, matched, warnings = with_given_bodies(given_bodies, rows, photo, bodies, run.model)
    run.stages.warn(*warnings)
    run.stages.note(
        f"bodies of {matched.has_given_body.sum()} of {len(rows)} people: {given_bodies.source}"
    )
    if photo.known.stature is not None:
        from physic_core.engine.sizes.stature import bodies_of_stature

        bodies = bodies_of_stature(bodies, run.model, photo.known.stature)
    return bodies, no_body & ~matched.has_given_body, matched


def hints_with_bodies(run: PhotoRun, photo: PhotoContent, bodies: Bodies, hints: Hints) -> Hints:
    """Return hints about the people with bodies alone, who are the people of the photo here.

    Bodies of a model that not all backends can load have joints, too.
    """
    if run.model.name != "embedded":
        from physic_core.body.bones import replace_mesh_with_joints

        bodies = replace_mesh_with_joints(bodies, run.model)
    return replace(
        hints,
        people=photo.people,
        keypoints=photo.keypoints,
        observations=photo.observations,
        hole=photo.hole.numpy(),
        bodies=bodies,
    )


def estimate_contact(
    run: PhotoRun, hints: Hints, has_body: BoolArray
) -> tuple[ContactProbability, BoolArray | None]:
    """Estimate prior contact of N people, 0 without a body; also return the people (N,) without
    valid values, or None without a backend.

    Args:
        run: of the photo.
        hints: about the people with bodies.
        has_body: (N,) bool, these people.
    """
    model = run.model
    people, bodies = hints.people, hints.bodies
    assert people is not None
    assert bodies is not None
    shape = len(has_body), model.num_vertices
    nothing = ContactProbability(np.zeros(shape, np.float32), model.topology)
    if not run.wants("contact prior", has_body):
        return nothing, None
    prior = run.resolved("contact prior").title
    request = ContactPriorRequest(
        run.image, people, bodies, topology=model.topology, vertices=model.num_vertices
    )
    contact = run.call_optional(
        "contact prior", request, otherwise="contact is computed from distances only"
    )
    if contact is not None and contact.topology != model.topology:
        contact = transfer_contact(contact, model, prior, run.stages)
    if contact is None:
        return nothing, np.ones(len(has_body), bool)
    if doubt := implausible_contact(contact, bodies):
        run.stages.warn(f"{prior}: {doubt}")
    return expand_contact(contact, has_body)
