"""Run ONNX files, and the base class of backends that run one.

A manifest states the SHA-256 of each file, which is compared before it is opened. So a backend
knows the ports of its file.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import Options
from physic_networks.networks import NetworkBackend, check_network_output
from physic_networks.onnx_sessions import open_session

if TYPE_CHECKING:
    from physic_core.types import AnyArray
    from physic_networks.onnx_sessions import OnnxSession

ProviderName = Literal["auto", "cpu", "cuda", "tensorrt", "coreml", "directml"]


class OnnxOptions(Options):
    """Base class of the settings of backends that run ONNX files: provider and threads.

    Inputs are cast to the type that the file states, such as half precision.
    """

    provider: ProviderName = Field(
        "auto",
        description="what onnxruntime computes with; 'auto' follows the device: the CPU, or CUDA "
        "on an NVIDIA GPU",
    )
    threads: int = Field(
        2, ge=0, le=256, description="threads on the CPU; 0: one for each core of the process"
    )


@dataclass(frozen=True)
class Port:
    """Input or output of an ONNX graph.

    Attributes:
        name: in the file.
        dtype: "float32", "float16", "int64", "uint8", ...
        shape: a number for a fixed size, a name for a free one; () for a scalar, and for an output
            of unknown shape.
    """

    name: str
    dtype: str
    shape: tuple[int | str, ...]


class Network:
    """Loaded ONNX network.

    Attributes:
        name: file name without its folder.
        inputs: name -> port, in the file's order.
        outputs: name -> port, in the file's order.
        provider: execution provider that runs it: "CPU", "CUDA", ...
    """

    def __init__(self, session: OnnxSession, path: Path) -> None:
        self.name = path.name
        self.provider = session.provider.name
        self.inputs: Mapping[str, Port] = {
            node.name: _port_of_node(node) for node in session.session.get_inputs()
        }
        self.outputs: Mapping[str, Port] = {
            node.name: _port_of_node(node) for node in session.session.get_outputs()
        }
        self._session = session

    def run(self, feed: Mapping[str, AnyArray], outputs: Sequence[str]) -> list[AnyArray]:
        """Run the network once.

        Args:
            feed: input -> array; floats are cast to the file's float type, integers to its integer
                type.
            outputs: names of the outputs to return.

        Returns:
            One array for each output, in order; float16 becomes float32.

        Raises:
            BackendError: an input does not fit, onnxruntime fails, or no number of an output is
                finite.
        """
        inputs = {name: self._cast(name, value) for name, value in feed.items()}
        try:
            answers = self._session.run(outputs, inputs)
        except Exception as cause:  # onnxruntime's own exceptions share no public base class
            shapes = ", ".join(
                f"{name} {value.dtype} {value.shape}" for name, value in inputs.items()
            )
            raise BackendError(
                f"onnxruntime failed to run {self.name} on {self.provider} with {shapes}: {cause}"
            ) from cause
        for name, value in zip(outputs, answers, strict=True):
            check_network_output(value, f"{self.name} (output {name!r})")
        return [
            value.astype(np.float32) if value.dtype == np.float16 else value for value in answers
        ]

    def answer(self, value: AnyArray) -> list[AnyArray]:
        """Run a network of one input, and return all outputs in the file's order."""
        (name,) = self.inputs
        return self.run({name: value}, list(self.outputs))

    def _cast(self, name: str, value: AnyArray) -> AnyArray:
        """Cast an array to the type of an input."""
        value = np.asarray(value)
        wanted = self.inputs[name].dtype
        if value.dtype.name == wanted:
            return np.require(value, requirements="C")
        kinds = {"f": ("float16", "float32", "float64"), "i": ("int32", "int64")}
        if wanted not in kinds.get(value.dtype.kind, ()):
            raise BackendError(f"input {name!r} of {self.name} takes {wanted}, got {value.dtype}")
        return np.require(value, dtype=wanted, requirements="C")


def open_network(path: Path, options: OnnxOptions, device: str) -> Network:
    """Open an ONNX file.

    Args:
        path: file; its external data files are read from the same folder.
        options: provider and threads.
        device: "cpu", "cuda" or "cuda:N", which provider "auto" follows.

    Raises:
        DeviceError: the device does not exist, or the provider is not installed or does not start.
        BackendError: the file is missing or broken, or an external data file is missing.
    """
    if not path.is_file():
        raise BackendError(
            f"there is no file {path}: `physic weights list` lists the weights that can be fetched"
        )
    broken = (
        "If the file is broken or cut short, `physic weights verify` reports it, and `physic "
        "weights fetch` fetches it again"
    )
    # onnxruntime 1.31 makes a border of zeros part of a max pool, where it counts as -infinity.
    without = ("Pad_Fusion",) if _has_operator(path, b"MaxPool") else ()
    session = open_session(
        path, options.threads, device, options.provider, broken=broken, without=without
    )
    return Network(session, path)


def _has_operator(path: Path, start: bytes) -> bool:
    """Return whether an ONNX file, which holds the names of its operators as text, has one that
    starts so.
    """
    if path.stat().st_size == 0:  # which cannot be mapped
        return False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return content.find(start) >= 0


def _port_of_node(node: Any) -> Port:
    """Convert onnxruntime's description of an input or output."""
    kind = re.sub(r"^tensor\((.*)\)$", r"\1", node.type)
    names = {"float": "float32", "double": "float64"}
    # onnxruntime gives None for a dimension without a name. Some exporters write a negative number
    # for a free one.
    shape = tuple(
        d if isinstance(d, str) or (isinstance(d, int) and d >= 0) else "?"
        for d in node.shape or ()
    )
    return Port(node.name, names.get(kind, kind), shape)


class OnnxBackend(NetworkBackend):
    """Base class of a backend that runs a single ONNX file."""

    options: OnnxOptions

    def build(self, device: str) -> Network:
        """Open the file of the set that the option ``weights`` names."""
        place = self.file()
        graph = place if place.is_file() else next(place.glob("*.onnx"))
        return open_network(graph, self.options, device)
