"""DECO (Tripathi et al. 2023) from its checkout: which vertices of SMPL touch something."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.adapters.contact_crop import BOX_GROWTH, contact_crop
from physic_core.adapters.devices import check_device
from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior, Options
from physic_core.types import ContactProbability
from physic_human.hosting import CheckoutOptions, Hosted, Project, batches, computing, to_numpy
from physic_human.smpl_rest import rest_of_smpl, smpl_missing

if TYPE_CHECKING:
    from physic_core.types import Bodies, FloatArray, People, RestMesh, UInt8Array

__all__ = ["SMPL_VERTICES", "Deco", "DecoOptions"]

SMPL_VERTICES = 6890


class DecoOptions(CheckoutOptions):
    """Settings of DECO."""

    weights: str = Field(
        default="deco", description="a name of `physic weights list`, or the path of your deco_best.pth"
    )
    smpl_file: str = Field(
        default="", description="your SMPL_NEUTRAL.npz or .pkl, by whose T-pose labels are carried to your body model"
    )
    growth: float = Field(
        default=BOX_GROWTH, ge=0, le=1, description="of a person's box on every side, in its own sizes"
    )
    fit: Literal["letterbox", "squash"] = Field(
        default="letterbox",
        description="how a box becomes a square: with white, as in the PhySIC paper's code, or stretched, as in DECO's",
    )


class Deco(Hosted, ContactPrior):
    """Contact of any kind, whatever is touched: above 0.5 it touches."""

    Options: ClassVar[type[Options]] = DecoOptions
    options: DecoOptions
    project: ClassVar[Project] = Project(
        "DECO",
        "models.deco",
        "https://github.com/sha2nkt/deco",
        ("torchvision", "yacs", "loguru"),
    )

    def __init__(self, options: DecoOptions | None = None) -> None:
        super().__init__(options)
        self._rest: RestMesh | None = None

    def missing(self) -> tuple[str, ...]:
        """Of checkout, packages, weights and the SMPL file."""
        return (*super().missing(), *smpl_missing(self.options.smpl_file))

    def load(self, device: str = "cpu") -> None:
        """Build the network and fill it.

        Raises:
            DeviceError: the device is not there.
            WeightsMissingError: code or weights are missing.
            BackendError: they are not DECO's.
            BodyModelError: the SMPL file cannot be used.
        """
        check_device(device)
        path = self._host.file()
        kind = self._host.checkout.attribute("DECO")
        self._rest = rest_of_smpl(self.options.smpl_file)
        with computing(self._host.checkout, device):
            # Encoder, whether it looks at the context too, device; older versions always do, and are not asked.
            asked = "context" in inspect.signature(kind).parameters
            network = kind("hrnet", True, device) if asked else kind("hrnet", device)
            self._host.keep(self._filled(network, path, "deco"), device)

    def close(self) -> None:
        """Let go of the network."""
        super().close()
        self._rest = None

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """N people -> probability (N, 6890) on SMPL.

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """
        network = self._host.loaded()
        found = np.zeros((len(people), SMPL_VERTICES), np.float32)
        for rows in batches(len(people), self.options.batch):
            crops = np.stack(
                [
                    contact_crop(image, box, growth=self.options.growth, fit=self.options.fit)
                    for box in people.boxes[rows]
                ]
            )
            found[rows] = self._run(network, crops)
        return ContactProbability(np.clip(found, 0, 1), "smpl", self._rest)

    def _run(self, network: Any, crops: FloatArray) -> FloatArray:
        import torch

        with computing(self._host.checkout, self._host.device, half=self.options.half):
            answer = network(torch.from_numpy(crops).to(self._host.device))
        contact = to_numpy(answer[0] if isinstance(answer, (tuple, list)) else answer)
        if contact.shape != (len(crops), SMPL_VERTICES):
            raise BackendError(
                f"DECO answered {contact.shape}, where {len(crops)} people are ({len(crops)}, {SMPL_VERTICES})"
            )
        return np.asarray(contact, np.float32)
