"""A problem and what the authors' published optimiser made of it, read from one file of numbers, as
our own types.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import torch

from physic_core.body.joints import PART_NAMES
from physic_core.body.landmarks import LandmarkRegressor
from physic_core.body.model import BodyArrays, build_body_model, derive_vertex_sets
from physic_core.engine.scene_state import SceneState
from physic_core.engine.state import State
from physic_core.geometry.camera import pixel_grid, unproject
from physic_core.geometry.floor import PlaneFit
from physic_core.types import (
    SKELETONS,
    Skeleton,
)
from physic_paper.released.pointmap import published_normals

_WHOLE = SKELETONS["coco_wholebody133"]
SKELETON = Skeleton(
    "wholebody131", tuple(name for name in _WHOLE.names if not name.endswith("hand_root"))
)
"""COCO-WholeBody without the roots of both hands, which no body has."""

JOINT_SETS = {
    SKELETON: [j for j in range(133) if j not in (91, 112)],
    SKELETONS["coco23"]: list(range(23)),
    _WHOLE.take(_WHOLE.fitted): list(_WHOLE.fitted),
}
"""Skeleton -> which of the 133 keypoints it has."""

_LIMBS = ("upper_arm", "lower_arm", "hand", "upper_leg", "lower_leg", "foot")
_INVALID_DEPTH = 65535


class Published:
    """The file.

    Args:
        path: of ``problem_one.npz``.
    """

    def __init__(self, path):
        with np.load(path) as file:
            self.arrays = {name: file[name] for name in file.files}

    def __getitem__(self, name):
        return torch.from_numpy(np.array(self.arrays[name]))

    def bits(self, name, shape=None):
        """A stored array of booleans; those without a stored shape fill the picture, or
        ``shape``.
        """
        packed = f"{name}__bits" if f"{name}__bits" in self.arrays else name
        if f"{name}__shape" in self.arrays:
            shape = tuple(self.arrays[f"{name}__shape"].tolist())
        shape = shape or self.size
        flat = np.unpackbits(self.arrays[packed])[: int(np.prod(shape))]
        return torch.from_numpy(flat.astype(bool).reshape(shape))

    @cached_property
    def size(self):
        """Height and width, px."""
        width, height = self.arrays["camera/size_wh"].tolist()
        return height, width

    # Inputs

    def points(self, name="one/in/scene_depth_u16"):
        """(H, W, 3) of a depth map, infinite where it is not valid."""
        count = self.arrays[name].astype(np.float64)
        depth = torch.from_numpy(
            np.where(count == _INVALID_DEPTH, np.inf, count * self.arrays["camera/depth_unit"])
        )
        points = unproject(pixel_grid(*self.size, depth), depth, self["camera/K"].double()).float()
        return torch.where(torch.isfinite(depth)[..., None], points, torch.inf)

    @cached_property
    def scene(self):
        """What is left of the scene."""
        kept = self.bits("one/out/pre/inlier")
        points = self.points()
        normals = published_normals(points, torch.isfinite(points).all(-1))
        plane = self["one/out/pre/plane"]
        return SceneState(
            points=points,
            normals=normals,
            valid=kept,
            floor_points=self.floor,
            K=self["camera/K"].double(),
            floor=PlaneFit(plane[:3], float(plane[3]), kept, 1.0, 0.0, "floor mask"),
        )

    @cached_property
    def floor(self):
        """(10000, 3) of which every ninth along both axes is stored."""
        plane = self["one/out/pre/plane"].double()
        grid = self["one/out/pre/plane_grid"].double()
        x, z = (_ninefold(line) for line in (grid[:, 0, 0], grid[0, :, 2]))
        x, z = (line.flatten() for line in torch.meshgrid(x, z, indexing="ij"))
        y = -(plane[0] * x + plane[2] * z + plane[3]) / plane[1]
        return torch.stack([x, y, z], -1).float()

    def human_map(self):
        """(H, W, 3) of the photo with its person."""
        points = self.points()
        person = self.bits("one/in/person_pixel")
        depth = self["one/in/person_depth_u16"].double() * float(self.arrays["camera/depth_unit"])
        uv = pixel_grid(*self.size, depth)[person]
        points[person] = unproject(uv, depth, self["camera/K"].double()).float()
        return points

    @cached_property
    def human_points(self):
        """(M, 3) that are left of the person's."""
        person = self.human_map()[self.bits("one/in/person_pixel")]
        return person[self.bits("one/out/pre/person0_inlier", (len(person),))]

    def given(self, whose):
        """Rotations (1, 55, 3, 3), betas and translation of "init" or "truth"."""
        rotations = torch.eye(3).repeat(1, 55, 1, 1)
        for part, rows in _ROWS.items():
            rotations[:, rows] = self[f"one/in/{whose}/{part}_rotmat"].reshape(1, -1, 3, 3)
        return rotations, self[f"one/in/{whose}/betas"], self[f"one/in/{whose}/transl"]

    # States of the optimiser

    def raw(self, tag):
        """Parameters of a state, as ``Variables`` of stage 3 has them when raw."""
        return self._by_group(f"one/out/{tag}/param")

    def gradients(self, tag, term):
        """Of an unweighted term, by the same groups."""
        return self._by_group(f"one/out/{tag}/grad/{term}")

    def _by_group(self, folder):
        part = {name: _columns(self[f"{folder}/{name}_rot6d"]) for name in _ROWS}
        return {
            "root": part["root"],
            "pose": part["body"],
            "hands": torch.cat([part["lhand"], part["rhand"]], 1),
            "betas": self[f"{folder}/betas"],
            "translation": self[f"{folder}/transl"],
            "scale": self[f"{folder}/scale"],
        }

    def rotations(self, tag):
        """(1, 55, 3, 3) of a state."""
        import roma  # which imports torch._dynamo, for longer than a second

        raw = self.raw(tag)
        rotations = torch.eye(3).repeat(1, 55, 1, 1)
        for group, rows in (
            ("root", slice(0, 1)),
            ("pose", slice(1, 22)),
            ("hands", slice(25, 55)),
        ):
            rotations[:, rows] = roma.special_gramschmidt(raw[group]).reshape(1, -1, 3, 3)
        return rotations

    def state(self, start="s3_start", skeleton=SKELETON):
        """Return the state before stage 3.

        Args:
            start: state whose translation it starts from, and whose head decides where the face's
                contour is.
            skeleton: joint set of the keypoints.
        """
        rotations, betas, estimated = self.given("init")
        rows = JOINT_SETS[skeleton]
        return State(
            model=self.body(self.rotations(start)[0]),
            rotations=rotations,
            betas=betas,
            expression=torch.zeros(1, 0),
            transl=self[f"one/out/{start}/param/transl"],
            keypoints=self["one/in/keypoints"][:, rows],
            keypoint_confidence=self["one/in/keypoint_conf"][:, rows],
            skeleton=skeleton,
            K=self["camera/K"],
            masks=self.bits("one/in/person_pixel")[None],
            scene=self.scene,
            contact_prior=self["one/in/contact_prob"],
            observed=torch.ones(1, 55, dtype=torch.bool),
            human_points=(self.human_points,),
            estimated_transl=estimated,
            keypoint_transl=self["one/out/s1_end/param/transl"],
        )

    # The body

    def body(self, rotations):
        """The body, with its face's contour as rotations (55, 3, 3) turn the head."""
        everything = self._points133(rotations)
        regressors = {
            kind: replace(everything, matrix=everything.matrix[rows])
            for kind, rows in JOINT_SETS.items()
        }
        return replace(self._body, regressors=regressors)

    @cached_property
    def _body(self):
        a = self.arrays
        posedirs = a["body/posedirs_i8"].astype(np.float32) * a["body/posedirs_unit"]
        regressor = a["body/J_regressor"].astype(np.float64)
        shapedirs = a["body/shapedirs"]
        arrays = BodyArrays(
            name="smplx",
            topology="published",
            template=a["body/v_template"],
            directions=np.concatenate([shapedirs, posedirs], 2).transpose(2, 0, 1),
            joint_template=regressor @ a["body/v_template"],
            joint_directions=np.einsum("jv,vck->kjc", regressor, shapedirs),
            bind_rot=None,
            weights=a["body/weights"],
            faces=a["body/faces"].astype(np.int64),
            num_betas=shapedirs.shape[2],
            num_expression=0,
            outer=np.ones(len(a["body/v_template"]), bool),
        )
        names = ["torso", *(f"{side}_{limb}" for side in ("left", "right") for limb in _LIMBS)]
        part = np.array([PART_NAMES.index(name) for name in names])[
            a["body/part12"].astype(np.int64) + 1
        ]
        picks = replace(derive_vertex_sets(arrays), part_of_vertex=part)
        return build_body_model(replace(arrays, picks=picks))

    def _points133(self, rotations):
        """The 133 points; the two that no body has are its pelvis."""
        a = self.arrays
        faces = a["body/faces"]
        row = contour_row(rotations)
        corners = [
            *a["body/extra_joint_vertex"][:, None],
            *faces[a["body/lmk_faces_idx"]],
            *faces[a["body/dyn_lmk_faces_idx"][row]],
        ]
        shares = [*np.ones((21, 1), np.float32), *a["body/lmk_bary"], *a["body/dyn_lmk_bary"][row]]
        ids = torch.from_numpy(np.concatenate(corners).astype(np.int64))
        points = torch.eye(144, 55 + len(ids))
        column = 55
        for i, share in enumerate(shares):
            points[55 + i] = 0.0
            points[55 + i, column : column + len(share)] = torch.from_numpy(share)
            column += len(share)
        matrix = points[:1].repeat(133, 1)
        matrix[self.bits("unit/coco/used")] = points[self["unit/coco/joint_index"].long()]
        return LandmarkRegressor(ids, matrix)


_ROWS = {"root": slice(0, 1), "body": slice(1, 22), "lhand": slice(25, 40), "rhand": slice(40, 55)}


def contour_row(rotations):
    """Which of 79 rows the face's contour takes: whole degrees of the head's yaw, 0 to 39, then -1
    to -39.
    """
    turn = torch.eye(3)
    for joint in (12, 9, 6, 3, 0):
        turn = rotations[joint] @ turn
    yaw = torch.atan2(-turn[2, 0], torch.hypot(turn[0, 0], turn[1, 0]))
    degrees = int(torch.round(-yaw.rad2deg()).clamp(-39, 39))
    return degrees if degrees >= 0 else 39 - degrees


def _ninefold(line):
    """(n,) every ninth of evenly spaced numbers -> all of them."""
    return torch.from_numpy(np.linspace(float(line[0]), float(line[-1]), 9 * (len(line) - 1) + 1))


def _columns(six):
    """(..., 6) as stored -> (..., 3, 2), the first two columns of the rotation."""
    return six.reshape(*six.shape[:-1], 2, 3).transpose(-1, -2)
