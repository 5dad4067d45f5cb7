"""Estimate bodies in metres for any camera with NLF (Sarandi and Pons-Moll 2024), from one
TorchScript file.

The people's boxes are given to the network, so that the detector inside the file, which has its own
licence and needs CUDA, is never called.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.adapters.bodies import (
    SeenConfidence,
    bodies_from_smpl,
    empty_bodies,
    observed_joints,
    parameters_from_rotvecs,
)
from physic_core.adapters.networks import TorchBackend, open_torchscript, to_numpy
from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator, Options, Packages, Requirement
from physic_core.types import Bodies, Mesh

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray, Hints, Intrinsics, Keypoints, People, UInt8Array

_LOG = logging.getLogger(__name__)
_METHODS = ("estimate_parametric_batched", "estimate_smpl_batched")
_MM = 1000.0
_PELVIS_REACH_M = 0.8
"""Largest distance from a body's origin to its pelvis, metres."""
_WORST_MM = 5.0
_EXPRESSION = 10


class NlfOptions(Options):
    """Settings of NLF."""

    weights: str = Field(
        default="nlf-l",
        description="a name of `physic weights list`, or the path of a .torchscript file of your "
        "own",
    )
    body: Literal["smplx", "smpl"] = Field(
        default="smplx", description="body model that is fitted to its points"
    )
    smplx_file: str = Field(
        default="",
        description="your SMPLX_NEUTRAL.npz, where body is smplx: gives the exact place, the "
        "surface, and checks that "
        "NLF means the same body",
    )
    beta_regularizer: float = Field(
        default=10.0,
        ge=0,
        le=1e6,
        description="pull of the shape to the mean body; 10 is NLF's own and leaves little of "
        "betas 3-10, 1 keeps more",
    )
    beta_regularizer2: float = Field(
        default=0.0, ge=0, le=1e6, description="the same, only for the first two betas"
    )
    augmentations: int = Field(
        default=1,
        ge=1,
        le=32,
        description="turned and mirrored crops a person, averaged; 1 fast, 5 steadier",
    )
    batch: int = Field(default=16, ge=1, le=1024, description="crops at once")
    seen_confidence: SeenConfidence = 0.5


class Nlf(TorchBackend, BodyEstimator):
    """Body estimator: SMPL-X (55 joints) or SMPL (24 joints) bodies by NLF, in the frame of the
    given camera.
    """

    written_for = 1
    Options: ClassVar[type[Options]] = NlfOptions
    options: NlfOptions
    reads = ("people", "intrinsics", "keypoints")

    def __init__(self, options: NlfOptions | None = None) -> None:
        super().__init__(options)
        self._body: BodyModel | None = None
        self._checked = False

    def missing(self) -> tuple[str, ...]:
        """Describe missing files, and missing torchvision, which the TorchScript file needs."""
        lacking = list(super().missing())
        if find_spec("torchvision") is None:
            lacking.append(_NO_TORCHVISION)
        if self.options.smplx_file and not Path(self.options.smplx_file).expanduser().is_file():
            lacking.append(
                f"there is no file {self.options.smplx_file}: set smplx_file to your "
                f"SMPLX_NEUTRAL.npz"
            )
        return tuple(lacking)

    def requirements(self) -> tuple[Requirement, ...]:
        """Return torchvision."""
        return (Packages(("torchvision",)),)

    def build(self, device: str) -> Any:
        """Load the TorchScript file, and the SMPL-X file if there is one."""
        path = self.file()
        try:
            import torchvision  # noqa: F401 -- registers the operators that the file uses
        except Exception as error:  # a file for another torch version can raise anything
            raise BackendError(f"{_NO_TORCHVISION} ({type(error).__name__}: {error})") from error
        network = open_torchscript(path, device)
        if not any(hasattr(network, name) for name in _METHODS):
            raise BackendError(
                f"{path} is not a multi-person NLF, since it has none of the methods "
                f"{', '.join(_METHODS)}: "
                "take nlf_l_multi or nlf_s_multi"
            )
        self._checked = False
        if self.options.smplx_file and self.options.body == "smplx":
            from physic_core.body import load_body

            self._body = load_body(Path(self.options.smplx_file).expanduser())
        return network

    def close(self) -> None:
        """Release the network and the body model."""
        super().close()
        self._body = None

    def infer(
        self,
        image: UInt8Array,
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """Return bodies of N people, metres, camera frame.

        Raises:
            BackendError: it is not loaded, or the output of the network has another form.
        """
        network = self.network
        if not len(people):
            # Without people, the network returns other keys and shapes.
            return empty_bodies(self.options.body)
        found = self._ask(network, image, people.boxes, intrinsics)
        bodies = self._as_smplx(found) if self.options.body == "smplx" else self._as_smpl(found)
        return replace(
            bodies,
            observed=observed_joints(
                keypoints, image.shape[0], image.shape[1], self.options.seen_confidence
            ),
        )

    def _ask(
        self, network: Any, image: UInt8Array, boxes: FloatArray, intrinsics: Intrinsics
    ) -> dict[str, FloatArray]:
        """Run the network on the people's boxes; lengths in its own units."""
        import torch

        method = next(getattr(network, name) for name in _METHODS if hasattr(network, name))
        ltwh = np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1).astype(
            np.float32
        )
        # uint8, not floats: the network itself converts grey levels from 0 to 255 to linear light.
        pixels = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None].to(
            self.device
        )
        with torch.no_grad():
            answer = method(
                pixels,
                [torch.from_numpy(ltwh).to(self.device)],
                intrinsic_matrix=torch.from_numpy(intrinsics.matrix.astype(np.float32))[None].to(
                    self.device
                ),
                internal_batch_size=self.options.batch,
                num_aug=self.options.augmentations,
                beta_regularizer=self.options.beta_regularizer,
                beta_regularizer2=self.options.beta_regularizer2,
                model_name=self.options.body,
            )
        found: dict[str, FloatArray] = {
            key: to_numpy(answer[key][0])
            for key in (
                "pose",
                "betas",
                "trans",
                "joints3d",
                "vertices3d",
                "joints3d_nonparam",
                "vertices3d_nonparam",
            )
            if key in answer
        }
        joints = 55 if self.options.body == "smplx" else 24
        wanted = {
            "pose": (len(boxes), 3 * joints),
            "trans": (len(boxes), 3),
            "joints3d": (len(boxes), joints, 3),
        }
        for key, shape in wanted.items():
            came = found[key].shape if key in found else None
            if came != shape:
                raise BackendError(
                    f"NLF returned {key} {'nothing' if came is None else came}, where "
                    f"{len(boxes)} people of "
                    f"'{self.options.body}' are {shape}: the file may be of another version than "
                    f"those known here"
                )
        return found

    def _as_smplx(self, found: dict[str, FloatArray]) -> Bodies:
        """Convert the network output to SMPL-X bodies."""
        count = len(found["pose"])
        joints = found["joints3d"] / _MM
        rotvecs = found["pose"].reshape(count, 55, 3)
        expression = np.zeros((count, _EXPRESSION), np.float32)
        body = self._body
        mesh = None
        if body is None:
            transl = _translations(found)
        else:
            from physic_core.geometry.tensors import tensor

            rest = body.kinematics.rest_joints(
                tensor(np.concatenate([found["betas"], expression], axis=1))
            )
            transl = joints[:, 0] - rest[:, 0].numpy()
            faces = body.faces.numpy().astype(np.int32)
            t_pose = body(*body.zero_pose()).vertices[0].numpy()
            mesh = Mesh("smplx", found["vertices3d"] / _MM, faces, t_pose)
        bodies = Bodies(
            parameters_from_rotvecs(rotvecs, found["betas"], transl, expression),
            "smplx",
            joints=joints,
            mesh=mesh,
        )
        if body is not None and not self._checked:
            _check_reconstruction(body, bodies, found["vertices3d"] / _MM)
            self._checked = True
        return bodies

    def _as_smpl(self, found: dict[str, FloatArray]) -> Bodies:
        """Convert the network output to SMPL bodies."""
        return bodies_from_smpl(
            found["pose"].reshape(-1, 24, 3),
            found["betas"],
            _translations(found),
            joints=found["joints3d"] / _MM,
        )


def _translations(found: dict[str, FloatArray]) -> FloatArray:
    """Return translations (N, 3) in metres for every version of the file.

    In v0.2.0 they are relative to the mean of the points to which the body was fitted. The distance
    from the pelvis to the body's origin shows the version.
    """
    pelvis = found["joints3d"][:, 0] / _MM
    transl = found["trans"]
    if np.nanmedian(np.linalg.norm(pelvis - transl, axis=1)) < _PELVIS_REACH_M:
        return transl
    if "joints3d_nonparam" in found and "vertices3d_nonparam" in found:
        points = np.concatenate([found["vertices3d_nonparam"], found["joints3d_nonparam"]], axis=1)
        moved: FloatArray = transl + points.mean(axis=1) / _MM
        if np.nanmedian(np.linalg.norm(pelvis - moved, axis=1)) < _PELVIS_REACH_M:
            return moved
    raise BackendError(
        f"NLF returned a body at {np.round(transl[0], 2).tolist()} m and its pelvis at "
        f"{np.round(pelvis[0], 2).tolist()} m: the file may be of another version than those "
        f"known here; "
        "with the option smplx_file the place is told from the pelvis alone"
    )


def _check_reconstruction(body: BodyModel, bodies: Bodies, vertices: FloatArray) -> None:
    """Raise BackendError if the user's SMPL-X file gives another surface than NLF."""
    import torch

    from physic_core.body.bones import rotations_from_parameters
    from physic_core.geometry.tensors import tensor

    p = bodies.parameters
    if p.betas.shape[1] != body.num_betas or vertices.shape[1] != body.num_vertices:
        raise BackendError(
            f"NLF returned {p.betas.shape[1]} betas and {vertices.shape[1]} vertices, "
            f"smplx_file has {body.num_betas} and {body.num_vertices}"
        )
    with torch.no_grad():
        own = body(rotations_from_parameters(p), tensor(p.betas), tensor(p.transl)).vertices.numpy()
    gap = float(np.nanmean(np.linalg.norm(own - vertices, axis=2)) * _MM)
    if gap > _WORST_MM:
        raise BackendError(
            f"rebuilt from its parameters by smplx_file, NLF's first body is {gap:.1f} mm off on "
            f"average: "
            "give the neutral SMPL-X of version 1.1, for which it was trained"
        )
    _LOG.debug("NLF's vertices are rebuilt within %.2f mm", gap)


_NO_TORCHVISION = (
    "NLF needs torchvision, whose operators its file uses: pip install torchvision, "
    "the build that fits your torch"
)
