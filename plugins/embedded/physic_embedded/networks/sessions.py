"""Open the packaged networks with onnxruntime."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from physic_core.errors import BackendError
from physic_networks import onnx_sessions
from physic_networks.networks import NetworkBackend

if TYPE_CHECKING:
    from physic_networks.onnx_sessions import OnnxSession

WEIGHTS_FOLDER = Path(__file__).parents[1] / "weights"
"""Folder of the packaged networks; its ``MANIFEST.json`` describes each of them."""

Products = Literal["auto", "int8", "float32"]
"""Arithmetic of matrix products with weights: auto is int8 on the CPU and float32 elsewhere."""

Threads = Annotated[
    int,
    Field(
        ge=0,
        le=256,
        description="Threads of an operator; 0: one for each core of the process.",
    ),
]
"""Option of a backend that runs packaged networks."""

_BROKEN = "Install metricbody-embedded again from its wheel."


class PackagedBackend(NetworkBackend):
    """Base class of a backend that runs packaged networks; in the list of base classes, it precedes
    the interface.

    Its options have ``threads``, and ``products`` if the arithmetic can be chosen.

    Attributes:
        networks: file names without ``.onnx``.
    """

    networks: ClassVar[tuple[str, ...]]
    weight_options = ()

    def build(self, device: str) -> dict[str, OnnxSession]:
        """Open every network, and return the sessions by name; see
        :func:`open_packaged_session`.
        """
        options: Any = self.options
        products: Products = getattr(options, "products", "auto")
        return {
            name: open_packaged_session(graph_name(name, products, device), options.threads, device)
            for name in self.networks
        }


def graph_name(name: str, products: Products, device: str) -> str:
    """Return the name of a network's graph with the wanted arithmetic; some networks have only
    float32.
    """
    in_int8 = products == "int8" or (products == "auto" and device == "cpu")
    return f"{name}_int8" if in_int8 and (WEIGHTS_FOLDER / f"{name}_int8.onnx").is_file() else name


def open_packaged_session(name: str, threads: int = 2, device: str = "cpu") -> OnnxSession:
    """Open a packaged network by its file name without ``.onnx``.

    Args:
        name: such as "pose_detection".
        threads: threads inside one operator; 0 takes one for each core of the process.
        device: "cpu", "cuda" or "cuda:N".

    Raises:
        BackendError: the package does not contain this network, it has another SHA-256 than in
            ``MANIFEST.json``, or onnxruntime cannot open it.
        DeviceError: the device does not exist, or the installed onnxruntime cannot use it.
    """
    path = WEIGHTS_FOLDER / f"{name}.onnx"
    if not path.is_file():
        have = ", ".join(sorted(p.stem for p in WEIGHTS_FOLDER.glob("*.onnx"))) or "none"
        raise BackendError(
            f"metricbody-embedded contains no network {name!r} (it contains: {have}): "
            "install the package again from its wheel"
        )
    return onnx_sessions.open_session(
        path, threads, device, broken=_BROKEN, published=_published(path)
    )


@cache
def _published(path: Path) -> dict[str, str]:
    """Return the SHA-256 of the graph of a packaged network, and of its weights if they are in
    another file, by name.

    Raises:
        BackendError: ``MANIFEST.json`` is damaged.
    """
    manifest = path.with_name("MANIFEST.json")
    try:
        content = json.loads(manifest.read_bytes())
        files = {entry["file"]: entry for entry in (*content["models"], *content["weights"])}
        weights = files[path.name].get("weights")
        return {
            name: str(files[name]["sha256"]) for name in (path.name, weights) if name is not None
        }
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise BackendError(
            f"{manifest} is damaged: it has no SHA-256 of {path.name}. {_BROKEN}"
        ) from error
