"""A second body: the embedded one in another mesh, with its joints elsewhere, another rest posture
and shape space.

What SMPL-X and SMPL are to the embedded body: the same human surface, other conventions; no number
is anybody's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.sparse import coo_matrix, csr_matrix

from physic_core.body import JOINT_INDEX, JOINT_NAMES, PARENTS
from physic_core.body.bones import pose_from_parameters
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_core.geometry.tensors import exact_arrays

SHIFTS_MM = {
    "pelvis": (0, 30, 0),
    "hip": (-45, -20, 10),
    "knee": (-10, 10, 0),
    "ankle": (0, -10, -20),
    "foot": (0, -10, -20),
    "spine1": (0, 20, -10),
    "spine2": (0, 30, 20),
    "spine3": (0, -30, 0),
    "neck": (0, -20, -30),
    "head": (0, 20, -20),
    "collar": (30, -20, -30),
    "shoulder": (-10, 10, -20),
    "elbow": (0, 0, -10),
    "wrist": (-5, 0, 0),
    "jaw": (0, -10, -20),
}
REST_TURNS_DEG = {"shoulder": (0, 0, -4), "hip": (0, 0, 3), "elbow": (0, -3, 0)}


@dataclass(frozen=True)
class OtherBody:
    """Vertices before coordinates, metres.

    Attributes:
        template: (V, 3) T-pose.
        faces: (F, 3).
        shapedirs: (V, 3, 10).
        weights: (V, 55).
        regressor: (55, V).
        from_embedded: (V, V of the embedded body), rows sum to 1: which of its vertices each one
            is.
    """

    template: np.ndarray
    faces: np.ndarray
    shapedirs: np.ndarray
    weights: np.ndarray
    regressor: np.ndarray
    from_embedded: csr_matrix


def make(embedded, vertices):
    """The body with so many vertices."""
    rng = np.random.default_rng(3)
    rotvecs = torch.zeros(1, 55, 3)
    for name, turn in REST_TURNS_DEG.items():
        for side, sign in (("left", 1), ("right", -1)):
            x, y, z = turn
            rotvecs[0, JOINT_INDEX[f"{side}_{name}"]] = torch.deg2rad(
                torch.tensor([x, sign * y, sign * z]).float()
            )
    rotations = rotvec_to_rotmat(rotvecs)
    shapes = torch.cat([torch.zeros(1, embedded.num_betas), torch.eye(embedded.num_betas)])
    out = embedded(rotations.repeat(len(shapes), 1, 1, 1), shapes, torch.zeros(len(shapes), 3))
    posed = out.vertices.double().numpy()
    joints = out.joints[0].double().numpy()
    gather, faces = coarser(posed[0], embedded.faces.numpy(), vertices)
    mix = np.linalg.qr(rng.standard_normal((10, 10)))[0]
    directions = np.einsum("kvi,kl->vil", (posed[1:] - posed[0])[:10], mix)
    template = gather @ posed[0]
    shapedirs = (gather @ directions.reshape(len(posed[0]), -1)).reshape(vertices, 3, 10)
    weights = gather @ embedded.skin.weights.T.double().numpy()
    wanted = joints.copy()
    for joint, name in enumerate(JOINT_NAMES):
        side = -1.0 if name.startswith("right_") else 1.0
        wanted[joint] += (
            1e-3 * np.array(SHIFTS_MM.get(name.split("_")[-1], (0, 0, 0))) * [side, 1, 1]
        )
    return OtherBody(
        template, faces, shapedirs, weights, regressor(template, weights, wanted), gather
    )


def regressor(template, weights, joints):
    """(55, V), rows that sum to 1 and give the joints: as even as possible over the vertices round
    each.
    """
    rows = np.zeros((len(joints), len(template)))
    for joint, place in enumerate(joints):
        own = weights[:, joint] + weights[:, max(PARENTS[joint], 0)]
        near = np.argsort(np.linalg.norm(template - place, axis=1) - 0.02 * own)[:400]
        system = np.concatenate([template[near].T, np.ones((1, len(near)))])
        even = np.full(len(near), 1 / len(near))
        rows[joint, near] = even + np.linalg.pinv(system) @ (np.append(place, 1.0) - system @ even)
    return rows


def coarser(vertices, faces, count):
    """A closed mesh with ``count`` vertices, by collapsing short edges: the rows that mix its
    vertices, and faces.
    """
    gather = csr_matrix((np.ones(len(vertices)), (np.arange(len(vertices)),) * 2))
    while len(vertices) > count:
        pairs = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        edges = np.unique(np.sort(pairs, 1), axis=0)
        rings = [set() for _ in vertices]
        for a, b in edges.tolist():
            rings[a].add(b)
            rings[b].add(a)
        lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
        onto = np.arange(len(vertices))
        taken = set()
        left = len(vertices) - count
        for a, b in edges[np.argsort(lengths, kind="stable")[: len(edges) // 2]].tolist():
            if not left:
                break
            ring = rings[a] | rings[b]
            if not taken.isdisjoint(ring) or len(rings[a] & rings[b]) != 2:
                continue
            taken |= ring
            onto[b], left = a, left - 1
        kept, compact = np.unique(onto, return_inverse=True)
        ones = np.ones(len(onto))
        mix = coo_matrix((ones, (compact, np.arange(len(onto)))), (len(kept), len(onto))).tocsr()
        mix = mix.multiply(1 / mix.sum(1)).tocsr()
        gather = mix @ gather
        vertices = mix @ vertices
        faces = compact[faces]
        faces = faces[(np.diff(np.sort(faces, 1), axis=1) > 0).all(1)]
    return gather, faces


def smplx_file_arrays(body):
    """A body of 10475 vertices as a SMPL-X file, v1.0, without pose correctives."""
    fewer = np.concatenate([body.shapedirs, np.zeros_like(body.shapedirs)], 2)
    return {
        "v_template": body.template,
        "f": body.faces[:20908].astype(np.uint32),
        "shapedirs": fewer,
        "posedirs": np.zeros((len(body.template), 3, 486), np.float16),
        "J_regressor": body.regressor,
        "weights": body.weights,
        "kintree_table": np.stack([PARENTS, np.arange(55)]).astype(np.uint32),
    }


def smpl_file_arrays(body):
    """A body of 6890 vertices as a SMPL file: 24 joints, the last two the hands, which hold the
    fingers' weight.
    """
    parents = np.array([*PARENTS[:22], 20, 21])
    weights = np.zeros((len(body.template), 24))
    weights[:, :22] = body.weights[:, :22]
    weights[:, 15] += body.weights[:, 22:25].sum(1)
    weights[:, 22] = body.weights[:, 25:40].sum(1)
    weights[:, 23] = body.weights[:, 40:].sum(1)
    hands = [JOINT_INDEX["left_middle1"], JOINT_INDEX["right_middle1"]]
    return {
        "v_template": body.template,
        "f": body.faces.astype(np.uint32),
        "shapedirs": body.shapedirs,
        "posedirs": np.zeros((len(body.template), 3, 207), np.float16),
        "J_regressor": body.regressor[[*range(22), *hands]],
        "weights": weights,
        "kintree_table": np.stack([parents, np.arange(24)]).astype(np.uint32),
    }


def posed(model, parameters):
    """Vertices and joints of bodies, by the model itself, float64."""
    out = model(*pose_from_parameters(parameters, dtype=model.dtype))
    return exact_arrays(out.vertices, out.joints)


def mm(first, second):
    """Mean distance of points, given in metres."""
    return 1000 * float(np.linalg.norm(first - second, axis=-1).mean())
