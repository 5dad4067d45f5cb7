"""Base class of backends that run a single ONNX file, whose inputs and outputs must match a known
signature.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from physic_core.errors import BackendError
from physic_core.weights import read_manifest
from physic_networks.networks import NetworkBackend

from .sessions import OnnxOptions, open_network, shape_text

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from .sessions import Network, Port

_FLOATS = ("float32", "float16", "float64")
WEIGHTS_HELP = "a name of `physic weights list`, or the path of an ONNX file of your own"


@dataclass(frozen=True)
class PortSpec:
    """Expected name, type and shape of one input or output ("port") of an ONNX graph.

    Attributes:
        name: what the adapter calls it, and the published file too.
        aliases: what other exports call it.
        dtype: "float32", "int64", ...; "float" for any float type; or several of these.
        shape: a number for a size that the file has or leaves free; a name or None for any size;
            None in place of the shape for any rank.
        optional: whether a file may lack it; a file must not have an input that is not fed.
    """

    name: str
    aliases: tuple[str, ...] = ()
    dtype: str | tuple[str, ...] = "float"
    shape: tuple[int | str | None, ...] | None = None
    optional: bool = False

    def __str__(self) -> str:
        kinds = (self.dtype,) if isinstance(self.dtype, str) else self.dtype
        shape = "any shape"
        if self.shape is not None:
            shape = shape_text("?" if d is None else d for d in self.shape)
        others = f" (or {', '.join(self.aliases)})" if self.aliases else ""
        return f"{self.name}{others} {' or '.join(kinds)} {shape}" + (
            ", optional" if self.optional else ""
        )


@dataclass(frozen=True)
class GraphSignature:
    """Inputs and outputs of one published form of a network.

    Attributes:
        inputs: all of them.
        outputs: those that are needed; a file may have others.
        by_position: whether a port of another name may serve if its place, its type and its rank
            are right.
    """

    inputs: tuple[PortSpec, ...]
    outputs: tuple[PortSpec, ...]
    by_position: bool = False


@dataclass(frozen=True, eq=False)
class LoadedGraph:
    """Open network whose inputs and outputs ("ports") have the names that the backend uses.

    Attributes:
        network: open.
        signature: name of the form of the file that it matches.
        inputs: what the backend calls it -> port of the file.
        outputs: the same of outputs, in the order of the signature.
    """

    network: Network
    signature: str
    inputs: Mapping[str, Port]
    outputs: Mapping[str, Port]

    def run(self, feed: Mapping[str, NDArray[Any]], outputs: Iterable[str]) -> list[NDArray[Any]]:
        """Run the network, and return the named outputs."""
        given = {self.inputs[name].name: value for name, value in feed.items()}
        return self.network.run(given, [self.outputs[name].name for name in outputs])


def match_signature(network: Network, signatures: Mapping[str, GraphSignature]) -> LoadedGraph:
    """Return a network with the first signature that it matches.

    Raises:
        BackendError: no signature matches; the message compares each of them with the network.
    """
    expected = []
    for name, signature in signatures.items():
        ins, faults = _assign("input", signature.inputs, network.inputs, signature.by_position)
        outs, more = _assign("output", signature.outputs, network.outputs, signature.by_position)
        served = {port.name for port in ins.values()}
        faults += [
            f"nothing is known of its input {other!r}"
            for other in network.inputs
            if other not in served
        ]
        faults += more
        if not faults:
            return LoadedGraph(network, name, ins, outs)
        expected += [
            f"expected of {name}:",
            f"  inputs:  {'; '.join(map(str, signature.inputs))}",
            f"  outputs: {'; '.join(map(str, signature.outputs))}",
            f"  but {'; '.join(faults)}",
        ]
    found = [
        "found:",
        f"  inputs:  {'; '.join(map(str, network.inputs.values())) or 'none'}",
        f"  outputs: {'; '.join(map(str, network.outputs.values())) or 'none'}",
    ]
    raise BackendError(
        "\n".join(
            [f"{network.name} is not a network that this backend can run:", *expected, *found]
        )
    )


def _assign(
    kind: str, wanted: Sequence[PortSpec], ports: Mapping[str, Port], by_position: bool
) -> tuple[dict[str, Port], list[str]]:
    """Assign ports to specs, and return the assignment and the mismatches."""
    found: dict[str, Port] = {}
    faults = []
    for want in wanted:
        named = next((ports[name] for name in (want.name, *want.aliases) if name in ports), None)
        if named is not None:
            found[want.name] = named
            if not _fits(want, named, kind):
                faults.append(f"{kind} {named} has another form")
    taken = {port.name for port in found.values()}
    for place, want in enumerate(wanted):
        if want.name in found:
            continue
        there = list(ports.values())[place] if by_position and place < len(ports) else None
        if there is not None and there.name not in taken and _fits(want, there, kind):
            found[want.name] = there
            taken.add(there.name)
        elif not want.optional:
            faults.append(f"there is no {kind} {want.name!r}")
    return {want.name: found[want.name] for want in wanted if want.name in found}, faults


def _fits(want: PortSpec, port: Port, kind: str) -> bool:
    """Return whether type and shape of a port fit a spec."""
    kinds = (want.dtype,) if isinstance(want.dtype, str) else want.dtype
    if port.dtype not in {k for name in kinds for k in (_FLOATS if name == "float" else (name,))}:
        return False
    # an output's shape may be unstated
    if want.shape is None or (kind == "output" and not port.shape):
        return True
    if len(want.shape) != len(port.shape):
        return False
    pairs = zip(want.shape, port.shape, strict=True)
    return all(w == p for w, p in pairs if isinstance(w, int) and isinstance(p, int))


class OnnxBackendOptions(OnnxOptions):
    """Base class of the settings of a backend that runs one ONNX file."""

    weights: str = Field("", description=WEIGHTS_HELP)


class OnnxBackend(NetworkBackend):
    """Base class of a backend that runs a single ONNX file.

    Attributes:
        signatures: name -> the inputs and outputs of that form of the file, most specific first.
    """

    signatures: ClassVar[Mapping[str, GraphSignature]]
    options: OnnxBackendOptions

    def build(self, device: str) -> LoadedGraph:
        """Find the file, open it, and match its inputs and outputs against the known signatures."""
        return self.match(open_network(self.graph_file(), self.options, device))

    def match(self, network: Network) -> LoadedGraph:
        """Match the inputs and outputs of an open network to the known signatures.

        Raises:
            BackendError: its form is unknown.
        """
        return match_signature(network, self.signatures)

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
        names = (
            [file.path for file in known.files]
            if known is not None
            else sorted(p.name for p in found.iterdir())
        )
        graphs = [name for name in names if name.endswith(".onnx")]
        if len(graphs) != 1:
            held = ", ".join(graphs) or "none"
            raise BackendError(
                f"one ONNX file is wanted, and {found} holds {held}: give the path of the file "
                f"itself"
            )
        return found / graphs[0]
