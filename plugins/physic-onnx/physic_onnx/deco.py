"""DECO (Tripathi et al. 2023) as exported by its licensed user: which vertices of SMPL touch something.

``python -m physic_onnx.export deco`` writes the file, with SMPL's T-pose beside the network, by which labels are
carried to other bodies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.adapters.contact_crop import BOX_GROWTH, INPUT_SIDE
from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior

from .contract import Dialect, Wanted
from .one_graph import WEIGHTS, OneGraph, OneGraphOptions

if TYPE_CHECKING:
    from physic_core.types import Bodies, ContactProbability, People, UInt8Array

__all__ = ["Deco", "DecoOptions"]


class DecoOptions(OneGraphOptions):
    """Settings of DECO."""

    weights: str = Field("deco-onnx", description=WEIGHTS)
    growth: float = Field(BOX_GROWTH, ge=0, le=1, description="of a person's box on every side, in its own sizes")
    fit: Literal["letterbox", "squash"] = Field(
        "letterbox",
        description="how a box becomes a square: with white, as in the PhySIC paper's code, or stretched, as in DECO's",
    )
    batch: int = Field(8, ge=1, description="people a run, where the file leaves that free")


class Deco(OneGraph, ContactPrior):
    """Contact of any kind, whatever is touched: above 0.5 it touches. It is shown BGR, as it was trained."""

    Options: ClassVar[type[OneGraphOptions]] = DecoOptions
    options: DecoOptions
    dialects: ClassVar = {
        "physic_onnx.export deco": Dialect(
            (Wanted("image", ("img", "input"), shape=(None, 3, INPUT_SIDE, INPUT_SIDE)),),
            (
                Wanted("contact", ("cont",), shape=(None, None)),
                Wanted("faces", dtype=("int64", "int32"), shape=(None, 3)),
                Wanted("rest", shape=(None, 3)),
            ),
        ),
    }

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """N people -> probability (N, 6890) on SMPL.

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """

        from physic_core.adapters.contact_crop import contact_crop
        from physic_core.types import ContactProbability, RestMesh

        from .top_down import held, run_rows

        speaking = self.speaking()
        options = self.options
        crops = [contact_crop(image, box, growth=options.growth, fit=options.fit) for box in people.boxes]
        feed = {"image": np.stack(crops) if crops else np.zeros((1, 3, INPUT_SIDE, INPUT_SIDE), np.float32)}
        faces, rest = held(speaking, feed, ["faces", "rest"])
        mesh = RestMesh("smpl", rest.astype(np.float32), faces.astype(np.int64))
        if not crops:
            return ContactProbability(np.zeros((0, len(rest)), np.float32), mesh.topology, mesh)
        (contact,) = run_rows(speaking, feed, ["contact"], options.batch)
        if contact.shape != (len(people), len(rest)):
            raise BackendError(
                f"{speaking.network.name} answered contact {contact.shape}: one number for each of {len(people)} "
                f"people and each of the {len(rest)} vertices of its T-pose was expected"
            )
        low, high = float(np.nanmin(contact)), float(np.nanmax(contact))
        if low < -1e-3 or high > 1 + 1e-3:
            raise BackendError(
                f"{speaking.network.name} answered contact from {low:.2g} to {high:.2g}: probabilities were expected; "
                "export the network with its sigmoid"
            )
        return ContactProbability(np.clip(contact, 0, 1).astype(np.float32), mesh.topology, mesh)
