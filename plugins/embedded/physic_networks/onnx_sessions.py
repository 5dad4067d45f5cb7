"""Open ONNX files with onnxruntime, which is imported when the first file is opened."""

from __future__ import annotations

import hashlib
import logging
import os
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from physic_core.backends.devices import DEVICE_PATTERN
from physic_core.cache import cached_network_result
from physic_core.errors import BackendError, DeviceError
from physic_networks.optimised_graphs import KeptGraph
from physic_networks.runtime import onnxruntime

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from onnxruntime import InferenceSession, SessionOptions

    from physic_core.types import AnyArray

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ExecutionProvider:
    """Execution provider of onnxruntime.

    Attributes:
        name: in options and messages.
        key: onnxruntime's name.
        install: advice on how to install it.
    """

    name: str
    key: str
    install: str


@dataclass(eq=False)
class OnnxSession:
    """An ONNX file that is opened with onnxruntime.

    Attributes:
        session: onnxruntime's session.
        provider: execution provider that runs it.
        name: of the file, without its ending.
        made_of: SHA-256s of its files, runtime and threads; "" if no SHA-256 is published.
    """

    session: InferenceSession
    provider: ExecutionProvider
    name: str = ""
    made_of: str = ""

    def run(
        self,
        outputs: Sequence[str] | None,
        inputs: Mapping[str, AnyArray],
        *,
        keep: bool = False,
        beside: Mapping[str, Callable[[AnyArray], None]] = MappingProxyType({}),
    ) -> list[Any]:
        """Run the network and return the named outputs in that order, or all outputs for None.

        Args:
            outputs: their names.
            inputs: by name.
            keep: keep the outputs in the cache of backend results, and take them from it for equal
                inputs. Useful if running takes much longer than reading, and if the backend has
                inputs that the network does not get. Outputs are kept only if SHA-256s of the files
                are published.
            beside: other outputs by name, given to these functions if the network runs, and never
                kept; needs the names of ``outputs``.
        """
        names = None if outputs is None else list(outputs)

        def compute() -> tuple[Any, ...]:
            wanted = None if names is None else [*names, *beside]
            outputs = self.session.run(wanted, dict(inputs))
            others = [outputs.pop() for _ in beside]
            for give, other in zip(beside.values(), reversed(others), strict=True):
                give(other)
            return tuple(outputs)

        if not keep or not self.made_of:
            return list(compute())
        return list(cached_network_result(self.name, f"{self.made_of} {names}", inputs, compute))


def open_session(
    path: Path,
    threads: int,
    device: str,
    provider: str = "auto",
    *,
    broken: str,
    published: Mapping[str, str] = MappingProxyType({}),
    without: Sequence[str] = (),
) -> OnnxSession:
    """Open an ONNX file.

    Args:
        path: file; its external data files are read from the same folder. Each may be a link, as
            in the cache of Hugging Face.
        threads: threads inside one operator on the CPU; 0 takes one for each core that the process
            may use.
        device: "cpu", "cuda" or "cuda:N".
        provider: "auto" follows the device; or "cpu", "cuda", "tensorrt", "coreml", "directml".
        broken: advice for a file that cannot be opened.
        published: SHA-256 by name of the file and of all its external data files. Exactly the
            compared bytes are used, or the graph that onnxruntime optimised for the CPU is read
            from the cache. Empty for no comparison and no cache.
        without: onnxruntime's names of optimisations to leave out.

    Raises:
        DeviceError: the device does not exist, or the provider is not installed or does not start.
        BackendError: a file is broken, missing, or has another SHA-256.
    """
    ort = onnxruntime()

    threads = threads or _usable_cores()
    chosen, settings = select_provider(provider, device, ort.get_available_providers())
    _register_shared_arena()
    file = _OnnxFile(path, published, chosen, settings, threads, without, broken)
    session = file.open_optimised() or file.open()
    _require_provider(session, chosen, path)
    runtime = f"{chosen.name}, onnxruntime {ort.__version__}"
    _LOG.info("%s runs on %s", path.name, runtime)
    made_of = " ".join((*published.values(), runtime, f"{threads} threads")) if published else ""
    return OnnxSession(session, chosen, path.stem, made_of)


@dataclass(frozen=True)
class _OnnxFile:
    """An ONNX file, and how to open it: see :func:`open_session`."""

    path: Path
    published: Mapping[str, str]
    provider: ExecutionProvider
    settings: list[str | tuple[str, dict[str, str]]]
    threads: int
    without: Sequence[str]
    broken: str

    def open_optimised(self) -> InferenceSession | None:
        """Open the graph that onnxruntime optimised for the CPU from the cache, where it is written
        if it is not there; None if there is none.
        """
        if not self.published or self.provider.name != "CPU":
            return None
        kept = KeptGraph.of(self.path.stem, " ".join(self.published.values()))
        if kept is None:
            return None
        if (session := self._open_stored(kept)) is not None:
            return session
        session = kept.write(self._optimise)
        # The kept weights are mapped into memory, those of the session that wrote them are copies.
        return (session and self._open_stored(kept)) or session

    def open(self) -> InferenceSession:
        """Open the file itself.

        Raises:
            BackendError: a file is broken, missing, or has another SHA-256.
        """
        options = _session_options(self.threads, self.provider)
        try:
            if self.published:
                return self._create_compared(options)
            return self._create(str(self.path), options)
        except BackendError:
            raise
        except Exception as cause:
            raise BackendError(
                f"onnxruntime cannot open {self.path} with {self.provider.name}: {cause}. "
                f"{self.broken}"
            ) from cause

    def _create(self, content: bytes | str, options: SessionOptions) -> InferenceSession:
        ort = onnxruntime()

        # The CPU runs the few operators that another provider does not implement.
        cpu = [] if self.provider.name == "CPU" else ["CPUExecutionProvider"]
        return ort.InferenceSession(
            content,
            options,
            providers=[*self.settings, *cpu],
            disabled_optimizers=list(self.without),
        )

    # onnxruntime reads ``contents`` while it creates the session: they must live until then.
    def _create_compared(self, options: SessionOptions) -> InferenceSession:
        contents = {
            name: _read_compared(self.path.with_name(name), sha256, self.broken)
            for name, sha256 in self.published.items()
        }
        graph = contents.pop(self.path.name)
        options.add_external_initializers_from_files_in_memory(
            list(contents), list(contents.values()), list(map(len, contents.values()))
        )
        return self._create(graph, options)

    def _optimise(self, graph: Path, weights: str) -> InferenceSession:
        options = _session_options(self.threads, self.provider)
        options.optimized_model_filepath = str(graph)
        external = "session.optimized_model_external_initializers"
        options.add_session_config_entry(f"{external}_file_name", weights)
        options.add_session_config_entry(f"{external}_min_size_in_bytes", "1024")
        return self._create_compared(options)

    def _open_stored(self, kept: KeptGraph) -> InferenceSession | None:
        if (content := kept.read()) is None:
            return None
        options = _session_options(self.threads, self.provider)
        # For a graph that is opened by its path, it would refuse links to other folders.
        options.add_session_config_entry(
            "session.model_external_initializers_file_folder_path", str(kept.kept.path)
        )
        options.graph_optimization_level = onnxruntime().GraphOptimizationLevel.ORT_DISABLE_ALL
        try:
            return self._create(content, options)
        except Exception:  # onnxruntime's own exceptions share no public base class
            kept.delete()
            return None


def _usable_cores() -> int:
    """Return the number of cores that the process may use.

    onnxruntime's own choice ignores them: it starts a thread for each core of the machine, and pins
    it there.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _session_options(threads: int, provider: ExecutionProvider) -> SessionOptions:
    ort = onnxruntime()

    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    # Level 4 hides the errors of a provider that does not start: they are raised by the caller.
    options.log_severity_level = 3 if provider.name == "CPU" else 4
    # Photos have all sizes. Memory planned for one size would stay allocated for each.
    options.enable_mem_pattern = False
    if provider.name == "CPU":
        # Planning which outputs share memory takes half the time of opening a graph without fixed
        # sizes. The arena reuses memory anyway.
        options.enable_mem_reuse = False
    options.add_session_config_entry("session.use_env_allocators", "1")
    # Threads that spin while they wait take processor time from others, and end later themselves.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return options


_GPU = "install onnxruntime-gpu in place of onnxruntime"

_PROVIDERS = {
    "cpu": ExecutionProvider("CPU", "CPUExecutionProvider", "install onnxruntime"),
    "cuda": ExecutionProvider("CUDA", "CUDAExecutionProvider", _GPU),
    "tensorrt": ExecutionProvider(
        "TensorRT", "TensorrtExecutionProvider", f"{_GPU}, and TensorRT beside it"
    ),
    "coreml": ExecutionProvider(
        "CoreML", "CoreMLExecutionProvider", "use the onnxruntime for macOS, which contains it"
    ),
    "directml": ExecutionProvider(
        "DirectML", "DmlExecutionProvider", "install onnxruntime-directml in place of onnxruntime"
    ),
}


def select_provider(
    name: str, device: str, available: Sequence[str]
) -> tuple[ExecutionProvider, list[str | tuple[str, dict[str, str]]]]:
    """Return the execution provider for a provider name and a device, and onnxruntime's settings of
    the provider.

    Args:
        name: "auto", "cpu", "cuda", "tensorrt", "coreml" or "directml".
        device: "cpu", "cuda" or "cuda:N".
        available: providers of the installed onnxruntime.

    Raises:
        DeviceError: the device does not exist, or the installed onnxruntime has no such provider.
    """
    match = DEVICE_PATTERN.fullmatch(device)
    if not match:
        raise DeviceError(f"unknown device {device!r}: use 'cpu', 'cuda' or 'cuda:N'")
    key = device.partition(":")[0] if name == "auto" else name
    provider = _PROVIDERS[key]
    if provider.key not in available:
        has = ", ".join(
            f"'{short}'" for short, other in _PROVIDERS.items() if other.key in available
        )
        why = f"device {device!r} needs" if name == "auto" else f"provider {name!r} is"
        raise DeviceError(
            f"{why} {provider.name}, and the installed onnxruntime has only "
            f"{has or 'unknown providers'}: {provider.install}, or choose "
            + ("device 'cpu'" if name == "auto" else "provider 'cpu'")
        )
    index = {"device_id": match[1] or "0"}
    if key == "cuda":
        # The default strategy doubles the allocated memory at each growth, and other networks share
        # the GPU.
        return provider, [(provider.key, {**index, "arena_extend_strategy": "kSameAsRequested"})]
    if key == "tensorrt":
        return provider, [(provider.key, index), ("CUDAExecutionProvider", index)]
    if key == "directml":
        return provider, [(provider.key, index)]
    return provider, [provider.key]


def _read_compared(path: Path, sha256: str, broken: str) -> bytes:
    """Return the bytes of a file after comparing their SHA-256; the file may change later."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise BackendError(f"{path} cannot be read: {error.strerror}. {broken}") from error
    digest = hashlib.sha256(content).hexdigest()
    if digest != sha256:
        raise BackendError(
            f"{path} is damaged: its SHA-256 is {digest} instead of {sha256}. {broken}"
        )
    return content


def _require_provider(session: InferenceSession, chosen: ExecutionProvider, path: Path) -> None:
    """Raise DeviceError if a session does not run with the chosen provider."""
    ort = onnxruntime()

    running = session.get_providers()
    if chosen.key not in running:
        raise DeviceError(
            f"onnxruntime {ort.__version__} offers {chosen.name} but could not start it on this "
            f"machine, and would run {path.name} with {', '.join(running)}: check that the driver "
            "and its libraries fit this onnxruntime, or use the CPU"
        )


@cache
def _register_shared_arena() -> None:
    """Let all sessions of the process take their working memory on the CPU from one arena, which
    keeps it.

    With an arena each, the five largest embedded networks hold 2.8 GB. With arenas that shrink
    after each run, or without arenas, memory comes anew from the system: 400,000 page faults a
    photo, 6 % of its processor time or more.
    """
    ort = onnxruntime()

    memory = ort.OrtMemoryInfo(
        "Cpu", ort.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, ort.OrtMemType.DEFAULT
    )
    ort.create_and_register_allocator(memory, ort.OrtArenaCfg({}))


_IDENTITY = bytes.fromhex(
    "080812003a370a100a017812017922084964656e746974791201675a0f0a0178120a0a08080112040a02"
    "0801620f0a0179120a0a08080112040a02080142040a00100d"
)
"""ONNX graph that returns its input ``x``, one float32."""


def shrink_arena() -> None:
    """Give CPU memory that closed or idle sessions have freed back to the C library."""
    if not _register_shared_arena.cache_info().currsize:
        return
    import numpy as np

    ort = onnxruntime()

    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    options.add_session_config_entry("session.use_env_allocators", "1")
    shrink = ort.RunOptions()
    # onnxruntime shrinks an arena only at the end of a run.
    shrink.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
    session = ort.InferenceSession(_IDENTITY, options, providers=["CPUExecutionProvider"])
    session.run(None, {"x": np.zeros(1, np.float32)}, shrink)
