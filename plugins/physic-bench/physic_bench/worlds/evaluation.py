"""Metrics of one reconstruction against the ground truth of its world, for every person.

Joint errors use the first 22 SMPL-X joints, pelvis to wrists
(:data:`physic_core.metrics.BODY_JOINTS`). :data:`physic_bench.worlds.columns.COLUMNS` defines all
metrics.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.worlds.contact_partners import (
    NO_CONTACT,
    ContactMap,
    contact_counts_by_partner,
    reported_support_counts,
)
from physic_core.body import load_body
from physic_core.engine.contact.parts import contact_regions
from physic_core.errors import PhysicError
from physic_core.metrics import (
    BODY_JOINTS,
    PROXIMITY_RADIUS_M,
    SignedDistances,
    align_similarity,
    contact_counts,
    contact_gap,
    floor_error,
    geodesic_error,
    hidden_by_depth_map,
    match_by_masks,
    mpjpe_mm,
    mpvpe_mm,
    pa_mpjpe_mm,
    penetration,
    scene_distance,
    scene_error,
    surface_graph,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.sparse import csr_array

    from physic_core.body.model import BodyModel
    from physic_core.engine.state import Estimates
    from physic_core.metrics import Matching
    from physic_core.types import (
        BoolArray,
        FloatArray,
        Intrinsics,
        Reconstruction,
        Scene,
        Support,
    )
    from physic_testing.worlds import World

    Indices = NDArray[np.int64]

LIMB_JOINTS = (4, 5, 7, 8, 10, 11, 18, 19, 20, 21)
"""Indices of the limb joints: knees, ankles, feet, elbows and wrists."""

_TRUE_PENETRATION_M = 0.01
_SHOWN = 0.05


@dataclass(frozen=True)
class WorldEstimate:
    """Reconstruction of the N people of a world, computed with the settings of one table row.

    The people are in the order of the estimators' output.

    Attributes:
        vertices: (N, V, 3) m, camera frame.
        joints: (N, 55, 3) m.
        contact: (N, V) bool, contact with the scene.
        scene: reconstructed scene; None if the row has none.
        intrinsics: camera intrinsics of the scene.
        failures: for each person, why the engine did not optimise the body; empty if it did.
        contacts: contact with anything; None if the row does not estimate what people touch.
        supports: for each person, what carries them, None for an incomplete body; None if the row
            does not estimate it.
    """

    vertices: FloatArray
    joints: FloatArray
    contact: BoolArray
    scene: Scene | None
    intrinsics: Intrinsics
    failures: tuple[str, ...]
    contacts: ContactMap | None = None
    supports: tuple[Support | None, ...] | None = None


def initial_estimate(
    evidence: Estimates, model: BodyModel, contact_probability: float
) -> WorldEstimate:
    """Return the estimators' bodies before optimisation; vertices with a high contact probability
    are in contact.
    """
    import torch

    from physic_core.body.bones import rotations_from_parameters
    from physic_core.geometry.tensors import tensor

    parameters = evidence.bodies.parameters
    betas, transl, expression = (
        tensor(value).to(model.device, model.dtype)
        for value in (parameters.betas, parameters.transl, parameters.expression)
    )
    with torch.inference_mode():
        body = model(
            rotations_from_parameters(parameters, model.device, model.dtype),
            betas,
            transl,
            expression,
        )
    return WorldEstimate(
        vertices=body.vertices.cpu().numpy(),
        joints=body.joints.cpu().numpy(),
        contact=evidence.contact.probability >= contact_probability,
        scene=None,
        intrinsics=evidence.intrinsics,
        failures=("",) * len(parameters),
    )


def engine_estimate(result: Reconstruction) -> WorldEstimate:
    """Return the engine's result of a photo with people as a WorldEstimate."""

    def stacked(name: str) -> Any:
        return np.stack([getattr(person, name) for person in result.people])

    likely = result.people[0].contact_probability
    contacts = ContactMap(
        stacked("contact"),
        None if likely is None else stacked("contact_probability"),
        stacked("contact_partner"),
        result.contact_partners,
    )
    return WorldEstimate(
        stacked("vertices"),
        stacked("joints"),
        contacts.with_scene(),
        result.scene,
        result.intrinsics,
        tuple(person.measures.joint_problem or "" for person in result.people),
        contacts,
        tuple(person.support for person in result.people),
    )


class Evaluator:
    """Evaluation of reconstructions against the ground truth of one world.

    Args:
        world: ground truth.
        people: (N, H, W) bool, masks of the evidence's people.
        graph: result of :meth:`body_graph`, for geodesic errors.
    """

    def __init__(self, world: World, people: BoolArray, graph: csr_array) -> None:
        self.world = world
        model = load_body(world.body_model)
        self._part = model.part_of_vertex.numpy()
        self._support_parts, region = contact_regions(model)
        self._support_part = region.cpu().numpy()
        self.matching: Matching = match_by_masks(people, world.masks, min_iou=0.3)
        self._graph = graph
        self._empty = world.points(people=False)
        self._known: BoolArray = np.asarray(np.isfinite(self._empty).all(-1))
        self._near = self._distance(world.vertices)
        hidden = hidden_by_depth_map(world.vertices, world.empty_depth, world.intrinsics)
        self._counted = (
            world.outer & (~hidden | world.contact) & (self._near.distance > -_TRUE_PENETRATION_M)
        )
        self._shown = world.contact & (np.abs(self._near.distance) <= _SHOWN)
        self._limbs = np.zeros(world.joints_visible.shape, bool)
        self._limbs[:, LIMB_JOINTS] = ~world.joints_visible[:, LIMB_JOINTS]

    def _distance(self, vertices: FloatArray) -> SignedDistances:
        """Return the distances of vertices (n, V, 3) from the visible surfaces of the scene."""
        world = self.world
        return scene_distance(
            vertices, self._empty, world.empty_normals, self._known, world.intrinsics, world.floor
        )

    @staticmethod
    def body_graph(model: BodyModel) -> csr_array:
        """Return the edge graph of the rest body's surface, with shortcuts across pairs of adjacent
        faces.
        """
        vertices = model(*model.zero_pose()).vertices[0]
        return surface_graph(vertices.cpu().numpy(), model.faces.cpu().numpy(), across=True)

    def truth_records(self) -> list[dict[str, Any]]:
        """Return distance, visibility and contact metrics of every person in the ground truth."""
        world = self.world
        everybody = np.arange(len(world.masks))
        touch = self._touch(everybody, self._near)
        for facts, true in zip(touch, self._true_touch(everybody, world.vertices), strict=True):
            facts |= true
        return [
            {
                "action": world.action[i],
                "distance_m": float(world.joints[i, 0, 2]),
                "hidden_limb_joints": int(self._limbs[i].sum()),
                "contact_vertices": int(world.contact[i].sum()),
                "shown_contact_vertices": int(self._shown[i].sum()),
                "measured": touch[i],
            }
            for i in range(len(world.masks))
        ]

    def person_records(self, estimate: WorldEstimate) -> list[dict[str, Any]]:
        """Return one record per true person: whether a body was found, and its metrics.

        Raises:
            PhysicError: the bodies are not of the world's mesh.
        """
        world = self.world
        matching = self.matching
        if estimate.vertices.shape[1:] != world.vertices.shape[1:]:
            raise PhysicError(
                f"The bodies have {estimate.vertices.shape[1]} vertices and those of the worlds "
                f"{world.vertices.shape[1]}: only bodies of the mesh {world.topology} can be "
                f"compared."
            )
        answers: list[dict[str, Any]] = [
            {
                "found": False,
                "why": "no person was found there",
                **self._missed(i, estimate.contacts is not None),
            }
            for i in range(len(world.masks))
        ]
        rows = matching.predicted
        true = matching.truth
        finite = np.isfinite(estimate.vertices[rows]).all((1, 2)) & np.isfinite(
            estimate.joints[rows]
        ).all((1, 2))
        for i in true[~finite]:
            answers[i]["why"] = "the body is not finite"
        rows = rows[finite]
        true = true[finite]
        if len(rows):
            measured = zip(
                self._pose(estimate, rows, true), self._contact(estimate, rows, true), strict=True
            )
            touch = self._scene_touch(estimate, rows, true)
            true_person = dict(
                zip(matching.predicted.tolist(), matching.truth.tolist(), strict=True)
            )
            for j, (pose, contact) in enumerate(measured):
                row = int(rows[j])
                person = int(true[j])
                answer = {"found": True, "why": estimate.failures[row], **pose, **contact}
                if estimate.contacts is not None:
                    answer |= contact_counts_by_partner(
                        world, estimate.contacts, row, person, true_person, self._part
                    )
                if estimate.supports is not None:
                    answer |= self._support_counts(estimate.supports[row], person)
                answers[person] = answer | (touch[j] if touch else {})
        return answers

    def missed_records(self, why: str) -> list[dict[str, Any]]:
        """Return the records of all true people for a table row whose run failed."""
        return [
            {"found": False, "why": why, **self._missed(i, True)}
            for i in range(len(self.world.masks))
        ]

    def scene_record(self, estimate: WorldEstimate) -> dict[str, Any]:
        """Return the errors of scene and floor; empty if the estimate has no scene."""
        if estimate.scene is None:
            return {}
        world = self.world
        scene = estimate.scene
        error = scene_error(scene.points, self._empty, scene.valid, self._known)
        feet = world.joints[:, 10:12].reshape(-1, 3).mean(0)
        floor = floor_error(scene.floor, world.floor, feet)
        scale = math.exp(error.log_scale) - 1 if math.isfinite(error.log_scale) else math.nan
        return {
            "scene_point_mm": 1000 * error.point_median,
            "scene_depth_percent": 100 * error.depth_relative_median,
            "scene_scale_percent": 100 * abs(scale),
            "floor_angle_deg": floor.angle_deg,
            "floor_height_mm": 1000 * abs(floor.height),
            "scene_engine_scale": scene.scale,
            "floor_found": scene.floor is not None,
            "all": asdict(error),
        }

    def _pose(self, estimate: WorldEstimate, rows: Indices, true: Indices) -> list[dict[str, Any]]:
        """Return the pose errors of matched people."""
        world = self.world
        joints, fact = (
            np.asarray(a[:, BODY_JOINTS], np.float64)
            for a in (estimate.joints[rows], world.joints[true])
        )
        aligned = align_similarity(joints, fact)
        limbs = self._limbs[true][:, BODY_JOINTS]
        columns = {
            "mpjpe_mm": mpjpe_mm(joints, fact),
            "pa_mpjpe_mm": pa_mpjpe_mm(joints, fact),
            "mpvpe_mm": mpvpe_mm(estimate.vertices[rows], world.vertices[true]),
            "hidden_limbs_pa_mm": mpjpe_mm(aligned, fact, limbs),
            "depth_error_mm": 1000 * (joints[:, 0, 2] - fact[:, 0, 2]),
        }
        return [
            {name: float(values[j]) for name, values in columns.items()} for j in range(len(rows))
        ]

    def _contact(
        self, estimate: WorldEstimate, rows: Indices, true: Indices
    ) -> list[dict[str, Any]]:
        """Return the contact scores of matched people."""
        predicted = estimate.contact[rows]
        fact = self.world.contact[true]
        counts = contact_counts(predicted, fact)
        skin = geodesic_error(self._graph, predicted, fact)
        return [
            {
                "hits": int(counts.hits[j]),
                "false_alarms": int(counts.false_alarms[j]),
                "misses": int(counts.misses[j]),
                "geodesic_fp_cm": float(skin.false_positive_cm[j]),
                "geodesic_fn_cm": float(skin.false_negative_cm[j]),
            }
            for j in range(len(rows))
        ]

    def _support_counts(self, support: Support | None, person: int) -> dict[str, int]:
        carrying = self.world.support[person]
        return reported_support_counts(support, carrying, self._support_parts, self._support_part)

    def _scene_touch(
        self, estimate: WorldEstimate, rows: Indices, true: Indices
    ) -> list[dict[str, float]]:
        """Return penetration and floating of matched people relative to the reconstructed scene."""
        scene = estimate.scene
        if scene is None:
            return []
        vertices = estimate.vertices[rows]
        near = scene_distance(
            vertices, scene.points, scene.normals, scene.valid, estimate.intrinsics, scene.floor
        )
        error = scene_error(scene.points, self._empty, scene.valid, self._known)
        factor = math.exp(-error.log_scale) if math.isfinite(error.log_scale) else 1.0
        scaled = self._true_touch(true, factor * vertices)
        return [
            {**touch, **own} for touch, own in zip(self._touch(true, near), scaled, strict=True)
        ]

    def _true_touch(self, true: Indices, vertices: FloatArray) -> list[dict[str, float]]:
        """Return penetration and floating of vertices (n, V, 3) of true people relative to the true
        scene.
        """
        distance = self._distance(vertices).distance
        inside = penetration(distance, self._counted[true])
        gap = contact_gap(distance, self._shown[true], reach=PROXIMITY_RADIUS_M)
        return [
            {
                "true_penetration_mm": 1000 * float(inside.mean_depth[j]),
                "true_floating_mm": 1000 * float(gap[j]),
            }
            for j in range(len(true))
        ]

    def _touch(self, true: Indices, near: SignedDistances) -> list[dict[str, float]]:
        """Return penetration and floating for given scene distances."""
        inside = penetration(near.distance, self._counted[true])
        shown, every = (
            contact_gap(near.distance, c[true], reach=PROXIMITY_RADIUS_M)
            for c in (self._shown, self.world.contact)
        )
        return [
            {
                "penetration_mm": 1000 * float(inside.mean_depth[j]),
                "penetration_max_mm": 1000 * float(inside.max_depth[j]),
                "floating_mm": 1000 * float(shown[j]),
                "floating_all_mm": 1000 * float(every[j]),
            }
            for j in range(len(true))
        ]

    def _missed(self, i: int, partners: bool) -> dict[str, Any]:
        """Return the contact counts of a missed person: all true contacts are misses."""
        counts: dict[str, Any] = {
            "hits": 0,
            "false_alarms": 0,
            "misses": int(self.world.contact[i].sum()),
        }
        if partners:
            counts |= contact_counts_by_partner(self.world, NO_CONTACT, 0, i, {}, self._part)
            counts |= self._support_counts(None, i)
        return counts
