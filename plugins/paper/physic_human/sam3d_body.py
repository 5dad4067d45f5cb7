"""Estimate MHR bodies in metres, in the given camera, with a checkout of SAM 3D Body (Meta 2025).

Its code downloads DINOv3's main branch while it builds the network, and unpickles checkpoints. Here
it gets the folder of the option ``dinov3_checkout``, and tensors only. The ViT-H weights need no
DINOv3.
"""

from __future__ import annotations

import logging
import pickle
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError, WeightsMissingError
from physic_core.interfaces import BodyEstimator, Requirement
from physic_core.types import Bodies, Mesh
from physic_human.checkout_backend import CheckoutBackend, CheckoutOptions, checkpoint_error
from physic_networks.bodies import (
    MHR_KEYPOINTS,
    SeenConfidence,
    empty_bodies,
    joints_from_mhr70,
    observed_joints,
    parameters_from_rotvecs,
)
from physic_networks.checkouts import Checkout
from physic_networks.networks import WEIGHTS_HELP

if TYPE_CHECKING:
    from pathlib import Path

    import torch

    from physic_core.types import FloatArray, Hints, Intrinsics, Keypoints, People, UInt8Array

_lock = threading.RLock()


@contextmanager
def guarded_torch(hub: Callable[..., Any], *, trusted: bool) -> Iterator[list[Any]]:
    """Replace ``torch.hub.load`` and let ``torch.load`` read only tensors, in this thread and
    inside the block.

    Published code downloads and runs main branches, or unpickles objects. Other threads are not
    affected; a second block waits for the first. Yields what ``torch.load`` has read so far.

    Args:
        hub: what is called in place of ``torch.hub.load``.
        trusted: whether checkpoints may hold more than tensors and plain containers.
    """
    import torch

    with _lock:
        thread_id = threading.get_ident()
        hub_load = torch.hub.load
        load = torch.load

        def own_hub_load(*args: Any, **options: Any) -> Any:
            loader: Callable[..., Any] = hub if threading.get_ident() == thread_id else hub_load
            return loader(*args, **options)

        read: list[Any] = []

        def own_load(*args: Any, **options: Any) -> Any:
            if threading.get_ident() != thread_id:
                return load(*args, **options)
            read.append(load(*args, **(options if trusted else options | {"weights_only": True})))
            return read[-1]

        torch.hub.load = own_hub_load
        torch.load = own_load
        try:
            yield read
        finally:
            torch.hub.load = hub_load
            torch.load = load


class Sam3dBodyOptions(CheckoutOptions):
    """Settings of SAM 3D Body."""

    weights: str = Field("sam-3d-body-vith", description=WEIGHTS_HELP)
    dinov3_checkout: str = Field(
        default="",
        description="folder of your checkout of DINOv3, its root, for sam-3d-body-dinov3; empty "
        "where it is installed",
    )
    seen_confidence: SeenConfidence = 0.5
    use_masks: bool = Field(
        default=False,
        description="also give the people's masks to the network; helps if people overlap",
    )


_CHECKPOINT = "model.ckpt"
_CONFIG = "model_config.yaml"
_MHR = "assets/mhr_model.pt"
_DINOV3 = "facebookresearch/dinov3"
_DINOV3_BACKBONE = re.compile(r"^\s*TYPE:\s*['\"]?dinov3", re.MULTILINE)

_OF_THE_HUB = ("source", "trust_repo", "force_reload", "verbose", "skip_validation")
"""Options of ``torch.hub.load`` itself."""


class Sam3dBody(CheckoutBackend, BodyEstimator):
    """Body estimator: MHR bodies by SAM 3D Body, as mesh and joints; all rotations are zero.

    Needs a GPU.
    """

    written_for = 1
    Options = Sam3dBodyOptions
    options: Sam3dBodyOptions
    reads = ("people", "intrinsics", "keypoints")
    capabilities = frozenset({"needs_cuda"})
    project = Checkout(
        name="SAM 3D Body",
        package="sam_3d_body",
        homepage="https://github.com/facebookresearch/sam-3d-body",
        commit="b5c765a0d89d789985e186d396315e7590887b94",
        needs=(
            "torchvision",
            "pytorch_lightning",
            "yacs",
            "omegaconf",
            "braceexpand",
            "roma",
            "einops",
            "timm",
        ),
    )

    def __init__(self, options: Sam3dBodyOptions | None = None) -> None:
        super().__init__(options)
        # Its hubconf.py also imports all of its evaluation; the networks need only torch.
        self._dinov3 = Checkout(
            self.options.dinov3_checkout,
            name="DINOv3",
            package="dinov3.hub.backbones",
            homepage=f"https://github.com/{_DINOV3}",
            commit="6876159a11b4df116f30f667f8c9888617df0751",
            option="dinov3_checkout",
        )

    def missing(self) -> tuple[str, ...]:
        """Describe missing checkouts, packages and weights."""
        return (*super().missing(), *(self._dinov3.missing() if self._needs_dinov3() else ()))

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the repositories and their packages."""
        return (
            *super().requirements(),
            *(self._dinov3.requirements() if self._needs_dinov3() else ()),
        )

    def fingerprint(self) -> str:
        """Return the identity of weights and code."""
        return f"{super().fingerprint()} {self._dinov3.fingerprint()}"

    def close(self) -> None:
        """Release networks and code."""
        super().close()
        self._dinov3.close()

    def _needs_dinov3(self) -> bool:
        """Return whether the weights need DINOv3, by their config, or by their name if they are
        missing.
        """
        try:
            text = self.file(_CONFIG).read_text("utf-8", errors="replace")
        except (WeightsMissingError, OSError):
            return "dinov3" in self.options.weights
        return _DINOV3_BACKBONE.search(text) is not None

    def build(self, device: str) -> Any:
        """Build the network on a GPU and load its weights."""
        checkpoint = self.file(_CHECKPOINT)
        mhr = self.file(_MHR)
        build = self.checkout.attribute("load_sam_3d_body")
        kind = self.checkout.attribute("SAM3DBodyEstimator")
        trusted = self.options.trust_checkpoint
        with self.inference(), guarded_torch(self._from_hub, trusted=trusted) as read:
            try:
                network, settings = build(str(checkpoint), device=device, mhr_path=str(mhr))
            except pickle.UnpicklingError as error:
                raise checkpoint_error(checkpoint, error, trusted=trusted) from error
            _check_parameters(network, read, checkpoint)
            return kind(network, settings)

    def _from_hub(self, repo: str, name: str, *args: Any, **options: Any) -> Any:
        """Replace ``torch.hub.load``: build a network from the user's DINOv3 checkout."""
        if str(repo).partition(":")[0] != _DINOV3:
            raise BackendError(
                f"SAM 3D Body wants to run code of {repo}, which is not fetched: use the "
                f"checkout of {self.project.homepage} that needs only {_DINOV3}"
            )
        make = self._dinov3.attribute(name)
        others = {key: value for key, value in options.items() if key not in _OF_THE_HUB}
        with self._dinov3.activated():
            return make(*args, **(others | {"pretrained": False}))

    def infer(
        self,
        image: UInt8Array,
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """Return bodies of N people of the model "mhr", metres, camera frame.

        Raises:
            BackendError: it is not loaded, or its output has another form.
        """
        estimator = self.network
        if not len(people):
            return empty_bodies("mhr", num_betas=0)
        outputs: list[dict[str, Any]] = []
        for first in range(0, len(people), self.options.batch):
            outputs += self._predict_rows(
                image, people, slice(first, first + self.options.batch), intrinsics
            )

        def joined(name: str) -> FloatArray:
            return np.stack([np.asarray(one[name], np.float32) for one in outputs])

        transl = joined("pred_cam_t")
        if not uses_principal_point(estimator.cfg):
            transl[:, :2] += _principal_point_shift(image, intrinsics) * transl[:, 2:]
        vertices = joined("pred_vertices") + transl[:, None]
        points = joined("pred_keypoints_3d")[:, :MHR_KEYPOINTS]
        zero = np.zeros((len(people), 22, 3), np.float32)
        betas = np.stack(
            [np.asarray(one.get("shape_params", ()), np.float32).reshape(-1) for one in outputs]
        )
        mesh = Mesh("mhr", vertices, np.asarray(estimator.faces, np.int32))
        return Bodies(
            parameters_from_rotvecs(zero, betas, transl),
            "mhr",
            observed=observed_joints(
                keypoints, image.shape[0], image.shape[1], self.options.seen_confidence
            ),
            joints=joints_from_mhr70(points + transl[:, None]),
            mesh=mesh,
        )

    def _predict_rows(
        self, image: UInt8Array, people: People, rows: slice, intrinsics: Intrinsics
    ) -> list[dict[str, Any]]:
        """Run the estimator on some people."""
        import torch

        estimator = self.network
        boxes = np.asarray(people.boxes[rows], np.float32)
        camera = intrinsics.matrix.astype(np.float32)
        if uses_principal_point(estimator.cfg):
            camera[:2, 2] += 0.5  # it counts pixels from their edges
        else:
            # the principal point that it assumes
            camera[:2, 2] = image.shape[1] / 2, image.shape[0] / 2
        with self._dinov3.activated(), self.inference():
            answer = estimator.process_one_image(
                np.ascontiguousarray(image),  # arrays are RGB; it reads only files as BGR
                bboxes=boxes,
                masks=np.ascontiguousarray(people.masks[rows]) if self.options.use_masks else None,
                cam_int=torch.from_numpy(camera)[None],
            )
        wanted = {"pred_vertices", "pred_cam_t", "pred_keypoints_3d"}
        if len(answer) != len(boxes) or not all(wanted <= one.keys() for one in answer):
            raise BackendError(
                f"SAM 3D Body returned {len(answer)} people for {len(boxes)} boxes, or one without "
                f"{', '.join(sorted(wanted))}: take the checkout of "
                f"https://github.com/facebookresearch/sam-3d-body"
            )
        return list(answer)


def uses_principal_point(config: Any) -> bool:
    """Return whether ``model_config.yaml`` makes the network place bodies relative to the
    principal point.

    Otherwise it places them relative to the centre of the photo, which is the default.
    """
    for name in ("MODEL", "DECODER", "USE_INTRIN_CENTER"):
        config = config.get(name) if isinstance(config, Mapping) else None
    return bool(config)


_MADE_OTHERWISE = re.compile(r"\.mhr\.|\.hand_pose_comps_ori$|\.mask_token$")
"""Parameters that the published checkpoint lacks: those of MHR's own file, a copy of another, and
an unused one.
"""

_ESSENTIAL = re.compile(r"(backbone|decoder|decoder_hand)\.")
"""Parameters without which the checkpoint is of another network."""

_LOG = logging.getLogger(__name__)


def _check_parameters(network: torch.nn.Module, read: list[Any], path: Path) -> None:
    """Compare the parameters of a network with what was read from ``path``.

    Its code leaves random numbers where a checkpoint, or another version of DINOv3, has other
    parameters. Other missing parameters than those of backbone and decoders are a warning: they may
    be ones that its code does not use.

    Raises:
        BackendError: a parameter of the backbone or a decoder is not there, or has another shape.
    """
    state = {
        name: value
        for content in read
        for name, value in content.get("state_dict", content).items()
    }
    parameters = dict(network.named_parameters())
    absent = [
        name
        for name, value in parameters.items()
        if not _MADE_OTHERWISE.search(name)
        and getattr(state.get(name), "shape", None) != value.shape
    ]
    if not absent:
        return
    essential = [name for name in absent if _ESSENTIAL.match(name)]
    shown = essential or absent
    text = (
        f"{path} is missing {len(shown)} of {len(parameters)} parameters of the network, "
        f"{', '.join(shown[:3])}"
    )
    if essential:
        raise BackendError(
            f"{text}, ...: it is the checkpoint of another network, or of another version of SAM "
            f"3D Body or of DINOv3"
        )
    _LOG.warning("%s: these parameters are random, so compare the bodies with the photo", text)


def _principal_point_shift(image: UInt8Array, intrinsics: Intrinsics) -> FloatArray:
    """Return the shift (2,) of bodies in x and y, in units of z, from the image centre to the
    principal point.
    """
    height, width = image.shape[:2]
    apart = np.array([width / 2 - intrinsics.cx, height / 2 - intrinsics.cy]) - 0.5
    return np.asarray(apart / intrinsics.fx, np.float32)
