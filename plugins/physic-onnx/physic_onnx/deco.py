"""Predict contact on SMPL vertices with DECO (Tripathi et al. 2023) from an ONNX file that a licensed user exported.

``python -m physic_onnx.export deco`` writes the file with SMPL's T-pose, by which labels are transferred to other body
models.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.adapters.contact_crop import BOX_GROWTH, INPUT_SIDE
from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior, Share

from .contract import GraphSignature, PortSpec
from .one_graph import WEIGHTS_HELP, OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from physic_core.types import Bodies, ContactProbability, People, UInt8Array

__all__ = ["Deco", "DecoOptions"]


class DecoOptions(OnnxBackendOptions):
    """Settings of DECO."""

    weights: str = Field("deco-onnx", description=WEIGHTS_HELP)
    growth: Share = Field(BOX_GROWTH, description="of a person's box on every side, in its own sizes")
    fit: Literal["letterbox", "squash"] = Field(
        "letterbox",
        description="how a box becomes a square: with white, as in the PhySIC paper's code, or stretched, as in DECO's",
    )
    batch: int = Field(8, ge=1, le=1024, description="people a run, where the file leaves that free")


class Deco(OnnxBackend, ContactPrior):
    """Contact prior by DECO: contact with any object, threshold 0.5. Its input is BGR, as in training."""

    Options: ClassVar[type[OnnxBackendOptions]] = DecoOptions
    options: DecoOptions
    signatures: ClassVar = {
        "physic_onnx.export deco": GraphSignature(
            (PortSpec("image", ("img", "input"), shape=(None, 3, INPUT_SIDE, INPUT_SIDE)),),
            (
                PortSpec("contact", ("cont",), shape=(None, None)),
                PortSpec("faces", dtype=("int64", "int32"), shape=(None, 3)),
                PortSpec("rest", shape=(None, 3)),
            ),
        ),
    }

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """Return the contact probability (N, 6890) on SMPL vertices of N people.

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """

        from physic_core.adapters.contact_crop import contact_crop
        from physic_core.types import ContactProbability, RestMesh

        from .top_down import constant_outputs, run_batches

        loaded = self.loaded()
        options = self.options
        crops = [contact_crop(image, box, growth=options.growth, fit=options.fit) for box in people.boxes]
        feed = {"image": np.stack(crops) if crops else np.zeros((1, 3, INPUT_SIDE, INPUT_SIDE), np.float32)}
        faces, rest = constant_outputs(loaded, feed, ["faces", "rest"])
        mesh = RestMesh("smpl", rest.astype(np.float32), faces.astype(np.int64))
        if not crops:
            return ContactProbability(np.zeros((0, len(rest)), np.float32), mesh.topology, mesh)
        (contact,) = run_batches(loaded, feed, ["contact"], options.batch)
        if contact.shape != (len(people), len(rest)):
            raise BackendError(
                f"{loaded.network.name} returned contact {contact.shape}: one number for each of {len(people)} "
                f"people and each of the {len(rest)} vertices of its T-pose was expected"
            )
        low, high = float(np.nanmin(contact)), float(np.nanmax(contact))
        if low < -1e-3 or high > 1 + 1e-3:
            raise BackendError(
                f"{loaded.network.name} returned contact from {low:.2g} to {high:.2g}: probabilities were expected; "
                "export the network with its sigmoid"
            )
        return ContactProbability(np.clip(contact, 0, 1).astype(np.float32), mesh.topology, mesh)
