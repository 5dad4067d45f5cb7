"""A prediction against the truth of its frame: one record for each annotated person, and the
columns of the table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.cameras import box_of_points, project
from physic_bench.figures import Column, contact_columns, mean_column
from physic_bench.scene_surface import SceneIndex, contact_by_rule
from physic_core.body import JOINT_NAMES, angle_deg
from physic_core.types import SIDES
from physic_testing.metrics import (
    PROXIMITY_RADIUS_M,
    contact_counts,
    contact_gap,
    geodesic_error,
    match_by_boxes,
    mpjpe_mm,
    mpvpe_mm,
    pa_mpjpe_mm,
    penetration,
    surface_graph,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from physic_bench.bodies import BodyFiles
    from physic_bench.types import BenchPerson, Frame, Prediction, Surface, Truth
    from physic_core.types import BoolArray, Float64Array, FloatArray

    Record = dict[str, Any]
    Contacts = Mapping[str, tuple[BoolArray, str]]

LIMB_JOINTS = tuple(
    f"{side}_{name}"
    for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in SIDES
)
"""The joints that are compared where a data set has no body model.

Necks, heads and spines are defined otherwise by every data set.
"""

BODY_NAMES = JOINT_NAMES[:22]
"""Pelvis to wrists: joints that SMPL, SMPL+H and SMPL-X have."""

CONTACT_CM = (2, 4, 5)
"""Distances of the rule that makes contact of a true body and a scanned scene, where it is not
annotated.
"""

MIN_IOU = 0.25
"""Overlap of the boxes of a prediction and an annotated person, from which it can be theirs."""

COLUMNS: tuple[Column, ...] = (
    mean_column(
        "found", "people found", "share of the annotated people who have a body", 3, "high"
    ),
    mean_column("me_mpjpe", "MPJPE, mm", "mean distance of the joints, nothing aligned"),
    mean_column("ca_mpjpe", "CA-MPJPE, mm", "the same after the middle of the hips was aligned"),
    mean_column("pa_mpjpe", "PA-MPJPE, mm", "the same after the best similarity"),
    mean_column("rt_error", "root error, mm", "distance of the middle of the hips"),
    mean_column("me_pve", "MPVPE, mm", "mean distance of the vertices, nothing aligned"),
    mean_column("ca_pve", "CA-MPVPE, mm", "the same after the middle of the hips was aligned"),
    mean_column("pa_pve", "PA-MPVPE, mm", "the same after the best similarity"),
    mean_column("depth_ratio", "depth ratio", "depth of the hips over the true one", 3, ""),
    mean_column("focal_ratio", "focal ratio", "assumed focal length over the true one", 3, ""),
    mean_column(
        "penetration_mm",
        "penetration, mm",
        "mean depth of the vertices inside the true scene; 0 without",
    ),
    mean_column(
        "penetration_max_mm", "deepest, mm", "depth of the deepest vertex inside the true scene"
    ),
    mean_column(
        "floating_mm",
        "floating, mm",
        "mean gap, 150 at most, of truly touching vertices from the true scene",
    ),
    mean_column(
        "geodesic_fp_cm",
        "geodesic FP, cm",
        "mean distance on the skin from predicted contact to true contact",
    ),
    mean_column(
        "geodesic_fn_cm",
        "geodesic FN, cm",
        "mean distance on the skin from true contact to predicted contact",
    ),
    mean_column("floor_angle_deg", "floor, deg", "angle between the floor's normal and up"),
    mean_column(
        "camera_height_ratio",
        "camera height ratio",
        "height over the floor over the true one",
        3,
        "",
    ),
)
"""Columns without those of contact, which exist once for each contact truth.

Names are those of Human3R's evaluation in camera space: ``me_`` is metric, ``ca_`` and ``pa_`` are
aligned. Pelvis means the middle of both hips.
"""


def columns_with_contact_truths(contact_truths: Sequence[str]) -> tuple[Column, ...]:
    """Return all columns, with those of each contact truth ("2 cm", "annotated")."""
    contact = [
        contact_columns(partial(_counts_of, rule=rule), f"@{rule}") for rule in contact_truths
    ]
    return (*COLUMNS, *(column for columns in contact for column in columns))


def _counts_of(record: Record, rule: str) -> Mapping[str, int] | None:
    counts: Mapping[str, int] | None = record["contact"].get(rule)
    return counts


def score_frame(
    frame: Frame, truth: Truth, prediction: Prediction | None, files: BodyFiles, reason: str
) -> list[Record]:
    """Score everybody who is annotated in a frame.

    Args:
        frame: of the data set.
        truth: ``frame.truth()``.
        prediction: None if the method has no result.
        files: body models, by which contact is carried between meshes.
        reason: why there is no result.
    """
    matched = {} if prediction is None else match_to_truth(frame, truth, prediction)
    records = []
    for row, person in enumerate(truth.people):
        contacts = true_contacts(frame, truth, person)
        record: Record = {
            "id": f"{frame.id} {person.name}",
            "frame": frame.id,
            "sequence": frame.sequence,
            "person": person.name,
            "has_result": prediction is not None,
            "found": row in matched,
            "reason": "" if row in matched else reason or "no person at this place",
            "contact": {
                name: _counts(np.zeros_like(contact), contact)
                for name, (contact, _) in contacts.items()
            },
            "unmeasured": [],
        }
        if prediction is not None:
            record |= _floor_errors(truth, prediction)
        if prediction is not None and row in matched:
            predicted = prediction.people[matched[row]]
            record["marks"] = dict(predicted.marks)
            record |= pose_errors(predicted, person, files, record["unmeasured"])
            record |= contact_errors(predicted, contacts, files, record["unmeasured"])
            record |= _scene_errors(frame, truth, predicted, contacts, files)
            if prediction.K is not None:
                focal = [float(np.sqrt(K[0, 0] * K[1, 1])) for K in (prediction.K, frame.camera.K)]
                record["focal_ratio"] = focal[0] / focal[1]
        records.append(record)
    return records


def match_to_truth(frame: Frame, truth: Truth, prediction: Prediction) -> dict[int, int]:
    """Return annotated person -> predicted person, one to one, by the overlap of their boxes in the
    picture.

    People of a method are projected by the camera that it assumed.
    """
    K = frame.camera.K if prediction.K is None else prediction.K
    predicted, true = (
        [body_box(person, k) for person in some]
        for some, k in ((prediction.people, K), (truth.people, frame.camera.K))
    )
    return match_by_boxes(predicted, true, MIN_IOU).predicted_of


def _joint_errors(
    predicted: FloatArray, true: FloatArray, is_known: BoolArray, hips: Sequence[FloatArray]
) -> Record:
    """Return the errors of joints (J, 3) of which the truth is known (J,), and of the hips."""
    return {
        "me_mpjpe": float(mpjpe_mm(predicted, true, is_known)),
        "ca_mpjpe": float(mpjpe_mm(predicted - hips[0], true - hips[1], is_known)),
        "pa_mpjpe": float(pa_mpjpe_mm(predicted, true, is_known)),
        "rt_error": 1000 * float(np.linalg.norm(hips[0] - hips[1])),
        "depth_ratio": float(hips[0][2] / hips[1][2]),
    }


def pose_errors(
    predicted: BenchPerson, person: BenchPerson, files: BodyFiles, unmeasured: list[str]
) -> Record:
    """Return the errors of joints and vertices, mm."""
    record: Record = {}
    hips = None
    names = common_joints(predicted, person)
    if names:
        estimated, true = (_joint_rows(p, names) for p in (predicted, person))
        is_known = np.asarray(np.isfinite(true).all(-1))
        pair = [
            k for k, name in enumerate(names) if name in ("left_hip", "right_hip") and is_known[k]
        ]
        hips = [
            joints[pair].mean(0) if pair else np.full(3, np.nan) for joints in (estimated, true)
        ]
        record |= _joint_errors(estimated, true, is_known, hips)
        record["joints"] = f"{is_known.sum()} ({person.joint_source})"
    elif person.joints is not None:
        unmeasured.append("the result has no joints by name")
    if person.vertices is None or predicted.vertices is None:
        return record
    mesh = files.transfer(person.vertices, person.topology, predicted.topology)
    if mesh is None:
        unmeasured.append(_no_transfer_text("vertices", predicted.topology, person.topology))
        return record
    if predicted.topology != person.topology:
        record["carried"] = f"the true mesh from {person.topology} to {predicted.topology}"
    record |= {
        "me_pve": float(mpvpe_mm(predicted.vertices, mesh)),
        "pa_pve": float(pa_mpjpe_mm(predicted.vertices, mesh)),
    }
    if hips is not None:
        record["ca_pve"] = float(mpvpe_mm(predicted.vertices - hips[0], mesh - hips[1]))
    return record


def common_joints(predicted: BenchPerson, person: BenchPerson) -> tuple[str, ...]:
    """Return the joints to compare: 22 of the body if both have them, else those of the 12 limb
    joints that both have.

    Joints of the result that are not finite count as not estimated. Necks, heads and spines of
    measured joints are defined otherwise than those of body models.
    """
    if predicted.joints is None or person.joints is None:
        return ()
    names = {
        name
        for name, joint in zip(predicted.joint_names, predicted.joints, strict=True)
        if np.isfinite(joint).all()
    }
    both = names & set(person.joint_names)
    return (
        BODY_NAMES
        if set(BODY_NAMES) <= both
        else tuple(name for name in LIMB_JOINTS if name in both)
    )


def true_contacts(
    frame: Frame, truth: Truth, person: BenchPerson
) -> dict[str, tuple[BoolArray, str]]:
    """Return contact truth by its name ("annotated", "2 cm"): (V,) bool and the mesh that it is
    on.
    """
    if person.contact is not None:
        return {"annotated": (person.contact, person.contact_topology)}
    if truth.scene is None or person.vertices is None:
        return {}
    distance = _scene_distance(frame, truth.scene, person.vertices)
    return {f"{cm} cm": (contact_by_rule(distance, cm / 100), person.topology) for cm in CONTACT_CM}


def contact_errors(
    person: BenchPerson, contacts: Contacts, files: BodyFiles, unmeasured: list[str]
) -> Record:
    """Return the counts of right and wrong contact vertices for each contact truth, and geodesic
    errors of the first.

    Predicted contact is carried to the mesh of the truth.
    """
    if not contacts or person.contact is None:
        return {"contact": {}}
    main, target = next(iter(contacts.values()))
    predicted = files.transfer_contact(person.contact, person.contact_topology, target)
    if predicted is None:
        unmeasured.append(_no_transfer_text("contact", person.contact_topology, target))
        return {"contact": {}}
    record: Record = {
        "contact": {name: _counts(predicted, contact) for name, (contact, _) in contacts.items()}
    }
    if person.contact_topology != target:
        record["contact_carried"] = f"predicted contact from {person.contact_topology} to {target}"
    graph = _graph_of(files, target)
    if graph is not None:
        error = geodesic_error(graph, predicted, main)
        record |= {
            "geodesic_fp_cm": float(error.false_positive_cm),
            "geodesic_fn_cm": float(error.false_negative_cm),
        }
    return record


def _counts(predicted: BoolArray, truth: BoolArray) -> dict[str, int]:
    return {name: int(value) for name, value in vars(contact_counts(predicted, truth)).items()}


def _scene_errors(
    frame: Frame, truth: Truth, predicted: BenchPerson, contacts: Contacts, files: BodyFiles
) -> Record:
    """Return penetration and floating of the predicted body in the true scene, mm."""
    if truth.scene is None or predicted.vertices is None:
        return {}
    distance = _scene_distance(frame, truth.scene, predicted.vertices)
    deep = penetration(distance)
    record = {
        "penetration_mm": 1000 * float(deep.mean_depth),
        "penetration_max_mm": 1000 * float(deep.max_depth),
    }
    if contacts:
        contact, topology = next(iter(contacts.values()))
        carried = files.transfer_contact(contact, topology, predicted.topology)
        if carried is not None:
            record["floating_mm"] = 1000 * float(contact_gap(distance, carried, PROXIMITY_RADIUS_M))
    return record


def _floor_errors(truth: Truth, prediction: Prediction) -> Record:
    if truth.up is None or prediction.floor is None:
        return {}
    return {
        "floor_angle_deg": float(angle_deg(prediction.floor[:3], truth.up)),
        "camera_height_ratio": float(prediction.floor[3] / truth.camera_height),
    }


def _joint_rows(person: BenchPerson, wanted: Sequence[str]) -> Float64Array:
    return np.asarray(person.joints, np.float64)[
        [person.joint_names.index(name) for name in wanted]
    ]


def _no_transfer_text(what: str, source: str, target: str) -> str:
    files = sorted({f"--{name} FILE" for name in (source, target) if name in ("smpl", "smplx")})
    need = " and ".join(files) or "body model files, and these models are not known"
    return (
        f"{what} are on the mesh '{source}' and the truth on '{target}': the transfer needs {need}"
    )


def _scene_distance(
    frame: Frame, scene: Surface | Callable[[Float64Array], Float64Array], points: Float64Array
) -> Float64Array:
    """Return the signed distance (N,) m of points (N, 3) of the camera frame to a scene."""
    if callable(scene):
        return scene(points)
    return _search_index(scene).signed_distance(frame.camera.to_world(points))


@lru_cache(maxsize=2)
def _search_index(surface: Surface) -> SceneIndex:
    return SceneIndex.build(surface)


@lru_cache(maxsize=4)
def _graph_of(files: BodyFiles, topology: str) -> csr_array | None:
    rest = files.rest_mesh(topology)
    return None if rest is None else surface_graph(rest.vertices, rest.faces)


def body_box(person: BenchPerson, K: Float64Array) -> Float64Array:
    """Return the box (4,) px around a projected body, or around its joints; an empty one if most of
    it is unknown.
    """
    points = person.joints if person.vertices is None else person.vertices
    return box_of_points(project(np.reshape(() if points is None else points, (-1, 3)), K))
