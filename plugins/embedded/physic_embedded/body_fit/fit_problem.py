"""Loss of the body fit: keypoints, 3D landmarks, priors, a known floor, and the outlines of
masks.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch

from physic_core.body import JOINT_INDEX, MAX_FLEXION, head_direction, joint_pair
from physic_core.engine.sizes.stature import mean_adult_betas
from physic_core.geometry import rotvec_to_rotmat
from physic_core.types import PER_PERSON, SURE_CONFIDENCE, select_people
from physic_embedded.body_fit.limb_keypoints import LIMBS, sided_indices
from physic_embedded.body_fit.observations import SIZE_STATURE_M
from physic_embedded.body_fit.pose_prior import (
    hinge_joints,
    pose_prior,
    relaxed_finger_pose,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from torch import Tensor

    from physic_core.body import BodyModel, LandmarkModel
    from physic_core.types import BoolArray, FloatArray, Skeleton
    from physic_embedded.body_fit.observations import BodyObservations


UPRIGHT_SIGMA = 0.03
"""Radians between the line from ankles to neck and the vertical, seen from the side."""

KNEE_SIGMA = 0.12
"""Radians, bend of knees of people who stand from where the fit starts. Without it, a body that is
set upright bends them until it is as short as the leaning one looked.
"""

# A detector may state its own errors of keypoints and of 3D landmarks.
_KEYPOINT_SIGMA = 0.010  # sizes of the person
_WORLD_SIGMA_M = (0.04, 0.04, 0.08)  # right, down, and away from the camera
# Std. dev. between a joint of the body and the same joint of a detector or a data set, which
# defines it in another way; added to errors that a detector states.
_JOINT_SIGMA_M = 0.02
# Weight of the squared shape components about a mean adult. With 1, landmark noise makes odd
# bodies.
_SHAPE_WEIGHT = 4.0
# Std. dev. of stature around the mean adult. Landmarks do not count: their bones are as long for
# short people as for tall ones.
_STATURE_SIGMA_M = 0.05
_SIZE_SIGMA = 0.1  # logarithm of the size of the network's landmarks
_PITCH_SIGMA = 0.05  # radians, of the landmarks about the view's x axis, where it is free
# Radians between trunk and vertical, from the side, where a floor is known. The loss is robust:
# people who bend are not pulled.
_TRUNK_SIGMA = 0.1
# Radians between the pitches of the landmarks above the hips and of the legs, where a floor is
# known.
_TRUNK_PITCH_SIGMA = 0.3
# Std. dev. between the lowest points of two visible feet that probably both stand. The loss is
# robust: a foot in the air is not pulled.
_LEVEL_SIGMA_M = 0.02
_LIMIT = 3.0  # standard deviations at which a leg, a lifted joint or a head is pulled most
_OUTLINE_SIGMA = 0.015  # distance between the outlines of body and mask, in sizes
# Standard deviations at which a pair of outline points pulls most. Beyond, it is probably wrong.
_OUTLINE_LIMIT = 2.0
# Error of a lifted joint on motions that took no part in the fit of the lifter.
_LIFTED_SIGMA_M = 0.05

NUM_TURNED = 22
"""Number of joints that the fit turns, by three unknowns each: all but jaw, eyes and fingers."""

LIMB_ROWS = [JOINT_INDEX[name] for name in LIMBS]
"""Rows of the lifted joints in the joints of the body."""


@dataclass(frozen=True)
class InitialPose:
    """Initial rotations and positions of N bodies, camera frame.

    Attributes:
        root: (N, 3, 3).
        pose: (N, 21, 3) rotation vectors.
        transl: (N, 3) metres, z > 0.
    """

    root: FloatArray
    pose: FloatArray
    transl: FloatArray


class LegsByPosture(NamedTuple):
    """Limits of the cosines between thigh and vertical, and between shank and thigh, of N people.

    Attributes:
        cosine: (N, 2) limits.
        sigma: (N, 2) standard deviations of cosines below the limit; negative: of cosines above it;
            infinite where nothing is known.
    """

    cosine: FloatArray
    sigma: FloatArray


@dataclass(frozen=True)
class FloorConstraint:
    """Constraint of the vertical on the fit of N people: level feet, and upright bodies.

    Attributes:
        up: (3,) unit normal of the floor, or of an upright camera without one; camera frame.
        trunk: (N,) bool, people whose trunk is vertical unless it is clearly bent, and whose feet
            are level.
        upright: (N,) weight of a vertical line from ankles to neck.
        pitch: (N,) rotation of the landmarks about the view's x axis before the fit, radians.
        legs: where the legs lie by the posture.
    """

    up: FloatArray
    trunk: BoolArray
    upright: FloatArray
    pitch: FloatArray
    legs: LegsByPosture


_SHOULDERS, _HIPS, _KNEES, _ANKLES = map(joint_pair, ("shoulder", "hip", "knee", "ankle"))


@dataclass(frozen=True)
class DecodedUnknowns:
    """Body parameters of N people, decoded from the scaled unknowns of the fit.

    Attributes:
        rotations: (N, 55, 3, 3), camera frame.
        pose: (N, 21, 3) rotation vectors of joints 1 to 21, radians.
        betas: (N, K).
        transl: (N, 3) metres.
        landmark_size: (N,) factor on the network's landmarks.
        pitch: (N,) rotation of the landmarks about the view's x axis, radians.
        trunk_pitch: (N,) the same of the landmarks above the hips beside that, radians.
    """

    rotations: Tensor
    pose: Tensor
    betas: Tensor
    transl: Tensor
    landmark_size: Tensor
    pitch: Tensor
    trunk_pitch: Tensor


@dataclass(frozen=True)
class OutlinePairs:
    """Pairs of a body vertex and a line in the picture; N people, P pairs.

    The residual of a pair is ``normal @ (pixel of the vertex) - offset``, in sizes of the person;
    only a positive one counts.

    Attributes:
        vertex_ids: (V,) int64, of the body model.
        vertex: (N, P) int64, rows of ``vertex_ids``.
        normal: (N, P, 2) per px.
        offset: (N, P).
        weight: (N, P), zero for pairs that do not count.
    """

    vertex_ids: Tensor
    vertex: Tensor = field(metadata=PER_PERSON)
    normal: Tensor = field(metadata=PER_PERSON)
    offset: Tensor = field(metadata=PER_PERSON)
    weight: Tensor = field(metadata=PER_PERSON)


@dataclass(frozen=True)
class LiftedLimbs:
    """What the lifter tells of N people; joints of :data:`physic_embedded.body_fit.lifter.LIMBS`.

    Attributes:
        joints: (N, 12, 3) metres, relative to the middle of the hips, in the view's axes.
        weight: (N, 12), zero for joints that do not count.
        distance: (N, 12) metres between the joints and those of the fit without the lifter.
    """

    joints: Tensor = field(metadata=PER_PERSON)
    weight: Tensor = field(metadata=PER_PERSON)
    distance: Tensor = field(metadata=PER_PERSON)


_ROOT_STEP = 0.2  # radians of one unit of the whitened unknowns
_LOG_Z_STEP = 0.05  # logarithm of the depth, of one unit
_SIDE_STEP = 0.01  # share of the depth, across the line of sight, of one unit
_HINGE_WEIGHT = 12.0
_SMOOTH_MIN_SHARPNESS = 150.0  # per metre, of the smooth minimum
_TRUNK_LIMIT = 0.4  # radians from the vertical, of a trunk that is probably upright


@dataclass(frozen=True)
class FitProblem:
    """Constant data of a body fit of N people as tensors of the model's float type.

    Attributes:
        landmarks: poses the J keypoints, the joints, and the vertices of soles and outlines.
        skeleton: of the keypoints.
        rows: (J,) int64, of the fitted keypoints in the skeleton.
        hips: rows of the left and the right hip in the fitted keypoints.
        points: (N, J, 2) px.
        weight: (N, J) of the keypoints.
        turn: (N, 3, 3) rotation from the view's axes (right, down, away) to the camera's.
        world: (N, J, 3) metres, landmarks in the view's axes about the middle of the hips, or None.
        world_weight: (N, J) of the landmarks.
        point_sigma: (N, J) px.
        world_sigma: (N, J, 3) metres; infinite where the landmarks tell nothing.
        camera: (3, 3) px.
        root: (N, 3, 3), start of the pelvis.
        pose: (N, 21, 3) rotation vectors, start of the body joints, radians.
        mean: (21, 3) of the prior of ``pose``, radians.
        sigma: (21, 3) of the prior, radians; the unit of its unknowns.
        fingers: (33, 3, 3), of jaw, eyes and fingers, which are not fitted.
        log_z: (N, 1) logarithm of the start's depth.
        side: (N, 2) start across the line of sight, as a share of the depth.
        pitch: (N,) start of the landmarks' rotation about the view's x axis, radians.
        up: (3,) unit, camera frame; zero without a floor.
        up_angle: (N,) of ``up`` from the view's vertical, seen from the side, radians.
        feet: (N,) weight of level feet.
        soles: number of vertices of the left and the right sole.
        upright: (N,) weight of a vertical line from ankles to neck.
        trunk: (N,) weight of a vertical trunk.
        legs: (N, 2) limits of the cosines of :class:`LegsByPosture`.
        legs_sigma: (N, 2), the same.
        upper: (J,) 1 for keypoints above the hips, which turn with the trunk; 0 for legs.
        outlines: pairs of points on the outlines of bodies and masks; None before the second fit.
        lifted: what the lifter tells of the limbs, or None.
        head: (N, 3) unit vectors in which the faces look, camera frame; zero without a face.
        head_weight: (N,) of these, per squared radian; zero without a face.
        stature: (K,) metres that one unit of each shape component adds.
        adult: (K,) shape of a mean adult.
    """

    landmarks: LandmarkModel
    skeleton: Skeleton
    rows: Tensor
    hips: tuple[int, int]
    points: Tensor = field(metadata=PER_PERSON)
    weight: Tensor = field(metadata=PER_PERSON)
    turn: Tensor = field(metadata=PER_PERSON)
    world: Tensor | None = field(metadata=PER_PERSON)
    world_weight: Tensor = field(metadata=PER_PERSON)
    point_sigma: Tensor = field(metadata=PER_PERSON)
    world_sigma: Tensor = field(metadata=PER_PERSON)
    camera: Tensor
    root: Tensor = field(metadata=PER_PERSON)
    pose: Tensor = field(metadata=PER_PERSON)
    mean: Tensor
    sigma: Tensor
    fingers: Tensor
    log_z: Tensor = field(metadata=PER_PERSON)
    side: Tensor = field(metadata=PER_PERSON)
    pitch: Tensor = field(metadata=PER_PERSON)
    up: Tensor
    up_angle: Tensor = field(metadata=PER_PERSON)
    feet: Tensor = field(metadata=PER_PERSON)
    soles: tuple[int, int]
    upright: Tensor = field(metadata=PER_PERSON)
    trunk: Tensor = field(metadata=PER_PERSON)
    legs: Tensor = field(metadata=PER_PERSON)
    legs_sigma: Tensor = field(metadata=PER_PERSON)
    upper: Tensor
    outlines: OutlinePairs | None = field(metadata=PER_PERSON)
    lifted: LiftedLimbs | None = field(metadata=PER_PERSON)
    head: Tensor = field(metadata=PER_PERSON)
    head_weight: Tensor = field(metadata=PER_PERSON)
    stature: Tensor
    adult: Tensor

    @property
    def num_unknowns(self) -> int:
        """Number of unknowns of one person: root rotation, pose, shape, translation, landmark scale
        and pitches.
        """
        return 3 + 63 + len(self.stature) + 3 + 3

    def select(self, rows: Tensor) -> FitProblem:
        """Select people by index (n,) int64; an index may repeat."""
        return select_people(self, rows)

    def decode(self, unknowns: Tensor) -> DecodedUnknowns:
        """Convert unknowns (N, W) to body parameters."""
        count = len(unknowns)
        root, pose, betas, transl, size, pitch, trunk = unknowns.split(  # type: ignore[no-untyped-call]
            [3, 63, len(self.stature), 3, 1, 1, 1], 1
        )
        rotvecs = self.pose + self.sigma * pose.view(count, 21, 3)
        local = rotvec_to_rotmat(torch.cat([_ROOT_STEP * root[:, None], rotvecs], 1))
        rotations = torch.cat(
            [local[:, :1] @ self.root[:, None], local[:, 1:], self.fingers.expand(count, -1, 3, 3)],
            1,
        )
        z = torch.exp(self.log_z + _LOG_Z_STEP * transl[:, 2:])
        transl = torch.cat([(self.side + _SIDE_STEP * transl[:, :2]) * z, z], 1)
        return DecodedUnknowns(
            rotations,
            rotvecs,
            self.adult + betas,
            transl,
            torch.exp(_SIZE_SIGMA * size)[:, 0],
            self.pitch + _PITCH_SIGMA * pitch[:, 0] * self.upright,
            _TRUNK_PITCH_SIGMA * trunk[:, 0] * self.trunk,
        )

    def rotation_sigma(self, covariance: Tensor) -> Tensor:
        """Return the standard deviations (N, 22), radians, of the angles of pelvis and body joints.

        Args:
            covariance: (N, W, W) of the unknowns.
        """
        variance = covariance.diagonal(dim1=1, dim2=2)[:, :66].view(-1, 22, 3)
        steps = torch.cat([torch.full_like(self.sigma[:1], _ROOT_STEP), self.sigma])
        return (variance * steps.square()).sum(-1).sqrt()

    def loss(self, unknowns: Tensor) -> Tensor:
        """Return the loss (N,) of each person: the sum of all terms."""
        data, constraints = self.terms(unknowns)
        return data + constraints

    def terms(self, unknowns: Tensor) -> tuple[Tensor, Tensor]:
        """Return the losses (N,) of data and priors, and those (N,) of floor and outlines."""
        body = self.decode(unknowns)
        posed = self.landmarks(body.rotations, body.betas, body.transl)
        return self.terms_at_points(unknowns, body, self.loss_points(posed))

    def loss_points(self, posed: Mapping[Skeleton | str, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """Return the points (..., n, 3) that the terms see: keypoints, joints of the body, and
        vertices.
        """
        keypoints = posed[self.skeleton].index_select(-2, self.rows)
        return keypoints, posed["joints"].narrow(-2, 0, NUM_TURNED), posed["vertices"]

    def terms_at_points(
        self, unknowns: Tensor, body: DecodedUnknowns, posed: Sequence[Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Return :meth:`terms` of unknowns (N, W) that are decoded, and whose points are those of
        :meth:`loss_points`.
        """
        points, joints, vertices = posed
        data = self._keypoint_loss(points)
        if self.world is not None:
            data = data + self._landmark_loss(self.world, points, body)
        data = data + self._head_loss(body)
        for prior in self._priors(unknowns, body):
            data = data + prior
        soles, outline = vertices.tensor_split([sum(self.soles)], 1)
        constraints = (
            self._upright_loss(joints, body)
            + self._trunk_loss(joints)
            + self._legs_loss(joints)
            + self._level_loss(soles)
        )
        if self.outlines is not None:
            constraints = constraints + self._outline_loss(self.outlines, outline)
        if self.lifted is not None:
            constraints = constraints + self._lifted_loss(self.lifted, joints)
        return data, constraints

    def _project(self, points: Tensor) -> Tensor:
        """Project points (N, n, 3) to px (N, n, 2)."""
        homogeneous = points @ self.camera.T
        return homogeneous[..., :2] / homogeneous[..., 2:].clamp(min=0.1)

    def _keypoint_loss(self, points: Tensor) -> Tensor:
        """Return the loss (N,) of points (N, J, 3) that do not project onto their keypoints."""
        miss = (self._project(points) - self.points) / self.point_sigma[..., None]
        return (self.weight * 25 * torch.log1p(miss.square().sum(-1) / 25)).sum(1)

    def _landmark_loss(self, world: Tensor, points: Tensor, body: DecodedUnknowns) -> Tensor:
        """Return the loss (N,) of points (N, J, 3) that do not lie as their landmarks do."""
        hips = points[:, self.hips].mean(1, keepdim=True)
        seen = (points - hips) @ self.turn  # rows times the rotation: back into the view's axes
        pitch = body.pitch[:, None] + body.trunk_pitch[:, None] * self.upper
        cos = torch.cos(pitch)
        sin = torch.sin(pitch)
        x, y, z = (world * body.landmark_size[:, None, None]).unbind(-1)
        turned = torch.stack([x, cos * y - sin * z, sin * y + cos * z], -1)
        rest = ((seen - turned) / self.world_sigma).square().sum(-1)
        return (self.world_weight * 9 * torch.log1p(rest / 9)).sum(1)

    def _head_loss(self, body: DecodedUnknowns) -> Tensor:
        """Return the loss (N,) of heads that do not look as their faces do."""
        apart = (head_direction(body.rotations) - self.head).square().sum(1) * self.head_weight
        return _LIMIT**2 * torch.log1p(apart / _LIMIT**2)

    def _priors(self, unknowns: Tensor, body: DecodedUnknowns) -> Iterator[Tensor]:
        """Yield the losses (N,) of pose, shape, stature, landmark size with pitches, and hinges."""
        yield ((body.pose - self.mean) / self.sigma).square().sum((1, 2))
        shape = body.betas - self.adult
        yield _SHAPE_WEIGHT * shape.square().sum(1)
        yield (shape @ self.stature / _STATURE_SIGMA_M).square()
        yield unknowns[:, -3:].square().sum(1)
        for row, axis, sign in hinge_joints():
            bend = sign * body.pose[:, row, axis]
            yield (_HINGE_WEIGHT * torch.relu(-bend)).square()
            yield (_HINGE_WEIGHT * torch.relu(bend - MAX_FLEXION)).square()

    def _pitch(self, line: Tensor) -> Tensor:
        """Return the angles (N,) of lines (N, 3) from the vertical, seen from the side, radians."""
        column = (line[:, None] @ self.turn)[:, 0]
        return torch.atan2(column[:, 2], -column[:, 1]) - self.up_angle

    def _upright_loss(self, joints: Tensor, body: DecodedUnknowns) -> Tensor:
        """Return the loss (N,) of a line from ankles to neck that is not vertical, and of knees
        that bend to make it so.
        """
        angle = self._pitch(joints[:, 12] - joints[:, 7:9].mean(1))
        bent = (body.pose - self.pose)[:, [knee - 1 for knee in _KNEES], 0]  # without the pelvis
        knees = (bent / KNEE_SIGMA).square().sum(1)
        return self.upright * ((angle / UPRIGHT_SIGMA).square() + knees)

    def _trunk_loss(self, joints: Tensor) -> Tensor:
        """Return the loss (N,) of trunks that are not vertical.

        By Welsch's function, a trunk that is bent by more than about twice the limit is not pulled
        at all.
        """
        tilt = self._pitch(joints[:, _SHOULDERS].mean(1) - joints[:, _HIPS].mean(1))
        tilt = torch.atan2(torch.sin(tilt), torch.cos(tilt))
        bent = 1 - torch.exp(-(tilt / _TRUNK_LIMIT).square())
        return self.trunk * ((_TRUNK_LIMIT / _TRUNK_SIGMA) ** 2 * bent)

    def _legs_loss(self, joints: Tensor) -> Tensor:
        """Return the loss (N,) of thighs and shanks that lie as in another posture."""
        hips, knees, ankles = (joints[:, rows] for rows in (_HIPS, _KNEES, _ANKLES))
        thigh = torch.nn.functional.normalize(knees - hips, dim=-1)
        shank = torch.nn.functional.normalize(ankles - knees, dim=-1)
        cosines = torch.stack([-(thigh @ self.up), (thigh * shank).sum(-1)], -1)
        beyond = torch.relu((self.legs[:, None] - cosines) / self.legs_sigma[:, None])
        # A square that starts as a cube, since the Hessian is to have no jumps.
        square = beyond.pow(3) / (beyond + 0.5)
        limit = _LIMIT**2
        return (limit * torch.log1p(square / limit)).sum((1, 2))

    def _level_loss(self, soles: Tensor) -> Tensor:
        """Return the loss (N,) of lowest points of the left and the right sole that differ."""
        heights = (soles @ self.up).tensor_split([self.soles[0]], 1)
        left, right = (
            -torch.logsumexp(-_SMOOTH_MIN_SHARPNESS * h, 1) / _SMOOTH_MIN_SHARPNESS for h in heights
        )  # a smooth minimum
        return self.feet * 8 * torch.log1p(((left - right) / _LEVEL_SIGMA_M).square() / 8)

    def _lifted_loss(self, lifted: LiftedLimbs, joints: Tensor) -> Tensor:
        """Return the loss (N,) of limbs that do not lie as the lifter tells."""
        limbs = joints[:, LIMB_ROWS] - joints[:, _HIPS].mean(1, keepdim=True)
        apart = (limbs @ self.turn - lifted.joints) / _LIFTED_SIGMA_M
        limit = _LIMIT**2
        robust = limit * torch.log1p(apart.square().sum(-1) / limit)
        return (lifted.weight * robust).sum(1)

    def _outline_loss(self, pairs: OutlinePairs, vertices: Tensor) -> Tensor:
        """Return the loss (N,) of bodies that reach outside their masks, and masks outside their
        bodies.

        Each pair has the loss of Geman and McClure (1987), which tends to a constant.
        """
        pixels = self._project(vertices.gather(1, pairs.vertex[..., None].expand(-1, -1, 3)))
        excess = torch.relu((pairs.normal * pixels).sum(-1) - pairs.offset) / _OUTLINE_SIGMA
        # A square that starts as a cube, since the Hessian is to have no jumps.
        square = excess.pow(3) / (excess + 0.5)
        return (pairs.weight * square * _OUTLINE_LIMIT**2 / (_OUTLINE_LIMIT**2 + square)).sum(1)


_LEGS = ("hip", "knee", "ankle", "heel", "foot_tip", "big_toe", "small_toe")
_DUPLICATE_POINTS = ("eye_inner", "eye_outer")  # redundant with the eyes


def fit_problem(
    model: BodyModel,
    observations: BodyObservations,
    start: InitialPose,
    floor: FloorConstraint | None,
) -> FitProblem:
    """Build the least-squares problem of N people; arguments as in
    :func:`physic_embedded.body_fit.fit.fit_bodies`.
    """

    def tensor(array: object) -> Tensor:
        # A copy: torch takes neither read-only arrays nor negative strides.
        return torch.as_tensor(np.array(array, order="C"), dtype=model.dtype)

    skeleton = observations.skeleton
    loss_points = [
        name for name in skeleton.names if not any(twin in name for twin in _DUPLICATE_POINTS)
    ]
    rows = [skeleton.names.index(name) for name in loss_points]
    mean, sigma = pose_prior(tight=observations.world is None)
    arrays = {
        **{name: array[:, rows] for name, array in _keypoint_arrays(observations).items()},
        **_start_arrays(start),
        **_head_arrays(observations),
        **_floor_arrays(observations, floor),
    }
    stature = _stature_per_component(model)
    soles = _sole_vertices(model)
    return FitProblem(
        landmarks=model.landmarks_only([skeleton], torch.cat(soles)),
        skeleton=skeleton,
        rows=torch.as_tensor(rows),
        hips=(loss_points.index("left_hip"), loss_points.index("right_hip")),
        turn=tensor(observations.turn),
        world=None if observations.world is None else tensor(observations.world[:, rows]),
        camera=tensor(observations.intrinsics.matrix),
        mean=tensor(mean),
        sigma=tensor(sigma),
        fingers=rotvec_to_rotmat(tensor(relaxed_finger_pose())),
        soles=(len(soles[0]), len(soles[1])),
        outlines=None,
        lifted=None,
        upper=tensor([not any(part in name for part in _LEGS) for name in loss_points]),
        stature=stature,
        adult=mean_adult_betas(float(model.stature(torch.zeros_like(stature)[None])), stature),
        **{name: tensor(array) for name, array in arrays.items()},
    )


def _keypoint_arrays(observations: BodyObservations) -> dict[str, FloatArray]:
    """Return the fields of :class:`FitProblem` that have a value for each of J keypoints."""
    shape = observations.weight.shape
    point_sigma = np.broadcast_to(_KEYPOINT_SIGMA * observations.size[:, None], shape)
    world_sigma = np.broadcast_to(_WORLD_SIGMA_M, (*shape, 3))
    if observations.sigma is not None:
        pixels = observations.size[:, None] / SIZE_STATURE_M
        point_sigma = np.hypot(observations.sigma, _JOINT_SIGMA_M * pixels)
    if observations.depth_sigma is not None:  # then right and down are those of the points
        depth = np.hypot(observations.depth_sigma, _JOINT_SIGMA_M)
        world_sigma = np.stack([np.full(shape, np.inf), np.full(shape, np.inf), depth], -1)
    return {
        "points": observations.points,
        "weight": observations.weight,
        "world_weight": observations.world_weight,
        "point_sigma": point_sigma,
        "world_sigma": world_sigma,
    }


def _head_arrays(observations: BodyObservations) -> dict[str, FloatArray]:
    """Return the fields of :class:`FitProblem` of the heads, zero without a face."""
    return {
        "head": np.nan_to_num(observations.head),
        "head_weight": np.nan_to_num(observations.head_sigma**-2.0),
    }


def _start_arrays(start: InitialPose) -> dict[str, FloatArray]:
    """Return the fields of :class:`FitProblem` that an initial pose sets."""
    z = start.transl[:, 2:]
    return {
        "root": start.root,
        "pose": start.pose,
        "log_z": np.log(z),
        "side": start.transl[:, :2] / z,
    }


def _floor_arrays(
    observations: BodyObservations, floor: FloorConstraint | None
) -> dict[str, BoolArray | FloatArray]:
    """Return the fields of :class:`FitProblem` that a floor sets, zero without one."""
    if floor is None:
        names = ("up_angle", "feet", "upright", "trunk", "pitch")
        people = len(observations.points)
        return {
            "up": np.zeros(3),
            "legs": np.zeros((people, 2)),
            "legs_sigma": np.full((people, 2), np.inf),
            **dict.fromkeys(names, np.zeros(people)),
        }
    up = np.asarray(floor.up, np.float64)
    seen_up = np.einsum("nij,i->nj", observations.turn, up)
    ankles = observations.confidence[:, sided_indices(observations.skeleton, "ankle")].min(1)
    return {
        "up": up,
        "up_angle": np.arctan2(seen_up[:, 2], -seen_up[:, 1]),
        # The picture decides whether both feet stand: a raised foot looks like one that is farther
        # away.
        "feet": (ankles > SURE_CONFIDENCE) * floor.trunk * observations.touch.prod(1),
        "upright": floor.upright,
        "trunk": floor.trunk,
        "pitch": floor.pitch,
        "legs": floor.legs.cosine,
        "legs_sigma": floor.legs.sigma,
    }


def with_outlines(
    problem: FitProblem, pairs: OutlinePairs, lifted: LiftedLimbs | None
) -> FitProblem:
    """Return a problem of N people to which pairs of points on the outlines of bodies and masks are
    added, and what the lifter tells.
    """
    model = problem.landmarks.body
    vertex_ids = torch.cat([*_sole_vertices(model), pairs.vertex_ids])
    landmarks = model.landmarks_only([problem.skeleton], vertex_ids)
    return replace(problem, landmarks=landmarks, outlines=pairs, lifted=lifted)


_SOLE_STRIDE = 4  # every fourth vertex of a sole is enough to find its lowest point


def _sole_vertices(model: BodyModel) -> list[Tensor]:
    """Return the vertices that stand for the left and the right sole, int64."""
    return [model.contact_sets[f"{side}_sole"][::_SOLE_STRIDE] for side in ("left", "right")]


def _stature_per_component(model: BodyModel) -> Tensor:
    """Return the stature (K,) in metres that one unit of each shape component adds."""
    with torch.no_grad():
        units = torch.eye(model.num_betas, dtype=model.dtype)
        return (model.stature(units) - model.stature(-units)) / 2
