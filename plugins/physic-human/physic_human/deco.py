"""Predict contact on SMPL vertices with a checkout of DECO (Tripathi et al. 2023)."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior, Options, Share
from physic_core.types import ContactProbability
from physic_human.checkout_backend import (
    CheckoutProject,
    batch_slices,
    inference_context,
    to_numpy,
)
from physic_human.contact_crop import BOX_GROWTH, contact_crop
from physic_human.smpl_checkout import SmplCheckoutBackend, SmplCheckoutOptions
from physic_human.user_smpl import load_rest_mesh

if TYPE_CHECKING:
    from physic_core.types import Bodies, FloatArray, People, RestMesh, UInt8Array

SMPL_VERTICES = 6890


class DecoOptions(SmplCheckoutOptions):
    """Settings of DECO."""

    weights: str = Field(
        default="deco", description="a name of `physic weights list`, or the path of your deco_best.pth"
    )
    smpl_file: str = Field(
        default="", description="your SMPL_NEUTRAL.npz or .pkl, by whose T-pose labels are carried to your body model"
    )
    growth: Share = Field(default=BOX_GROWTH, description="of a person's box on every side, in its own sizes")
    fit: Literal["letterbox", "squash"] = Field(
        default="letterbox",
        description="how a box becomes a square: with white, as in the PhySIC paper's code, or stretched, as in DECO's",
    )


class Deco(SmplCheckoutBackend, ContactPrior):
    """Contact prior by DECO: contact with any object, threshold 0.5."""

    Options: ClassVar[type[Options]] = DecoOptions
    options: DecoOptions
    reads = ("people",)
    project: ClassVar[CheckoutProject] = CheckoutProject(
        "DECO",
        "models.deco",
        "https://github.com/sha2nkt/deco",
        ("torchvision", "yacs", "loguru"),
        "d1061cef2ae94c3364ba5c9338eea58d654acd77",
    )

    def __init__(self, options: DecoOptions | None = None) -> None:
        super().__init__(options)
        self._rest: RestMesh | None = None

    def _build(self, device: str) -> None:
        """Build the network and load its weights."""
        path = self._checkout_network.file()
        kind = self._checkout_network.checkout.attribute("DECO")
        self._rest = load_rest_mesh(self.options.smpl_file)
        with inference_context(self._checkout_network.checkout, device):
            # Encoder, whether it looks at the context too, device; older versions always do, and have no such argument.
            takes_context = "context" in inspect.signature(kind).parameters
            network = kind("hrnet", True, device) if takes_context else kind("hrnet", device)
            self._checkout_network.set_network(self._load_checkpoint(network, path, "deco"), device)

    def close(self) -> None:
        """Release the network."""
        super().close()
        self._rest = None

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """Return the contact probability (N, 6890) on SMPL vertices of N people.

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """
        network = self._checkout_network.loaded()
        found = np.zeros((len(people), SMPL_VERTICES), np.float32)
        for rows in batch_slices(len(people), self.options.batch):
            crops = np.stack(
                [
                    contact_crop(image, box, growth=self.options.growth, fit=self.options.fit)
                    for box in people.boxes[rows]
                ]
            )
            found[rows] = self._run(network, crops)
        return ContactProbability(np.clip(found, 0, 1), "smpl", self._rest)

    def _run(self, network: Any, crops: FloatArray) -> FloatArray:
        """Run the network on crops."""
        import torch

        with inference_context(self._checkout_network.checkout, self._checkout_network.device, half=self.options.half):
            answer = network(torch.from_numpy(crops).to(self._checkout_network.device))
        contact = to_numpy(answer[0] if isinstance(answer, (tuple, list)) else answer)
        if contact.shape != (len(crops), SMPL_VERTICES):
            raise BackendError(
                f"DECO returned {contact.shape}, where {len(crops)} people are ({len(crops)}, {SMPL_VERTICES})"
            )
        return np.asarray(contact, np.float32)
