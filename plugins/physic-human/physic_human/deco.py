"""Predict contact on SMPL vertices with a checkout of DECO (Tripathi et al. 2023)."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.adapters.checkouts import Checkout
from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior, Options, Share
from physic_core.types import ContactProbability
from physic_human.contact_crop import BOX_GROWTH, contact_crop
from physic_human.smpl_checkout import SmplCheckoutBackend, SmplCheckoutOptions
from physic_human.user_smpl import load_rest_mesh

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

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

    written_for = 1
    Options: ClassVar[type[Options]] = DecoOptions
    options: DecoOptions
    reads = ("people",)
    project: ClassVar[Checkout] = Checkout(
        name="DECO",
        package="models.deco",
        homepage="https://github.com/sha2nkt/deco",
        commit="d1061cef2ae94c3364ba5c9338eea58d654acd77",
        needs=("torchvision", "yacs", "loguru"),
    )

    def __init__(self, options: DecoOptions | None = None) -> None:
        super().__init__(options)
        self._rest: RestMesh | None = None

    def build(self, device: str) -> Any:
        """Build the network and load its weights."""
        path = self.file()
        kind = self.checkout.attribute("DECO")
        self._rest = load_rest_mesh(self.options.smpl_file)
        with self.inference():
            # Encoder, whether it looks at the context too, device; older versions always do, and have no such argument.
            takes_context = "context" in inspect.signature(kind).parameters
            network = kind("hrnet", True, device) if takes_context else kind("hrnet", device)
            return self.load_checkpoint(network, path, "deco")

    def close(self) -> None:
        """Release the network."""
        super().close()
        self._rest = None

    def preprocess(self, image: UInt8Array, people: People, bodies: Bodies) -> dict[str, FloatArray]:
        """Crop the people."""
        options = self.options
        crops = [contact_crop(image, box, growth=options.growth, fit=options.fit) for box in people.boxes]
        return {"img": np.array(crops, np.float32)}

    def ask(self, inputs: dict[str, torch.Tensor]) -> Sequence[Any]:
        """Run the network on crops."""
        answer = self.network(inputs["img"])
        return [answer[0] if isinstance(answer, (tuple, list)) else answer]

    def postprocess(
        self, outputs: list[FloatArray], image: UInt8Array, people: People, bodies: Bodies
    ) -> ContactProbability:
        """Return the contact probability (N, 6890) on SMPL vertices of N people."""
        found = outputs[0] if outputs else np.zeros((0, SMPL_VERTICES), np.float32)
        if found.shape != (len(people), SMPL_VERTICES):
            raise BackendError(f"DECO returned {found.shape}, expected ({len(people)}, {SMPL_VERTICES})")
        return ContactProbability(np.clip(found, 0, 1), "smpl", self._rest)
