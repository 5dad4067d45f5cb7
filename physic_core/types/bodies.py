"""Body model parameters, meshes, hand poses and contact probabilities of people."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

from physic_core.types.arrays import PER_PERSON, shape
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.types.arrays import BoolArray, FloatArray, IntArray


FINGERS = ("index", "middle", "pinky", "ring", "thumb")
"""Fingers in the order of SMPL-X."""

JOINT_NAMES: tuple[str, ...] = (
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "jaw",
    "left_eye",
    "right_eye",
    *(f"{side}_{finger}{k}" for side in SIDES for finger in FINGERS for k in (1, 2, 3)),
)
"""0-21 body, 22 jaw, 23-24 eyes, 25-39 left hand, 40-54 right hand (index, middle, pinky, ring,
thumb; base first).
"""

JOINT_INDEX: dict[str, int] = {name: i for i, name in enumerate(JOINT_NAMES)}


@dataclass(frozen=True)
class BodyParameters(ShortRepr):
    """Parameters of N bodies with SMPL-X names: rotation vectors in SMPL-X joint order, flat hand
    mean, no hand PCA.

    Attributes:
        global_orient: (N, 3) rotation about the pelvis joint.
        body_pose: (N, 63) joints 1 to 21.
        left_hand_pose: (N, 45) index, middle, pinky, ring, thumb.
        right_hand_pose: (N, 45) the same of the right hand.
        jaw_pose: (N, 3) rotation of the jaw.
        leye_pose: (N, 3) rotation of the left eye.
        reye_pose: (N, 3) rotation of the right eye.
        betas: (N, K) shape components of unit variance, which differ between body models.
        expression: (N, E), E = 0 where the body has none.
        transl: (N, 3) meters, added after posing.
    """

    global_orient: FloatArray = field(metadata=shape("N", 3))
    body_pose: FloatArray = field(metadata=shape("N", 63))
    left_hand_pose: FloatArray = field(metadata=shape("N", 45))
    right_hand_pose: FloatArray = field(metadata=shape("N", 45))
    jaw_pose: FloatArray = field(metadata=shape("N", 3))
    leye_pose: FloatArray = field(metadata=shape("N", 3))
    reye_pose: FloatArray = field(metadata=shape("N", 3))
    betas: FloatArray = field(metadata=shape("N", "K"))
    expression: FloatArray = field(metadata=shape("N", "E"))
    transl: FloatArray = field(metadata=shape("N", 3))

    def __len__(self) -> int:
        return len(self.transl)

    def __getitem__(self, rows: slice | BoolArray | IntArray) -> BodyParameters:
        """Select people by a slice, a mask (N,) or indices."""
        return BodyParameters(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


@dataclass(frozen=True)
class Mesh(ShortRepr):
    """Vertices and common faces of N body meshes.

    Attributes:
        name: of the topology ("smplx", "smpl", "mhr").
        vertices: (N, V, 3) meters, camera frame.
        faces: (F, 3) int, the same for all.
        rest: (V, 3) meters, a body of this topology in the T-pose (y up, facing +z, its left on
            +x), of any shape, or None. It gives the correspondence between the vertices of this
            topology and those of another.
    """

    name: str
    vertices: FloatArray = field(metadata=shape("N", "V", 3))
    faces: IntArray = field(metadata=shape("F", 3))
    rest: FloatArray | None = field(default=None, metadata=shape("V", 3))


@dataclass(frozen=True)
class RestMesh(ShortRepr):
    """Mesh of one body in the T-pose: y up, facing +z, left side towards +x, palms down.

    Attributes:
        topology: name of the mesh ("smpl", "smplx").
        vertices: (V, 3) meters.
        faces: (F, 3) int.
    """

    topology: str
    vertices: FloatArray = field(metadata=shape("V", 3))
    faces: IntArray = field(metadata=shape("F", 3))


@dataclass(frozen=True)
class Bodies(ShortRepr):
    """Result of a BodyEstimator: parameters of N bodies, optionally joints and meshes.

    Bodies of another model than the configured one are converted to it from ``joints``, and from
    ``mesh`` if given. Rotations are used if the model is "embedded", "smplx" or "smpl" (joints 0-21
    as SMPL's, hands zero), which share the T-pose. Any other model may leave rotations and shape
    zero, and must give joints or a mesh.

    Attributes:
        parameters: of N bodies, body i of person i, meters, camera frame.
        body_model: name of the body model that the parameters are for ("embedded", "smplx", "smpl",
            "mhr").
        observed: (N, 55) bool, joints that the photo shows, or None if the backend does not report
            it.
        joints: (N, 55, 3) meters, camera frame: the SMPL-X joints as the backend places them, NaN
            where unknown. None if the parameters alone define them.
        mesh: the surfaces, or None.
        rotation_sigma: (N, 22) radians, standard deviation of the angle of error of
            ``global_orient`` and of each rotation in ``body_pose``; NaN where unknown. None if the
            backend does not state it. The smaller it is, the less the engine bends what the photo
            shows of the body.
        lean_sigma: (N,) radians, standard deviation of the lean towards the camera of people whom
            the backend has set upright on the floor of its hints; NaN for others. The lean is that
            of the line from ankles to neck, seen from the side. The error of the floor is not a
            part of it. None if the backend sets no person upright.
        joint_sigma: (N, 55) meters, root mean square distance of each joint from the true one, both
            relative to the middle of the hips; NaN where unknown. None if the backend does not
            state it.
        distance_sigma: (N,) standard deviation of the logarithm of the distance of bodies that the
            user gives, inf if nothing is known of it; NaN for estimated bodies. Given ones are not
            moved to fit keypoints and depth before all is optimized. None without any.
    """

    parameters: BodyParameters = field(metadata=PER_PERSON)
    body_model: str
    observed: BoolArray | None = field(default=None, metadata=shape("N", 55))
    joints: FloatArray | None = field(default=None, metadata=shape("N", 55, 3))
    mesh: Mesh | None = field(default=None, metadata=PER_PERSON)
    rotation_sigma: FloatArray | None = field(default=None, metadata=shape("N", 22))
    lean_sigma: FloatArray | None = field(default=None, metadata=shape("N"))
    joint_sigma: FloatArray | None = field(default=None, metadata=shape("N", 55))
    distance_sigma: FloatArray | None = field(default=None, metadata=shape("N"))


@dataclass(frozen=True)
class Hands(ShortRepr):
    """Result of a HandEstimator: joint rotations of both hands of N people.

    Attributes:
        rotvecs: (N, 2, 15, 3) radians, left then right, SMPL-X order, flat hand mean.
        confidence: (N, 2) in [0, 1]; 0 where no hand was found (its rotations are then ignored).
        wrists: (N, 2, 3) radians, global rotation of each hand from the T-pose to the camera frame
            (not relative to the forearm), left then right, or None. The forearm is then rotated to
            fit the hand.
    """

    rotvecs: FloatArray = field(metadata=shape("N", 2, 15, 3))
    confidence: FloatArray = field(metadata=shape("N", 2))
    wrists: FloatArray | None = field(default=None, metadata=shape("N", 2, 3))


@dataclass(frozen=True)
class ContactProbability(ShortRepr):
    """Result of a ContactPrior: contact probability of each vertex of N bodies.

    Attributes:
        probability: (N, V) in [0, 1], how likely each vertex touches the scene.
        topology: name of the mesh that has the V vertices.
        rest: that mesh in the T-pose. Required if it is not the bodies' own mesh, and used to
            transfer the probabilities to it.
    """

    probability: FloatArray = field(metadata=shape("N", "V"))
    topology: str
    rest: RestMesh | None = None
