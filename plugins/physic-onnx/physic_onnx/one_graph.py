"""Base class of backends that run a single ONNX file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from physic_core.adapters.networks import NetworkBackend
from physic_core.errors import BackendError
from physic_core.weights import read_manifest

from .contract import GraphSignature, match_signature
from .options import OnnxOptions
from .sessions import open_network

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from .contract import PortMatch
    from .sessions import Network

WEIGHTS_HELP = "a name of `physic weights list`, or the path of an ONNX file of your own"


class OnnxBackendOptions(OnnxOptions):
    """Base class of the settings of a backend that runs one ONNX file."""

    weights: str = Field("", description=WEIGHTS_HELP)


@dataclass(frozen=True)
class LoadedGraph:
    """Open network with its matched signature, inputs and outputs.

    Attributes:
        network: open.
        signature: key in the adapter's table of signatures.
        ports: its inputs and outputs by the adapter's names.
    """

    network: Network
    signature: str
    ports: PortMatch

    def input_shape(self, name: str) -> tuple[int | str, ...]:
        """Return the shape of an input; a number is a fixed size."""
        return self.ports.inputs[name].shape

    def has_output(self, output: str) -> bool:
        """Return whether the network has the output ``output``."""
        return output in self.ports.outputs

    def run_image(self, name: str, value: NDArray[Any], *outputs: str) -> list[NDArray[Any]]:
        """Run the network on one image and return the named outputs.

        Axes of length 1 are added in front of the image up to the rank of the input.
        """
        rank = len(self.input_shape(name)) or value.ndim
        fed = value.reshape((1,) * (rank - 3) + value.shape[-3:])
        return self.ports.run(self.network, {name: fed}, outputs)


class OnnxBackend(NetworkBackend):
    """Base class of a backend that runs a single ONNX file.

    Attributes:
        signatures: name -> the inputs and outputs of that form of the file, most telling first.
    """

    signatures: ClassVar[Mapping[str, GraphSignature]]
    options: OnnxBackendOptions

    def build(self, device: str) -> LoadedGraph:
        """Find the file, open it, and match its inputs and outputs against the known signatures."""
        path = self.graph_file()
        self.check_file(path)
        return self.match(open_network(path, self.options, device))

    def check_file(self, path: Path) -> None:
        """Raise BackendError for a file that can be rejected before it is opened."""

    def match(self, network: Network) -> LoadedGraph:
        """Match the inputs and outputs of an open network to the known signatures.

        Raises:
            BackendError: it is of no known form.
        """
        return LoadedGraph(network, *match_signature(network, self.signatures))

    def graph_file(self) -> Path:
        """Return the path of the one ONNX file that the option ``weights`` names.

        Raises:
            WeightsMissingError: it, or another file of its set, is not here.
            BackendError: a folder of the user's own that holds several.
        """
        found = self.file()
        if found.is_file():
            return found
        known = read_manifest(self.manifest()).get(self.options.weights)
        names = [file.path for file in known.files] if known is not None else sorted(p.name for p in found.iterdir())
        graphs = [name for name in names if name.endswith(".onnx")]
        if len(graphs) != 1:
            held = ", ".join(graphs) or "none"
            raise BackendError(f"one ONNX file is wanted, and {found} holds {held}: give the path of the file itself")
        return found / graphs[0]
