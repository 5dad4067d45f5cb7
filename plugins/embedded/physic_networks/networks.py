"""Base classes of backends that run a network; an adapter adds how its input is made and how its
output is read.

::

    class MyDepth(TorchBackend, MetricDepth):
        # with the option "weights", the name of a set in the folder "weights" of the package
        Options = MyOptions

        def build(self, device):
            return open_torchscript(self.file(), device)

        def preprocess(self, image, hints):
            return picture_tensor(
                image, IMAGENET_MEAN, IMAGENET_STD, size=(384, 512), device=self.device
            )

        def postprocess(self, output, image, hints):
            return DepthMap(resize_map(to_numpy(output)[0], *image.shape[:2]))
"""

from __future__ import annotations

import sys
import warnings
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core import weights
from physic_core.backends.devices import check_device
from physic_core.errors import BackendError, DeviceError
from physic_core.interfaces import Backend, GpuMemory, Options, Requirement

if TYPE_CHECKING:
    from physic_core.types import AnyArray, FloatArray, UInt8Array


WEIGHTS_HELP = "a name of `physic weights list`"
"""Description of the options that name weights."""


class NetworkBackend(Backend):
    """Base class of a backend that runs networks; in the list of base classes, it precedes the
    interface.

    ``infer`` is ``preprocess``, ``run`` and ``postprocess``; a backend that asks its network more
    than once has an ``infer`` of its own.

    Attributes:
        weight_options: names of the options that name weights; all but the first may be empty.
        device: of the loaded networks.
    """

    weight_options: ClassVar[tuple[str, ...]] = ("weights",)
    device: str = "cpu"
    _network: Any = None

    @classmethod
    def manifest(cls) -> Path:
        """Return the folder of the weight manifests: "weights" in the package of the class, or else
        of a base class.
        """
        packages = (sys.modules[kind.__module__.partition(".")[0]] for kind in cls.__mro__)
        folders = (
            Path(path) / "weights"
            for package in packages
            for path in getattr(package, "__path__", ())
        )
        return next(folder for folder in folders if folder.is_dir())

    @abstractmethod
    def build(self, device: str) -> Any:
        """Open the weights and return the network on a device.

        Raises:
            WeightsMissingError: files are missing.
            BackendError: they are not those of this network.
        """

    def load(self, device: str = "cpu") -> None:
        """Open the network, unless it is open.

        Raises:
            DeviceError: the device is not there, or the network does not run on it.
            WeightsMissingError: files are missing; the message says how to get them.
            BackendError: they are not those of this network.
        """
        if self._network is None:
            self.device = device
            self._network = self.build(device)

    def close(self) -> None:
        """Release the network."""
        self._network = None

    @staticmethod
    def release_memory() -> None:
        """Give CPU memory that onnxruntime keeps for all sessions back to the C library."""
        from physic_networks.onnx_sessions import shrink_arena

        shrink_arena()

    @property
    def network(self) -> Any:
        """The network that :meth:`build` returned.

        Raises:
            BackendError: it is not loaded.
        """
        if self._network is None:
            raise BackendError(f"{type(self).__name__} is not loaded: call load() before infer()")
        return self._network

    def infer(self, *given: Any, **named: Any) -> Any:
        """Return the result for an image and the other arguments of the interface.

        Raises:
            BackendError: the network is not loaded, or its output has an unexpected form.
        """
        return self.postprocess(self.run(self.preprocess(*given, **named)), *given, **named)

    def preprocess(self, *given: Any) -> Any:
        """Make the input of the network from the arguments of ``infer``."""
        raise NotImplementedError

    def run(self, inputs: Any) -> Any:
        """Run the network on what ``preprocess`` returns."""
        return self.network(inputs)

    def postprocess(self, output: Any, *given: Any) -> Any:
        """Make the result from the output of the network and the arguments of ``infer``."""
        raise NotImplementedError

    def file(self, name: str | None = None, option: str = "weights") -> Path:
        """Return the path of a weight file, or of the complete set, that an option names.

        Raises:
            WeightsMissingError: it is missing.
            BackendError: it is not the published file.
        """
        return weights.locate(self.manifest(), getattr(self.options, option), name)

    def missing(self) -> tuple[str, ...]:
        """Describe the missing weights, and how to get them."""
        return tuple(
            text
            for value in self._weight_names()
            for text in weights.missing(self.manifest(), value)
        )

    def fingerprint(self) -> str:
        """Return the identity of the weights, independent of their path."""
        return " ".join(
            weights.fingerprint(self.manifest(), value) for value in self._weight_names()
        )

    def _weight_names(self) -> list[str]:
        values = [getattr(self.options, option) for option in self.weight_options]
        return [*values[:1], *filter(None, values[1:])]


class TorchOptions(Options):
    """Settings of backends whose networks compute with torch in a chosen precision."""

    precision: Literal["float32", "float16", "bfloat16"] = Field(
        default="float32",
        description="number format of the network; float16 and bfloat16 are faster on a "
        "GPU; on a CPU they are slower, and float16 is refused there. On a GPU, convolutions of "
        "float32 round their inputs to 10 bits (TF32), torch's default",
    )


_MEASURED = "measured on an H100 with random weights, without CUDA's own .7 GB"


class TorchBackend(NetworkBackend):
    """Base class of a backend that runs networks with torch.

    Attributes:
        gpu_gigabytes: memory of a GPU that its default weights take, by precision, as it was
            measured.
    """

    gpu_gigabytes: ClassVar[Mapping[str, float]] = MappingProxyType({})

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the memory of a GPU, if it was measured for these weights and this precision."""
        fields = type(self.options).model_fields
        names = self.weight_options
        usual = all(getattr(self.options, name) == fields[name].default for name in names)
        gigabytes = self.gpu_gigabytes.get(getattr(self.options, "precision", "float32"))
        return (GpuMemory(gigabytes, _MEASURED),) if usual and gigabytes is not None else ()

    @property
    def dtype(self) -> Any:
        """The torch type that the option ``precision`` names; float32 without the option."""
        import torch

        return (
            getattr(torch, self.options.precision)
            if isinstance(self.options, TorchOptions)
            else torch.float32
        )

    def load(self, device: str = "cpu") -> None:
        """Build the network on a torch device, unless it is built.

        Raises:
            DeviceError: the device is not there, or cannot compute in the option ``precision``.
        """
        if self._network is None:
            check_device(device)
            _check_precision(self.dtype, device)
            super().load(device)

    def run(self, inputs: Any) -> Any:
        """Run the network without gradients."""
        import torch

        with torch.inference_mode():
            return super().run(inputs)


def _check_precision(dtype: Any, device: str) -> None:
    """Raise DeviceError if a device cannot compute with a torch type."""
    import torch

    if dtype is torch.float16 and device == "cpu":
        raise DeviceError(
            "precision 'float16' needs a GPU: take 'float32', or 'bfloat16', on the device 'cpu'"
        )
    if dtype is torch.bfloat16 and device != "cpu" and not torch.cuda.is_bf16_supported():
        raise DeviceError(
            f"device '{device}' cannot compute in 'bfloat16': take 'float16' or 'float32'"
        )


def open_torchscript(path: Path, device: str) -> Any:
    """Open a TorchScript file on a device.

    Raises:
        BackendError: the file is not TorchScript, or is damaged.
    """
    import torch

    try:
        # torch has newer formats, but files are published in this one
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            return torch.jit.load(str(path), map_location=device).eval()  # type: ignore[no-untyped-call]
    except Exception as error:  # torch raises many classes for files of other kinds
        raise BackendError(
            f"{path} cannot be read as TorchScript: {type(error).__name__}: {error}"
        ) from error


def run_in_batches(
    call: Callable[[dict[str, AnyArray]], Sequence[Any]],
    inputs: Mapping[str, AnyArray],
    size: int,
    *,
    full: bool = False,
) -> list[FloatArray]:
    """Call a network on at most ``size`` rows at a time, and join its outputs.

    Args:
        call: takes inputs (n, ...) by name and returns outputs of n rows.
        inputs: (N, ...) by name, N > 0.
        size: rows at a time.
        full: whether the network needs exactly ``size`` rows; the last batch is then padded.

    Raises:
        BackendError: an output has another number of rows.
    """
    rows = len(next(iter(inputs.values())))
    parts = []
    for first in range(0, rows, size):
        part = {name: value[first : first + size] for name, value in inputs.items()}
        count = shown = len(next(iter(part.values())))
        if full:
            shown = size
            part = {
                name: np.concatenate([v, np.repeat(v[-1:], size - count, axis=0)])
                for name, v in part.items()
            }
        outputs = [to_numpy(output) for output in call(part)]
        if wrong := [
            output.shape for output in outputs if output.ndim == 0 or len(output) != shown
        ]:
            raise BackendError(
                f"the network received {shown} pictures and returned an array of shape "
                f"{wrong[0]}: it does not keep the batch size"
            )
        parts.append([output[:count] for output in outputs])
    return [np.concatenate(outputs) for outputs in zip(*parts, strict=True)]


def picture_tensor(
    image: UInt8Array,
    mean: Sequence[float] = (0.0, 0.0, 0.0),
    std: Sequence[float] = (1.0, 1.0, 1.0),
    *,
    size: tuple[int, int] | None = None,
    device: str = "cpu",
) -> Any:
    """Return images as the input of a torch network, resized and normalised on the device by
    kornia.

    Args:
        image: (H, W, 3) or (N, H, W, 3) uint8 RGB.
        mean: mean of each channel, for values from 0 to 1.
        std: standard deviation of each channel, the same.
        size: rows and columns to which the image is resized, bilinear without antialiasing; None to
            keep its size.
        device: of torch.

    Returns:
        Tensor (N, 3, h, w) float32; N = 1 for a single image.
    """
    import kornia
    import torch

    pixels = torch.from_numpy(np.ascontiguousarray(image)).to(device)
    pixels = (pixels if pixels.ndim == 4 else pixels[None]).permute(0, 3, 1, 2).float() / 255
    if size is not None:
        pixels = kornia.geometry.resize(pixels, size, "bilinear", align_corners=False)
    return kornia.enhance.normalize(pixels, torch.tensor(mean), torch.tensor(std))


def to_numpy(value: Any) -> FloatArray:
    """Convert a tensor of any device and float type, or an array, to float32 numpy.

    Raises:
        BackendError: it has several numbers, and none of them is finite.
    """
    plain = value.detach().float().cpu().numpy() if hasattr(value, "detach") else value
    array = np.asarray(plain, np.float32)
    check_network_output(array, "the network")
    return array


def check_network_output(values: AnyArray, source: str) -> None:
    """Check that an answer of several numbers has a finite one.

    Comparisons with NaN are False: without this check, a network that has failed looks like one
    that has found nothing. A single number may be unknown.

    Args:
        values: of any shape and type.
        source: what gave them.

    Raises:
        BackendError: no number is finite.
    """
    if values.dtype.kind == "f" and values.size > 1 and not np.isfinite(values).any():
        raise BackendError(
            f"{source} returned an array of shape {values.shape} without one finite number: in "
            "half precision networks can overflow, and some GPUs (GTX 16xx) cannot compute: use "
            "its float32 file, precision 'float32', or the CPU"
        )
