"""Cameras that Depth Anything 3 (Lin et al. 2025) estimates from all photos at once, in metres by their people.

The network returns poses up to a scale, and focal lengths. They start the bundle adjustment of the people's keypoints,
and are evidence in it. The code is the authors' package, run as it is; accuracy with the published weights was not
measured.
"""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol

import numpy as np
import torch
from pydantic import Field

from physic_cameras.bundle import CalibratedRig, Matches
from physic_cameras.checkpoints import fill
from physic_cameras.lightglue import MANIFEST
from physic_cameras.people import shown_people
from physic_cameras.rig import CameraRig, known_motion
from physic_cameras.solution import Evidence, PhotoWithStart, SolverOptions, skipped_photo, solved
from physic_core import weights
from physic_core.adapters.devices import check_device
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw, resize_image
from physic_core.body import load_body
from physic_core.errors import BackendError, InputError, WeightsMissingError
from physic_core.interfaces import CameraSolver, Options, Packages, Requirement
from physic_core.types import CameraTrust
from physic_core.types.bounds import Positive

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from physic_core.types import FloatArray, MomentView, SolvedCameras, UInt8Array

_PATCH = 14
_PACKAGE = "depth_anything_3"
_NEEDS = ("addict", "einops", "omegaconf")


class PoseNetwork(Protocol):
    """Estimates the cameras of several pictures at once."""

    def __call__(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return poses (V, 3, 4), world to camera, and matrices (V, 3, 3) px of pictures (V, 3, h, w) as given."""


class DepthAnything3Network:
    """The network of the authors' package, on one device, in float32.

    Args:
        path: of its model.safetensors.
        name: of its configuration, such as "da3-base".
        device: of the network.

    Raises:
        BackendError: the file is not that of the network, or the package has no such network.
    """

    def __init__(self, path: Path, name: str, device: str) -> None:
        from depth_anything_3.cfg import create_object, load_config
        from depth_anything_3.registry import MODEL_REGISTRY
        from safetensors.torch import load_file

        if name not in MODEL_REGISTRY:
            raise BackendError(f"depth_anything_3 has no network '{name}', only {', '.join(MODEL_REGISTRY)}")
        with redirect_stdout(io.StringIO()):
            network = create_object(load_config(MODEL_REGISTRY[name]))
        try:
            state = load_file(path)
        except Exception as error:  # whatever a file can be instead
            raise BackendError(f"{path} cannot be read as safetensors: {type(error).__name__}: {error}") from error
        fill(network, {key.removeprefix("model."): tensor for key, tensor in state.items()}, path)
        self._network, self._device = network.eval().to(device), device

    def __call__(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return poses (V, 3, 4), world to camera, and matrices (V, 3, 3) px of pictures (V, 3, h, w)."""
        given = torch.from_numpy(pixels)[None].to(self._device)
        with torch.inference_mode(), redirect_stdout(io.StringIO()):
            found = self._network(given)
        return found.extrinsics[0].cpu().numpy(), found.intrinsics[0].cpu().numpy()


class DepthAnything3Options(SolverOptions):
    """Settings of :class:`DepthAnything3Cameras`; the last three were not chosen on photos."""

    weights: str = Field(
        default="depth-anything-3-base",
        description="a name of `physic weights list`, or the path of a model.safetensors",
    )
    network: Literal["da3-small", "da3-base", "da3-large"] = Field(
        default="da3-base", description="the network that the weights are for"
    )
    longest_px: int = Field(
        default=504, ge=56, le=2016, description="longer side of the photos as the network sees them"
    )
    rotation_sigma: Positive = Field(default=0.05, description="error of each component of a pose's rotation, radians")
    position_share: Positive = Field(
        default=0.05, description="error of each coordinate of a camera, as a share of the distance between cameras"
    )
    focal_sigma: Positive = Field(default=0.1, description="error of the logarithm of a focal length")


class DepthAnything3Cameras(CameraSolver):
    """Takes the cameras that Depth Anything 3 estimates, and adjusts them to the people of the photos."""

    Options: ClassVar[type[Options]] = DepthAnything3Options
    options: DepthAnything3Options
    cacheable: ClassVar[bool] = False  # its input is as large as the photos

    _network: PoseNetwork | None = None

    def missing(self) -> tuple[str, ...]:
        """Describe missing packages and weights, and how to get them."""
        lacking = [name for name in (_PACKAGE, *_NEEDS) if find_spec(name) is None]
        code = (
            f"Depth Anything 3 needs {', '.join(lacking)}: pip install --no-deps depth-anything-3==0.1.1 && "
            f"pip install {' '.join(_NEEDS)} (with its own dependencies, it would replace numpy by an older one)"
        )
        return (*((code,) if lacking else ()), *weights.missing(MANIFEST, self.options.weights))

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the packages that its code imports."""
        return (Packages(_NEEDS),)

    def fingerprint(self) -> str:
        """Return the identity of the weights, independent of their path."""
        return weights.fingerprint(MANIFEST, self.options.weights)

    def load(self, device: str = "cpu") -> None:
        """Read the weights.

        Raises:
            WeightsMissingError: the weights or the package are not on this machine.
            DeviceError: the device is not there.
            BackendError: the file is not that of the network.
        """
        check_device(device)
        if self._network is None:
            if absent := self.missing():
                raise WeightsMissingError("; ".join(absent))
            path = weights.locate(MANIFEST, self.options.weights)
            self._network = DepthAnything3Network(path, self.options.network, device)

    def close(self) -> None:
        """Release the network."""
        self._network = None

    def infer(self, photos: tuple[MomentView, ...]) -> SolvedCameras:
        """Solve the cameras of V photos in one metric frame.

        Raises:
            BackendError: ``load`` was not called, or the network answers something else.
            InputError: no two photos show the same person.
        """
        if self._network is None:
            raise BackendError("DepthAnything3Cameras is not loaded: call load() before infer()")
        shown = [v for v, view in enumerate(photos) if len(view.people)]
        skipped = [
            skipped_photo(v, view, "no people", "no person in it has a body")
            for v, view in enumerate(photos)
            if v not in shown
        ]
        if len(shown) < 2:
            raise InputError(
                f"a moment needs two photos of people; {'; '.join(one.message for one in skipped)}: give two different "
                "photos that show the same people"
            )
        pixels, sizes = pictures([photos[v].image for v in shown], self.options.longest_px)
        rig, matrices = _checked(*self._network(pixels), len(shown))
        views = list(photos)
        for v, size, matrix in zip(shown, sizes, matrices, strict=True):
            views[v] = self._with_focal(views[v], size, matrix)
        chosen = [views[v] for v in shown]
        model = load_body("embedded").to(dtype=torch.float64)
        cameras = CalibratedRig(_with_known(rig, chosen), np.zeros(len(chosen)))
        evidence = Evidence(cameras, Matches.none(), self.options.rotation_sigma, self.options.position_share)
        used = [PhotoWithStart(v, views[v], shown_people(views[v], model)) for v in shown]
        return solved(views, used, evidence, skipped, self.options, {})

    def _with_focal(self, view: MomentView, size: tuple[int, int], matrix: FloatArray) -> MomentView:
        """Return a photo with the estimated focal length, unless its own is known.

        Args:
            view: the photo.
            size: its width and height in the pixels of the network, before it is cropped.
            matrix: (3, 3) camera of the network, px.
        """
        camera = view.intrinsics
        if camera.known or view.pose is not None:
            return view
        found = [matrix[0, 0] * camera.width / size[0] / camera.fx, matrix[1, 1] * camera.height / size[1] / camera.fy]
        factor = float(np.sqrt(np.prod(found)))
        own = replace(
            camera,
            fx=camera.fx * factor,
            fy=camera.fy * factor,
            source="Depth Anything 3",
            trust=CameraTrust.ESTIMATED,
            focal_sigma=self.options.focal_sigma,
        )
        return replace(view, intrinsics=own)


def pictures(images: Sequence[UInt8Array], longest_px: int) -> tuple[FloatArray, list[tuple[int, int]]]:
    """Return photos as the network takes them (V, 3, h, w), and the width and height of each before it is cropped.

    As its authors do: the longer side is reduced, both sides are rounded to multiples of 14 px, and photos of several
    sizes are cropped to the smallest sides, about the middle.
    """
    resized = []
    for image in images:
        height, width = image.shape[:2]
        scale = longest_px / max(height, width)
        first = _resized(image, max(1, round(height * scale)), max(1, round(width * scale)))
        resized.append(_resized(first, *(_nearest_multiple(side) for side in first.shape[:2])))
    sizes = [(image.shape[1], image.shape[0]) for image in resized]
    width, height = np.min(sizes, axis=0)
    cropped = []
    for image in resized:
        top, left = (image.shape[0] - height) // 2, (image.shape[1] - width) // 2
        cropped.append(normalized_nchw(image[top : top + height, left : left + width], IMAGENET_MEAN, IMAGENET_STD)[0])
    return np.stack(cropped), sizes


def _resized(image: UInt8Array, height: int, width: int) -> UInt8Array:
    grows = height > image.shape[0] or width > image.shape[1]
    resized: UInt8Array = resize_image(image, height, width, "bicubic" if grows else "area")
    return resized


def _nearest_multiple(side: int) -> int:
    return max(_PATCH, _PATCH * ((side + _PATCH // 2) // _PATCH))


def _checked(poses: FloatArray, matrices: FloatArray, count: int) -> tuple[CameraRig, FloatArray]:
    """Return the cameras of the network, with rotations that are exact.

    Raises:
        BackendError: the network answers something else.
    """
    shapes = np.shape(poses), np.shape(matrices)
    if shapes != ((count, 3, 4), (count, 3, 3)) or not np.isfinite(poses).all():
        raise BackendError(
            f"Depth Anything 3 returned poses {shapes[0]} and cameras {shapes[1]}, expected finite ones of {count} "
            "photos"
        )
    u, _, vt = np.linalg.svd(np.asarray(poses[:, :, :3], np.float64))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return CameraRig(u @ vt, np.asarray(poses[:, :, 3], np.float64)), np.asarray(matrices, np.float64)


def _with_known(rig: CameraRig, views: Sequence[MomentView]) -> CameraRig:
    """Return the cameras in metres, with poses of the user in place of estimated ones, if two or more are known."""
    known = {v: view.pose for v, view in enumerate(views) if view.pose is not None}
    if len(known) < 2:
        return rig
    first = next(iter(known))
    motions: dict[int, Any] = {v: known_motion(known[first], pose) for v, pose in known.items()}
    own = rig.relative_to(first)
    lengths = [np.linalg.norm([some[1] for some in motions.values()], axis=1).sum()]
    lengths.append(np.linalg.norm(own.translation[list(known)], axis=1).sum())
    found = own.scaled(lengths[0] / max(lengths[1], 1e-9))
    for v, (rotation, translation) in motions.items():
        found.rotation[v], found.translation[v] = rotation, translation
    return found
