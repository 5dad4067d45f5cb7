"""What adapters of one ONNX file share: finding it, opening it, telling its dialect, saying what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from physic_core.errors import BackendError

from .contract import Dialect, choose
from .options import OnnxOptions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .contract import Match
    from .sessions import Network

__all__ = ["MANIFEST", "OneGraph", "OneGraphOptions", "Speaking", "graph_file"]

MANIFEST = Path(__file__).parent / "weights"
WEIGHTS = "a name of `physic weights list`, or the path of an ONNX file of your own"


class OneGraphOptions(OnnxOptions):
    """Base of the settings of an adapter that runs one file."""

    weights: str = Field("", description=WEIGHTS)


@dataclass(frozen=True)
class Speaking:
    """An open network and the dialect that it speaks.

    Attributes:
        network: open.
        dialect: key in the adapter's table of dialects.
        ports: its inputs and outputs by the adapter's names.
    """

    network: Network
    dialect: str
    ports: Match

    def shape(self, name: str) -> tuple[int | str, ...]:
        """Of an input; a number where the file fixes the size."""
        return self.ports.inputs[name].shape

    def has(self, output: str) -> bool:
        """Whether the file has this output."""
        return output in self.ports.outputs

    def ask(self, name: str, value: NDArray[Any], *outputs: str) -> list[NDArray[Any]]:
        """Feed one input with (1, 3, h, w), or with as many leading axes as the file wants, and take outputs."""
        rank = len(self.shape(name)) or value.ndim
        fed = value.reshape((1,) * (rank - 3) + value.shape[-3:])
        return self.ports.run(self.network, {name: fed}, outputs)


class OneGraph:
    """A backend whose whole network is one ONNX file; mixed in before the interface.

    Attributes:
        dialects: name -> the inputs and outputs of that form of the file, most telling first.
    """

    dialects: ClassVar[Mapping[str, Dialect]]
    options: OneGraphOptions
    _speaking: Speaking | None = None

    def load(self, device: str = "cpu") -> None:
        """Find the file, open it, and hold its inputs and outputs against the known dialects.

        Raises:
            WeightsMissingError: the file is not on this machine.
            DeviceError: the device is not there.
            BackendError: the file is of no known form.
        """
        from .sessions import open_network

        path = graph_file(self.options.weights)
        self.check_file(path)
        self.attach(open_network(path, self.options, device))

    def check_file(self, path: Path) -> None:
        """Refuse a file by what can be told before it is opened."""

    def attach(self, network: Network) -> None:
        """Take an open network.

        Raises:
            BackendError: it is of no known form.
        """
        self._speaking = Speaking(network, *choose(network, self.dialects))

    def close(self) -> None:
        """Drop the network."""
        self._speaking = None

    def missing(self) -> tuple[str, ...]:
        """What is not on this machine, in words."""
        from physic_core.weights import missing

        return missing(MANIFEST, self.options.weights)

    def fingerprint(self) -> str:
        """Of the weights."""
        from physic_core.weights import fingerprint

        return fingerprint(MANIFEST, self.options.weights)

    def speaking(self) -> Speaking:
        """The open network.

        Raises:
            BackendError: it is not loaded.
        """
        if self._speaking is None:
            raise BackendError(f"{type(self).__name__} was asked before its network was loaded: call load() first")
        return self._speaking


def graph_file(weights: str) -> Path:
    """The one ONNX file that an option ``weights`` stands for.

    Raises:
        WeightsMissingError: it, or another file of its set, is not here.
        BackendError: a folder of the user's own that holds several.
    """
    from physic_core.weights import locate, read_manifest

    found = locate(MANIFEST, weights)
    if found.is_file():
        return found
    known = read_manifest(MANIFEST).get(weights)
    names = [file.path for file in known.files] if known is not None else sorted(p.name for p in found.iterdir())
    graphs = [name for name in names if name.endswith(".onnx")]
    if len(graphs) != 1:
        held = ", ".join(graphs) or "none"
        raise BackendError(f"one ONNX file is wanted, and {found} holds {held}: give the path of the file itself")
    return found / graphs[0]
