"""Convert the final state of a photo to its result; judge it by checks; describe the weights and
repositories of the run.
"""

from __future__ import annotations

import math
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from physic_core.body.bones import parameters_from_rotations
from physic_core.body.joints import NUM_JOINTS
from physic_core.body.posture import photo_seems_turned
from physic_core.engine.contact.partner import DECIMALS
from physic_core.engine.ground.report import scale_note
from physic_core.engine.limbs import limb_part_indices, observed_parts
from physic_core.engine.measures import body_size_sigmas
from physic_core.engine.scene.solve import alignment_diagnostics
from physic_core.geometry.tensors import arrays
from physic_core.interfaces import Repository
from physic_core.judge import (
    failed_checks,
    no_trust,
    person_trust,
    unknown_checks,
)
from physic_core.prepare.frame import smooth_background
from physic_core.types import (
    POSTURES,
    Intrinsics,
    Person,
    Reconstruction,
    Scene,
)
from physic_core.types.contacts import NO_PARTNER, has_sole_on_floor
from physic_core.types.known_sizes import size_option
from physic_core.types.observations import LEAST_PROBABILITY

_UP_COSINE = math.cos(
    math.radians(45.0)
)  # least one to up in the picture of a level floor's normal

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.engine.state import Contact, Estimates, MatchedBodies, State
    from physic_core.geometry.floor import FloorSearch
    from physic_core.types import BoolArray, CheckResult, FloatArray, Measures, Observations


def as_reconstruction(
    estimates: Estimates, state: State, measures: Sequence[Measures] = ()
) -> Reconstruction:
    """Convert the final state of a photo to its result, without checks and records of the run.

    Args:
        estimates: of the photo.
        state: after the last stage; after the first one for a photo without people.
        measures: of each person.
    """
    contact = state.contact
    return Reconstruction(
        image=estimates.image,
        intrinsics=_intrinsics(estimates, state),
        scene=_scene_of_result(estimates, state),
        people=() if contact is None else _people(estimates, state, contact, measures),
        faces=state.model.faces.int().numpy(),
        body_model=state.model.name,
        skeleton=estimates.photo.keypoints.skeleton,
        diagnostics=_diagnostics(estimates, state),
        unposed=tuple(estimates.photo.people.unposed),
        contact_partners=() if contact is None else contact.partners,
    )


def _people(
    estimates: Estimates, state: State, contact: Contact, measures: Sequence[Measures]
) -> tuple[Person, ...]:
    photo = estimates.photo
    detected = photo.people
    _, years = photo.known.filled(len(detected))
    parameters = parameters_from_rotations(
        state.rotations, state.betas, state.expression, state.transl
    )
    rows = _arrays_of_people(state, contact)
    sizes = zip(state.model.stature(state.betas), body_size_sigmas(estimates, state), strict=True)
    hidden_limbs = _hidden_limbs(state)
    touch = estimates.ground.stance.limb_touch_probability
    sigmas = estimates.bodies.joint_sigma
    people = []
    for i, (stature, sigma) in enumerate(sizes):
        has_body = bool(torch.isfinite(stature))
        people.append(
            Person(
                box=detected.boxes[i],
                score=float(detected.scores[i]),
                mask=detected.masks[i],
                keypoints=photo.keypoints.points[i],
                keypoint_confidence=photo.keypoints.confidence[i],
                parameters=parameters[i : i + 1],
                contacts=contact.contacts[i],
                support=contact.supports[i],
                world_contact=_world_contact(contact, i),
                unseen=hidden_limbs[i] if has_body else (),
                joint_sigma=sigmas[i] if has_body and sigmas is not None else None,
                age=float(years[i]) if math.isfinite(years[i]) else None,
                stature=float(stature) if has_body else None,
                stature_sigma=sigma if has_body else None,
                sizes=_body_sizes(state, i) if has_body else {},
                measures=measures[i],
                **_observed_fields(photo.observations, touch[i], i),
                **_given_fields(estimates.given_bodies, i),
                **{name: array[i] for name, array in rows.items()},
            )
        )
    return tuple(people)


def _given_fields(matched: MatchedBodies | None, person: int) -> dict[str, Any]:
    """Return what the user gives as the body of a person, as fields of a Person."""
    if matched is None or not matched.has_given_body[person]:
        return {}
    return {"body_source": matched.source, "given_joints": matched.joints[person]}


def _arrays_of_people(state: State, contact: Contact) -> dict[str, Any]:
    """Return the arrays with a row for each person, as fields of a Person."""
    rows = arrays(
        vertices=state.vertices,
        joints=state.joints,
        contact=contact.partner != NO_PARTNER,
        distance=contact.distance,
        contact_partner=contact.partner,
    )
    if contact.probability is not None:
        rows["contact_probability"] = contact.probability.numpy().astype(np.float16)
    return rows


def _body_sizes(state: State, person: int) -> dict[str, float]:
    """Return the heights of a person over the floor; none without a floor."""
    floor = state.scene.floor
    if floor is None:
        return {}
    sizes = {}
    pelvis = state.joints[person, :1]
    seat = state.vertices[person, state.model.contact_sets["gluteus"]]
    for name, points in (("pelvis_height_m", pelvis), ("seat_height_m", seat)):
        heights = floor.scaled(state.unapplied_scene_scale).height(points.double())
        sizes[name] = round(float(heights.min()), 4)
    return sizes


def _observed_fields(observations: Observations, touch: FloatArray, person: int) -> dict[str, Any]:
    """Return what the person observer says of a person, as fields of a Person.

    A plank has no name among the postures, and looks like lying: a person on feet and hands, whose
    probabilities to touch are the first four of ``touch`` (5,), and not on the buttocks, does not
    lie.
    """
    posture = observations.posture[person]
    best = int(posture.argmax())  # 0 in a row of NaN
    values = {"posture_probability": posture[best], "child_probability": observations.child[person]}
    supports_itself = touch[:2].max() * touch[2:4].max() * (1 - touch[4])
    if POSTURES[best] == "lie" and supports_itself >= LEAST_PROBABILITY:
        del values["posture_probability"]
    known = {name: round(float(p), DECIMALS) for name, p in values.items() if math.isfinite(p)}
    return known | ({"posture": POSTURES[best]} if "posture_probability" in known else {})


def _hidden_limbs(state: State) -> list[tuple[str, ...]]:
    """Return the limbs of each person at whose end no photo has a confident keypoint."""
    names = state.model.part_names
    seen = observed_parts(names, state.observed_in_any_photo).tolist()
    limbs = limb_part_indices(names)
    return [tuple(names[i] for i in limbs if not shown[i]) for shown in seen]


def _world_contact(contact: Contact, person: int) -> Mapping[str, float] | None:
    """Return body part -> probability of contact with the world; None without any."""
    if contact.supports[person] is None:
        return None
    found = {
        name: round(float(p[person]), DECIMALS) for name, p in contact.part_probability.items()
    }
    return found or None


def _diagnostics(estimates: Estimates, state: State) -> dict[str, Any]:
    """Return numbers by stage; those of the scene alone without people."""
    scene = {"scene": dict(state.scene.diagnostics), "witnesses": dict(estimates.ground.witnesses)}
    joint = state.joint
    if state.photo_alignment is None or joint is None:
        return scene
    losses = {name: {"start": a, "end": b} for name, (a, b) in joint.losses.items()}
    return scene | {
        "placement": {"alignment": alignment_diagnostics(state.photo_alignment)},
        "joint": {
            "losses": losses,
            "scene_scale": joint.scene_scale,
            "steps": joint.steps,
            "evaluations": joint.evaluations,
        },
    }


def _intrinsics(estimates: Estimates, state: State) -> Intrinsics:
    K = state.scene.K
    height, width = estimates.photo.hole.shape
    fx, fy, cx, cy = (float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    found = Intrinsics(fx, fy, cx, cy, width, height, "point map and metric depth")
    for camera in (estimates.photo.camera, estimates.depth.intrinsics):
        if camera and (fx, fy, cx, cy) == (camera.fx, camera.fy, camera.cx, camera.cy):
            return replace(
                found,
                source=camera.source,
                trust=camera.trust,
                focal_sigma=camera.focal_sigma,
            )
    return found


def _scene_of_result(estimates: Estimates, state: State) -> Scene:
    """Convert the scene, multiplied by the scale of stage 3."""
    scene = state.scene
    scale = state.unapplied_scene_scale
    floor = None if scene.floor is None else scene.floor.scaled(scale).to_plane()
    valid = scene.valid
    if (plain := _smooth_background(estimates)) is not None:
        valid = valid & ~torch.from_numpy(plain)
    maps = arrays(
        points=scene.points * scale,
        normals=scene.normals,
        valid=valid,
        floor_points=scene.floor_points * scale,
    )
    return Scene(
        colors=estimates.inpainted,
        floor=floor,
        scale=scale,
        scale_sigma=state.scale_sigma,
        measured=estimates.ground.measured is not None,
        up=scene.up.direction.numpy(),
        up_sigma=scene.up.sigma,
        up_source=scene.up.source,
        **maps,
    )


def _smooth_background(estimates: Estimates) -> BoolArray | None:
    """Return where the scene (H, W) is a ground of one colour, which shows no network its shape;
    None without one, or with a measured depth.
    """
    return None if estimates.ground.measured is not None else smooth_background(estimates.inpainted)


def with_checks_and_trust(result: Reconstruction, checks: Sequence[CheckResult]) -> Reconstruction:
    """Return a result with its checks, and the trust in each person."""
    trust = [
        (no_trust if person.stature is None else person_trust)(checks, i)
        for i, person in enumerate(result.people)
    ]
    people = tuple(
        replace(
            person,
            failed_checks=failed_checks(checks, i),
            unknown_checks=unknown_checks(checks, i),
            **trust[i].as_fields(),
        )
        for i, person in enumerate(result.people)
    )
    return replace(result, people=people, checks=tuple(checks))


def describe_methods(estimates: Estimates, result: Reconstruction) -> list[str]:
    """Return notes about people without a body, people who lie, people who give the scale, a plain
    ground, and a photo that seems turned.
    """
    people = result.people
    notes = []
    reasons = Counter(one.kind for one in result.unposed if one.is_another_person)
    if reasons:
        counts = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common())
        cure = "; --box x0,y0,x1,y1 for each person may give them one"
        is_missing = any(one.is_missing for one in result.unposed)
        notes.append(f"detected people without a body: {counts}{cure if is_missing else ''}")
    plane = estimates.ground.search.plane
    lie = plane is not None and plane.beneath
    if lie:
        notes.append(
            "people probably lie, and the camera looks down on them: the floor is what they lie "
            "on, and heights are over it"
        )
    if estimates.ground.is_scaled_by_people and not estimates.known:
        bodies = sum(person.support is not None for person in people)
        contacts = [person.contacts for person in people]
        floor, sigma = result.scene.floor, result.scene.scale_sigma
        notes.append(scale_note(contacts, bodies, floor, lie, sigma))
    if (plain := _smooth_background(estimates)) is not None:
        share = (plain & ~np.asarray(estimates.photo.hole)).mean()
        notes.append(
            f"{share:.0%} of the photo is ground of one color, whose depth is unknown: do not "
            "measure there, or give --depth FILE. If it is a border or a bar, cut it off"
        )
    poses = [person.trust_pose or 0.0 for person in people]
    # networks invent people in a turned photo, and let the others lie on nothing
    likely = [one for one, pose in zip(people, poses, strict=True) if pose >= max(poses) / 2]
    joints = np.reshape([person.joints for person in likely], (-1, NUM_JOINTS, 3))
    floating = result.scene.floor is None and all(one.posture == "lie" for one in likely)
    turned = photo_seems_turned(joints, result.scene.floor) or (bool(likely) and floating)
    if turned and not _shows_level_floor(estimates.ground.search):
        notes.append(
            "the people do not stand upright in the photo. If it is rotated, poses, floor and "
            "sizes are wrong: rotate it back, and run it again"
        )
    return notes


def _shows_level_floor(search: FloorSearch) -> bool:
    """Return whether the floor lies where the photo looks like floor, and its normal points up in
    the picture: people may lie in it, but it is not turned.
    """
    plane = search.plane
    return plane is not None and bool(search.in_mask) and -float(plane.normal[1]) > _UP_COSINE


def small_stature_warnings(estimates: Estimates, result: Reconstruction) -> list[str]:
    """Return a warning about each person who stands on the floor of others and is too small."""
    on_floor = [has_sole_on_floor(person.contacts) for person in result.people]
    return [
        f"person {i} would be {stature:.1f} m tall on the floor of the others. For a child, give "
        f"{size_option('--age YEARS', len(on_floor))}; of an adult, do not use size and distance"
        for i, stature in estimates.ground.small_statures.items()
        if on_floor[i] and sum(on_floor) > 1
    ]


# Thorax against pelvis: flexion and extension of the whole spine below the neck.
_MOST_BENT_DEG = (-60.0, 90.0)


def bent_trunk_warnings(result: Reconstruction) -> list[str]:
    """Return a warning about each person whose trunk bends more than a spine does."""
    bent = (person.joint_angles["trunk_flexion"] for person in result.people)
    return [
        f"person {i}: the trunk is bent by {angle:.0f}° (possible: {_MOST_BENT_DEG[0]:.0f}° to "
        f"{_MOST_BENT_DEG[1]:.0f}°). Do not use the pose and angles of trunk and hips, or replace "
        "the body with --bodies FILE"
        for i, angle in enumerate(bent)
        if not math.isnan(angle) and not _MOST_BENT_DEG[0] <= angle <= _MOST_BENT_DEG[1]
    ]


def describe_repositories(plan: ResolvedPipeline) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the entry "repositories" of the diagnostics, if there are any, and warnings.

    A checkout's state is "tested" if it is at the commit with which the backend was tested,
    "differs" if it is at another one, and "unpinned" if no such commit is stated.
    """
    repositories: dict[str, dict[str, str]] = {}
    for resolved in plan.backends.values():
        with suppress(Exception):  # of a plugin; the result is complete without its statement
            for one in resolved.backend.requirements():
                if isinstance(one, Repository) and one.local_commit:
                    repositories[one.url] = {"commit": one.local_commit, "state": _commit_text(one)}
    others = tuple(
        f"the checkout of {url} is at {entry['commit'][:7]}, not at the commit that was tested"
        for url, entry in repositories.items()
        if entry["state"] == "differs"
    )
    return ({"repositories": repositories} if repositories else {}), others


def _commit_text(repository: Repository) -> str:
    if not repository.commit:
        return "unpinned"
    return "tested" if repository.local_commit.startswith(repository.commit) else "differs"
