"""What a camera sees of meshes and depths."""

from __future__ import annotations

import numpy as np
import torch

from physic_core.engine.ground.floor import FloorEvidence
from physic_core.engine.photo_content import PhotoContent
from physic_core.geometry.camera import pixel_rays
from physic_core.geometry.rays import RayCaster
from physic_core.types import Keypoints, Observations, People, Pointmap
from physic_core.types.known_sizes import KnownPeople


def rays_of(camera):
    """Return the direction (H, W, 3) of the ray through each pixel, with z = 1."""
    return pixel_rays(camera.height, camera.width, torch.from_numpy(camera.matrix)).numpy()


def seen(vertices, faces, camera):
    """Return the depth (H, W) of a mesh, inf where no ray meets it, and the face that is met."""
    hits = RayCaster(vertices, faces).first(np.zeros(3), rays_of(camera).reshape(-1, 3))
    size = camera.height, camera.width
    return hits.distance.reshape(size), hits.face.reshape(size)


def pointmap_of(depth, camera, unknown="inverse_scale_shift", **known):
    """Return the point map of a depth (H, W), valid where it is finite."""
    points = np.float32(rays_of(camera) * depth[..., None])
    return Pointmap(points, np.isfinite(depth), unknown, camera, **known)


def evidence_of(shape, **given):
    """Return evidence of a photo (H, W) about its floor, of which nothing else is known."""
    nowhere = torch.zeros(shape, dtype=torch.bool)
    nothing = dict.fromkeys(("hole", "ground", "no_ground"), nowhere)
    return FloorEvidence(**({"feet_px": torch.zeros(0, 2)} | nothing | given))


def photo_of(model, posed, depth, camera, unit=1.0, skeleton="coco17"):
    """Return what a photo shows of bodies before a scene of a depth (H, W) m, of which nothing is
    observed; its point maps are in units of so many metres.
    """
    people = np.array([seen(body, model.faces, camera)[0] for body in posed.vertices.double()])
    masks = np.isfinite(people)
    both = depth
    for body, mask in zip(people, masks, strict=True):
        both = np.where(mask, body, both)
    pixels = model.landmarks(posed, skeleton).double().numpy() @ camera.matrix.T
    points = np.float32(pixels[..., :2] / pixels[..., 2:])
    scene, photo = (pointmap_of(z / unit, camera, people_farther=(0.0, 0.1)) for z in (depth, both))
    return PhotoContent(
        people=People(masks, np.zeros((len(masks), 4)), np.ones(len(masks))),
        keypoints=Keypoints(points, np.ones(points.shape[:2], np.float32), skeleton),
        observations=Observations.unknown(len(masks)),
        known=KnownPeople(),
        camera=camera,
        hole=torch.from_numpy(masks.any(0)),
        scene_map=scene,
        photo_map=photo,
        aligned_map=photo,
    )
