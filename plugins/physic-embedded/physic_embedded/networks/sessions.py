"""Opening the packaged networks with onnxruntime."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.errors import BackendError, DeviceError

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

__all__ = ["WEIGHTS", "Networks", "open_session", "weights_path"]

WEIGHTS = Path(__file__).parents[1] / "weights"
"""Folder of the packaged networks; ``MANIFEST.json`` in it says what each one is."""


class Networks:
    """The open networks of one backend.

    Args:
        names: file names without ``.onnx``.
    """

    def __init__(self, *names: str) -> None:
        self.names = names
        self._open: dict[str, InferenceSession] = {}

    def open(self, device: str, threads: int) -> None:
        """Open every network, see :func:`open_session`; again for another device or thread count."""
        self._open = {name: open_session(name, threads, device) for name in self.names}

    def close(self) -> None:
        """Let go of every network."""
        self._open = {}

    def __getitem__(self, name: str) -> InferenceSession:
        """An open network.

        Raises:
            BackendError: it is not open.
        """
        if name not in self._open:
            raise BackendError(f"network {name!r} is not loaded: call load() before infer()")
        return self._open[name]


def weights_path(name: str) -> Path:
    """Path of a packaged network, by its file name without ``.onnx``.

    Raises:
        BackendError: the package does not hold it.
    """
    path = WEIGHTS / f"{name}.onnx"
    if not path.is_file():
        have = ", ".join(sorted(p.stem for p in WEIGHTS.glob("*.onnx"))) or "none"
        raise BackendError(
            f"physic-embedded holds no network {name!r} (it holds: {have}): "
            "install the package again from its wheel, which carries them"
        )
    return path


def open_session(name: str, threads: int = 2, device: str = "cpu") -> InferenceSession:
    """An onnxruntime session on a packaged network.

    Args:
        name: file name without ``.onnx``.
        threads: threads inside one operator; 0 leaves the choice to onnxruntime.
        device: "cpu", "cuda" or "cuda:1".

    Raises:
        BackendError: the package does not hold this network, or onnxruntime refuses it.
        DeviceError: the device is not there, or the installed onnxruntime cannot use it.
    """
    import onnxruntime as ort

    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3
    options.enable_mem_pattern = False
    path = weights_path(name)
    providers = _providers(device, ort.get_available_providers())
    try:
        return _frugal_session()(str(path), options, providers=providers)
    except Exception as cause:  # onnxruntime's own exceptions share no public base class
        raise BackendError(f"onnxruntime cannot open {path.name}: {cause}") from cause


@cache
def _frugal_session() -> type[InferenceSession]:
    """InferenceSession that gives its working memory back after each run.

    As they come, the five largest networks reach 2.8 GB of memory together, and with this all nine reach 0.8 GB, for a
    tenth to a fifth more time; without an arena at all, the large ones take twice as long.
    """
    import onnxruntime as ort

    shrink = ort.RunOptions()
    shrink.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")

    class FrugalSession(ort.InferenceSession):  # type: ignore[misc]
        def run(self, output_names: Any, input_feed: Any, run_options: Any = None) -> Any:
            return super().run(output_names, input_feed, run_options or shrink)

    return FrugalSession


def _providers(device: str, available: list[str]) -> list[str | tuple[str, dict[str, str]]]:
    """Execution providers for a device name, best first."""
    kind, _, index = device.partition(":")
    if kind == "cpu" and not index:
        return ["CPUExecutionProvider"]
    if kind != "cuda" or (index and not index.isdigit()):
        raise DeviceError(f"unknown device {device!r}: use 'cpu', 'cuda' or 'cuda:N'")
    if "CUDAExecutionProvider" not in available:
        raise DeviceError(
            f"device {device!r} was asked for, but the installed onnxruntime has only {', '.join(available)}: "
            "install onnxruntime-gpu in place of onnxruntime, or use device 'cpu'"
        )
    return [("CUDAExecutionProvider", {"device_id": index or "0"}), "CPUExecutionProvider"]
