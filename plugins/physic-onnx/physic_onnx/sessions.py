"""Opening ONNX files with onnxruntime, and running them."""

from __future__ import annotations

import logging
import mmap
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import BackendError, DeviceError

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from onnxruntime import InferenceSession

    from .options import OnnxOptions

__all__ = ["Network", "Port", "Provider", "open_network", "wanted_provider"]

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Port:
    """An input or an output of a graph.

    Attributes:
        name: as the file calls it.
        dtype: "float32", "float16", "int64", "uint8", ...
        shape: a number where the file fixes the size, a name where it is free; () of a scalar, and of an output whose
            shape the file does not tell.
    """

    name: str
    dtype: str
    shape: tuple[int | str, ...]


@dataclass(frozen=True)
class Provider:
    """What onnxruntime can compute with.

    Attributes:
        name: in options and in words for the user.
        key: onnxruntime's name.
        install: how to get it.
    """

    name: str
    key: str
    install: str


_GPU = "install onnxruntime-gpu in place of onnxruntime"
_PROVIDERS = {
    "cpu": Provider("CPU", "CPUExecutionProvider", "install onnxruntime"),
    "cuda": Provider("CUDA", "CUDAExecutionProvider", _GPU),
    "tensorrt": Provider("TensorRT", "TensorrtExecutionProvider", f"{_GPU}, and TensorRT beside it"),
    "coreml": Provider("CoreML", "CoreMLExecutionProvider", "use the onnxruntime for macOS, which carries it"),
    "directml": Provider("DirectML", "DmlExecutionProvider", "install onnxruntime-directml in place of onnxruntime"),
}


class Network:
    """One open graph.

    Attributes:
        name: of the file, without its folder.
        inputs: name -> port, in the file's order.
        outputs: name -> port, in the file's order.
        provider: what it really runs on, in words: "CPU", "CUDA", ...
    """

    def __init__(self, session: InferenceSession, name: str, provider: str) -> None:
        self.name = name
        self.provider = provider
        self.inputs: Mapping[str, Port] = {port.name: _port(port) for port in session.get_inputs()}
        self.outputs: Mapping[str, Port] = {port.name: _port(port) for port in session.get_outputs()}
        self._session = session
        self._run_options = _giving_memory_back() if provider == "CPU" else None

    def run(self, feed: Mapping[str, NDArray[Any]], outputs: Sequence[str]) -> list[NDArray[Any]]:
        """Run the graph once.

        Args:
            feed: input -> array; floats are cast to the float type of the file, integers to its integer type.
            outputs: names of what is wanted.

        Returns:
            One array an output, in the order asked for; float16 comes as float32.

        Raises:
            BackendError: an input does not fit, or onnxruntime fails.
        """

        given = {name: self._cast(name, value) for name, value in feed.items()}
        try:
            found = self._session.run(list(outputs), given, self._run_options)
        except Exception as cause:  # onnxruntime's own exceptions share no public base class
            shapes = ", ".join(f"{name} {value.dtype} {value.shape}" for name, value in given.items())
            raise BackendError(
                f"onnxruntime failed to run {self.name} on {self.provider} with {shapes}: {cause}"
            ) from cause
        return [value.astype(np.float32) if value.dtype == np.float16 else value for value in found]

    def _cast(self, name: str, value: NDArray[Any]) -> NDArray[Any]:

        value = np.asarray(value)
        if name not in self.inputs:
            raise BackendError(f"{self.name} has no input {name!r}; it has {', '.join(self.inputs)}")
        wanted = self.inputs[name].dtype
        if value.dtype.name == wanted:
            return np.require(value, requirements="C")
        kinds = {"f": ("float16", "float32", "float64"), "i": ("int32", "int64")}
        if wanted not in kinds.get(value.dtype.kind, ()):
            raise BackendError(f"input {name!r} of {self.name} takes {wanted}, and {value.dtype} was fed")
        return np.require(value, dtype=wanted, requirements="C")


def open_network(path: Path, options: OnnxOptions, device: str) -> Network:
    """Open an ONNX file.

    Args:
        path: the file; weights that it keeps in other files are looked for beside it.
        options: the provider and the threads.
        device: "cpu", "cuda" or "cuda:1", which provider "auto" follows.

    Raises:
        DeviceError: the provider or the device is not there, or does not start.
        BackendError: the file is missing, broken, or misses its other files.
    """
    import onnxruntime as ort

    provider, settings = wanted_provider(options.provider, device, ort.get_available_providers())
    if not path.is_file():
        raise BackendError(f"there is no file {path}: `physic weights list` says what there is to fetch")
    session_options = ort.SessionOptions()
    session_options.intra_op_num_threads = options.threads
    session_options.log_severity_level = 4 if provider.name != "CPU" else 3  # what fails to start is told below
    # Photos have all sizes: memory planned for one would be kept for each.
    session_options.enable_mem_pattern = False
    try:
        session = ort.InferenceSession(str(path), session_options, providers=[*settings, *_reserve(provider)])
    except Exception as cause:  # onnxruntime's own exceptions share no public base class
        raise _cannot_open(path, provider, cause) from cause
    running = session.get_providers()
    if provider.key not in running:
        others = ", ".join(running)
        raise DeviceError(
            f"onnxruntime {ort.__version__} offers {provider.name} but could not start it on this machine, and would "
            f"run {path.name} with {others}: check that the driver and its libraries fit this onnxruntime, "
            "or choose provider 'cpu'"
        )
    _LOG.info("%s runs on %s (onnxruntime %s)", path.name, provider.name, ort.__version__)
    return Network(session, path.name, provider.name)


def wanted_provider(
    name: str, device: str, available: Sequence[str]
) -> tuple[Provider, list[str | tuple[str, dict[str, str]]]]:
    """The execution provider for an option and a device, and how to ask onnxruntime for it.

    Args:
        name: of the option, "auto" or one of the providers.
        device: "cpu", "cuda" or "cuda:N".
        available: what the installed onnxruntime was built with.

    Raises:
        DeviceError: there is no such device, or onnxruntime was built without this provider.
    """
    found = re.fullmatch(r"(cpu|cuda)(?::(\d+))?", device)
    if not found or (found[1] == "cpu" and found[2]):
        raise DeviceError(f"unknown device {device!r}: use 'cpu', 'cuda' or 'cuda:N'")
    key = found[1] if name == "auto" else name
    provider = _PROVIDERS[key]
    if provider.key not in available:
        has = ", ".join(f"'{short}'" for short, other in _PROVIDERS.items() if other.key in available)
        why = f"device {device!r} needs" if name == "auto" else f"provider {name!r} is"
        raise DeviceError(
            f"{why} {provider.name}, and the installed onnxruntime has only {has or 'none of ours'}: "
            f"{provider.install}, or choose " + ("device 'cpu'" if name == "auto" else "provider 'cpu'")
        )
    index = {"device_id": found[2] or "0"}
    if key == "cuda":
        # Without it each growth doubles what is held, and other networks share the GPU.
        return provider, [(provider.key, {**index, "arena_extend_strategy": "kSameAsRequested"})]
    if key == "tensorrt":
        return provider, [(provider.key, index), ("CUDAExecutionProvider", index)]
    if key == "directml":
        return provider, [(provider.key, index)]
    return provider, [provider.key]


def _reserve(provider: Provider) -> list[str]:
    """For the few operators that the provider does not have."""
    return [] if provider.name == "CPU" else ["CPUExecutionProvider"]


def _giving_memory_back() -> Any:
    """Run options that free the arena's unused memory after each run.

    Without it the networks of one photo together hold about three times as much; without an arena at all, the large
    ones take twice as long.
    """
    import onnxruntime as ort

    shrink = ort.RunOptions()
    shrink.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
    return shrink


def _cannot_open(path: Path, provider: Provider, cause: Exception) -> BackendError:
    absent = [name for name in _other_files(path) if not (path.parent / name).is_file()]
    if absent:
        return BackendError(
            f"{path.name} keeps its weights in other files, and {', '.join(absent)} is not in {path.parent}: "
            "put it there, under this name (`physic weights fetch` fetches all files of a set)"
        )
    return BackendError(
        f"onnxruntime cannot open {path} with {provider.name}: {cause}. If the file is broken or cut short, "
        "`physic weights verify` tells, and `physic weights fetch` fetches it again"
    )


def _other_files(path: Path) -> list[str]:
    """Names of the files that a graph keeps its tensors in, read off its bytes: the entry "location" of each tensor."""
    if not path.stat().st_size:
        return []
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        # A protobuf of two texts, fields 1 and 2, each with its length.
        found = [
            data[m.end() : m.end() + data[m.end() - 1]] for m in re.finditer(rb"\x0a\x08location\x12[\x01-\x7f]", data)
        ]
    return sorted({name.decode("utf-8", "replace") for name in found})


def _port(node: Any) -> Port:
    kind = re.sub(r"^tensor\((.*)\)$", r"\1", node.type)
    names = {"float": "float32", "double": "float64"}
    # A dimension without a name comes as None, a negative one is what some exporters write for a free one.
    shape = tuple(d if isinstance(d, str) or (isinstance(d, int) and d >= 0) else "?" for d in node.shape or ())
    return Port(node.name, names.get(kind, kind), shape)
