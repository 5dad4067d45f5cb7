"""Bodies of other models, contact on other meshes and hands with wrists: right ones, and for each
check a wrong one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import torch
from faults import fields, with_world
from right_backends import RightBodies, RightContact, RightHands, RightKeypoints
from wrong_backends import altered

from physic_core.body import load_body
from physic_core.body.bones import rotations_from_parameters, rotations_from_tpose
from physic_core.body.convert.bodies import rest_mesh_of_model
from physic_core.geometry.rotations import rotmat_to_rotvec
from physic_core.types import Bodies, ContactProbability, Mesh, RestMesh
from physic_mock.recognition import match_masks_to_world, recognise_world


@lru_cache(maxsize=1)
def shuffled():
    """The embedded body's mesh with another name and order of vertices, and the old number of
    each.
    """
    rest = rest_mesh_of_model(load_body("embedded"))
    order = np.random.default_rng(0).permutation(len(rest.vertices))
    return RestMesh("shuffled", rest.vertices[order], np.argsort(order)[rest.faces]), order


class OtherBodies(RightBodies):
    """SMPL's parameters with 24 joints, as a network gives them that was trained on SMPL."""

    def infer(self, image, people, intrinsics, keypoints, hints):
        correct = super().infer(image, people, intrinsics, keypoints, hints)
        p = replace(correct.parameters, betas=np.zeros((len(correct.parameters), 10), np.float32))
        with torch.no_grad():
            given = (
                torch.from_numpy(v) for v in (correct.parameters.betas, correct.parameters.transl)
            )
            out = load_body("embedded")(rotations_from_parameters(correct.parameters), *given)
        joints = out.joints.numpy().copy()
        joints[:, 22:] = np.nan
        return Bodies(p, "smpl", correct.observed, joints, self.mesh(out.vertices.numpy()))

    def mesh(self, vertices):
        return None


class SurfaceBodies(OtherBodies):
    """With a surface on a mesh of its own."""

    def mesh(self, vertices):
        rest, order = shuffled()
        return Mesh("shuffled", vertices[:, order], rest.faces, rest.vertices)


class OtherContact(RightContact):
    def infer(self, image, people, bodies):
        rest, order = shuffled()
        correct = super().infer(image, people, bodies)
        return ContactProbability(correct.probability[:, order], "shuffled", rest)


class WristHands(RightHands):
    def infer(self, image, people, keypoints):
        found = recognise_world(image)
        world = rotations_from_tpose(
            rotations_from_parameters(found.world.parameters).double().numpy()
        )
        correct = super().infer(image, people, keypoints)
        return replace(
            correct,
            wrists=rotmat_to_rotvec(world[:, [20, 21]]).astype(np.float32)[
                match_masks_to_world(found, people)
            ],
        )


class WorldKeypoints(RightKeypoints):
    def infer(self, image, people):
        return with_world(super().infer(image, people), image, people, right=1)


RIGHT = (OtherBodies, SurfaceBodies, OtherContact, WristHands, WorldKeypoints)


def hipless(joints):
    return np.where(np.arange(joints.shape[1])[:, None] == 1, np.nan, joints)


WRISTS = "wrists_are_in_the_cameras_frame"
MILLIMETRES = fields(vertices=lambda vertices: 1000 * vertices)
altered(OtherBodies, "joints without hips", "bodies_can_be_posed", fields(joints=hipless))
altered(
    OtherBodies,
    "joints about the pelvis",
    "bodies_are_in_front",
    fields(joints=lambda joints: joints - joints[:, :1]),
)
altered(SurfaceBodies, "a surface in millimetres", "bodies_can_be_posed", fields(mesh=MILLIMETRES))
altered(OtherContact, "a T-pose in millimetres", "mesh_is_known", fields(rest=MILLIMETRES))
# of the body's own pose
altered(
    WristHands,
    "wrists against the forearm",
    WRISTS,
    fields(wrists=lambda wrists: 0.1 * np.ones_like(wrists)),
)
altered(WristHands, "wrists exchanged", WRISTS, fields(wrists=lambda w: w[:, ::-1].copy()))
