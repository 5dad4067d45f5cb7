"""A prediction against the truth of its frame: one record for each annotated person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.joints import LIMB_JOINTS
from physic_bench.projection import body_box
from physic_bench.scene_surface import EXACT_WITHIN_M, SceneIndex, contact_by_rule
from physic_core.adapters.detections import box_iou
from physic_core.body.joints import JOINT_NAMES
from physic_core.metrics import (
    assign,
    contact_counts,
    contact_gap,
    geodesic_error,
    mpjpe_mm,
    mpvpe_mm,
    pa_mpjpe_mm,
    penetration,
    surface_graph,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.carry import Carrier
    from physic_bench.contract import Frame, PredictedPerson, Prediction, Surface, TruePerson, Truth

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]
    Record = dict[str, Any]

BODY_NAMES = tuple(JOINT_NAMES[:22])
"""Pelvis to wrists: joints that SMPL, SMPL+H and SMPL-X have."""

CONTACT_CM = (2, 4, 5)
"""Distances of the rule that makes contact of a true body and a scanned scene, where it is not annotated."""

MIN_IOU = 0.25
"""Overlap of the boxes of a prediction and an annotated person, from which it can be theirs."""

FLOATING_REACH_M = 1.0


@dataclass(eq=False)
class _Reasons:
    """Sentences why something could not be measured."""

    texts: list[str] = field(default_factory=list)

    def add(self, text: str) -> None:
        if text not in self.texts:
            self.texts.append(text)


def base_record(frame: Frame, method: str, person: TruePerson, reason: str = "") -> Record:
    """Return the record of a person who was not found."""
    return {
        "method": method,
        "frame": frame.id,
        "sequence": frame.sequence,
        "group": frame.group,
        "person": person.name,
        "labels": {**frame.labels, **person.labels},
        "found": False,
        "reason": reason,
        "contact": {},
    }


def score_frame(
    frame: Frame, truth: Truth, prediction: Prediction | None, method: str, carrier: Carrier, reason: str = ""
) -> list[Record]:
    """Score everybody who is annotated in a frame.

    Args:
        frame: of the data set.
        truth: ``frame.truth()``.
        prediction: None if the method has no result.
        method: its name.
        carrier: of contact between body meshes.
        reason: why there is no result.
    """
    matched = {} if prediction is None else match_to_truth(frame, truth, prediction)
    records = []
    for row, person in enumerate(truth.people):
        record = base_record(frame, method, person, reason or "no person at this place")
        true_maps = true_contacts(frame, truth, person)
        record["has_result"] = prediction is not None
        if row in matched and prediction is not None:
            found, reasons = prediction.people[matched[row]], _Reasons()
            record |= {"found": True, "reason": "", "grade": found.grade}
            record |= pose_errors(found, person, carrier, reasons)
            record |= _camera_errors(frame, prediction)
            record |= contact_errors(found, person, true_maps, carrier, reasons)
            record |= _physics(frame, truth, found, true_maps, carrier, reasons)
            record["unmeasured"] = reasons.texts
        else:
            record["contact"] = {name: _missed(contact) for name, (contact, _) in true_maps.items()}
        if prediction is not None:
            record |= _floor_errors(truth, prediction)
        records.append(record)
    return records


_NO_BOX = (0.0, 0.0, 0.0, 0.0)  # overlaps no other box


def match_to_truth(frame: Frame, truth: Truth, prediction: Prediction) -> dict[int, int]:
    """Return annotated person -> predicted person, one to one, by the overlap of their boxes in the picture.

    People of a method are projected by the camera that it assumed.
    """
    if not truth.people or not prediction.people:
        return {}
    boxes = [body_box(person, frame.camera.K) for person in truth.people]
    K = frame.camera.K if prediction.K is None else prediction.K
    found = [body_box(person, K) for person in prediction.people]
    iou = box_iou(*(np.array([_NO_BOX if box is None else box for box in some]) for some in (found, boxes)))
    return assign(-iou, iou >= MIN_IOU).predicted_of


def pose_errors(found: PredictedPerson, person: TruePerson, carrier: Carrier, reasons: _Reasons) -> Record:
    """Return the errors of joints and vertices, mm."""
    record: Record = {}
    hips = None
    names = common_joints(found, person)
    if names:
        own, true = _rows(found.joints, found.joint_names, names), _rows(person.joints, person.joint_names, names)
        known = np.asarray(np.isfinite(true).all(-1))
        hips = (_hips(own, names, known), _hips(true, names, known))
        record |= {
            "me_mpjpe": float(mpjpe_mm(own, true, known)),
            "ca_mpjpe": float(mpjpe_mm(own - hips[0], true - hips[1], known)),
            "pa_mpjpe": float(pa_mpjpe_mm(own, true, known)),
            "rt_error": 1000 * float(np.linalg.norm(hips[0] - hips[1])),
            "depth_ratio": float(hips[0][2] / hips[1][2]),
            "hips_m": hips[0].tolist(),
            "joints": int(known.sum()),
            "joint_source": person.joint_source,
        }
    elif person.joints is not None:
        reasons.add("the result has no joints by name")
    if person.vertices is None or found.vertices is None:
        return record
    mesh = carrier.values(person.vertices, person.topology, found.topology)
    if mesh is None:
        reasons.add(_no_way("vertices", found.topology, person.topology))
        return record
    if found.topology != person.topology:
        record["vertices_carried"] = f"{person.topology} to {found.topology}"
    record |= {"me_pve": float(mpvpe_mm(found.vertices, mesh)), "pa_pve": float(pa_mpjpe_mm(found.vertices, mesh))}
    if hips is not None:
        record["ca_pve"] = float(mpvpe_mm(found.vertices - hips[0], mesh - hips[1]))
    return record


def common_joints(found: PredictedPerson, person: TruePerson) -> tuple[str, ...]:
    """Return the joints to compare: 22 of the body if both have them, else those of the 12 limb joints that both have.

    Joints of the result that are not finite count as not estimated.
    Necks, heads and spines of measured joints are defined otherwise than those of body models.
    """
    if found.joints is None or person.joints is None:
        return ()
    estimated = np.asarray(np.isfinite(found.joints).all(axis=-1))
    names = {name for name, known in zip(found.joint_names, estimated, strict=True) if known}
    both = names & set(person.joint_names)
    if set(BODY_NAMES) <= both:
        return BODY_NAMES
    return tuple(name for name in LIMB_JOINTS if name in both)


def true_contacts(frame: Frame, truth: Truth, person: TruePerson) -> dict[str, tuple[Bools, str]]:
    """Return contact truth by its name ("annotated", "2 cm"): (V,) bool and the mesh that it is on."""
    if person.contact is not None:
        return {"annotated": (person.contact, person.contact_topology or person.topology)}
    if truth.scene is None or person.vertices is None:
        return {}
    distance = _true_distance(frame, truth.scene, person)
    return {f"{cm} cm": (contact_by_rule(distance, cm / 100), person.topology) for cm in CONTACT_CM}


def contact_errors(
    found: PredictedPerson,
    person: TruePerson,
    true_maps: Mapping[str, tuple[Bools, str]],
    carrier: Carrier,
    reasons: _Reasons,
) -> Record:
    """Return the counts of right and wrong contact vertices for each contact truth, and geodesic errors of the first.

    Predicted contact is carried to the mesh of the truth.
    """
    if not true_maps or found.contact is None:
        return {}
    main, target = next(iter(true_maps.values()))
    source = found.contact_topology or found.topology
    predicted = carrier.contact(found.contact, source, target)
    if predicted is None:
        reasons.add(_no_way("contact", source, target))
        return {}
    record: Record = {"contact": {}}
    for name, (contact, _) in true_maps.items():
        counts = contact_counts(predicted, contact)
        record["contact"][name] = {
            "hits": int(counts.hits),
            "false_alarms": int(counts.false_alarms),
            "misses": int(counts.misses),
        }
    if source != target:
        record["contact_carried"] = f"{source} to {target}"
    graph = _graph_of(carrier.files, target)
    if graph is not None:
        error = geodesic_error(graph, predicted, main)
        record |= {"geodesic_fp_cm": float(error.false_positive_cm), "geodesic_fn_cm": float(error.false_negative_cm)}
    return record


def _physics(
    frame: Frame,
    truth: Truth,
    found: PredictedPerson,
    true_maps: Mapping[str, tuple[Bools, str]],
    carrier: Carrier,
    reasons: _Reasons,
) -> Record:
    """Return penetration and floating of the predicted body in the true scene, mm."""
    if truth.scene is None or found.vertices is None or not len(truth.scene.faces):
        return {}
    index = _index_of(truth.scene)
    distance = index.signed_distance(frame.camera.in_world(found.vertices), FLOATING_REACH_M)
    deep = penetration(distance, np.ones(len(distance)))
    record: Record = {
        "penetration_mm": 1000 * float(deep.mean_depth),
        "penetration_max_mm": 1000 * float(deep.max_depth),
        "penetration_share": float(deep.share),
    }
    if true_maps:
        contact, topology = next(iter(true_maps.values()))
        carried = carrier.contact(contact, topology, found.topology)
        if carried is None:
            reasons.add(_no_way("contact", topology, found.topology))
        else:
            record["floating_mm"] = 1000 * float(contact_gap(distance, carried, FLOATING_REACH_M))
    return record


def _camera_errors(frame: Frame, prediction: Prediction) -> Record:
    if prediction.K is None:
        return {}
    own, true = (float(np.sqrt(K[0, 0] * K[1, 1])) for K in (prediction.K, frame.camera.K))
    return {"focal_ratio": own / true}


def _floor_errors(truth: Truth, prediction: Prediction) -> Record:
    if truth.up is None or prediction.floor is None:
        return {}
    normal, up = prediction.floor[:3], truth.up
    angle = np.arctan2(np.linalg.norm(np.cross(normal, up)), normal @ up)
    record: Record = {"floor_angle_deg": float(np.degrees(angle))}
    if np.isfinite(truth.camera_height):
        record["camera_height_ratio"] = float(prediction.floor[3] / truth.camera_height)
    return record


def _missed(contact: Bools) -> dict[str, int]:
    return {"hits": 0, "false_alarms": 0, "misses": int(contact.sum())}


def _rows(joints: Array | None, names: Sequence[str], wanted: Sequence[str]) -> Array:
    assert joints is not None
    return np.asarray(joints, np.float64)[[list(names).index(name) for name in wanted]]


def _hips(joints: Array, names: Sequence[str], known: Bools) -> Array:
    rows = [k for k, name in enumerate(names) if name in ("left_hip", "right_hip") and known[k]]
    middle: Array = joints[rows].mean(0) if rows else np.full(3, np.nan)
    return middle


def _no_way(what: str, source: str, target: str) -> str:
    files = sorted({f"--{name} FILE" for name in (source, target) if name in ("smpl", "smplx")})
    need = " and ".join(files) or "a body model file of both, which are not known"
    return f"{what} are on the mesh '{source}' and the truth on '{target}': carrying them over needs {need}"


@lru_cache(maxsize=2)
def _index_of(scene: Surface) -> SceneIndex:
    return SceneIndex.build(scene)


def _true_distance(frame: Frame, scene: Surface, person: TruePerson) -> Array:
    assert person.vertices is not None
    return _index_of(scene).signed_distance(frame.camera.in_world(person.vertices), EXACT_WITHIN_M)


@lru_cache(maxsize=4)
def _graph_of(files: Any, topology: str) -> Any:
    rest = files.rest(topology)
    return None if rest is None else surface_graph(rest.vertices, rest.faces)
