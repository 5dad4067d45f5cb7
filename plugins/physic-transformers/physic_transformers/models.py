"""Models of Hugging Face transformers, opened from folders on this machine.

Only model classes and tokenizers of the library are used: its image processors want torchvision, and what they do is
little. Nothing is fetched from here; ``physic weights fetch NAME`` does that.
"""

from __future__ import annotations

from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.adapters.devices import check_device
from physic_core.adapters.threads import limited_threads
from physic_core.errors import BackendError, DeviceError, WeightsMissingError
from physic_core.interfaces import Backend, Options
from physic_transformers.folders import WHERE, Part, check_type, find_folder, fingerprint_of, lacks

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

__all__ = ["WHERE", "ModelOptions", "Network", "Part", "Pretrained", "array", "open_network"]

_TOLD = 4  # names of weights in a message


class ModelOptions(Options):
    """What all backends of this plugin share."""

    dtype: Literal["float32", "float16", "bfloat16"] = Field(
        default="float32",
        description="Numbers that the network computes with. float16 and bfloat16 halve memory and are faster on a "
        "GPU; on a CPU they are slower, and float16 is refused there.",
    )
    threads: int = Field(
        default=0,
        ge=0,
        description="Threads of torch on a CPU while this network runs; 0 leaves them as they are. As many as cores "
        "that are idle: more are far slower beside a busy process.",
    )


class Network:
    """One loaded model behind one door: numpy in, the library's own outputs back.

    Attributes:
        config: the model's, as the library has it.
        tokenizer: of the words that it takes; None where it takes none.
    """

    def __init__(self, model: Any, tokenizer: Any = None, *, threads: int = 0) -> None:
        self.config, self.tokenizer = model.config, tokenizer
        self._model, self._threads = model, threads

    def run(self, method: str = "", /, **inputs: Any) -> Any:
        """Call the model, or a method of it.

        Args:
            method: its name; empty for the model's own call.
            inputs: numpy arrays, which become tensors on its device, or whatever an earlier call gave. Only pixels take
                its type of number: coordinates of a prompt would lose whole pixels in bfloat16.
        """
        import torch

        call = getattr(self._model, method) if method else self._model
        with torch.inference_mode(), limited_threads(self._threads) if self._threads else nullcontext():
            return call(**{name: self._tensor(name, value) for name, value in inputs.items()})

    def _tensor(self, name: str, value: Any) -> Any:
        import torch

        if not isinstance(value, np.ndarray):
            return value
        tensor = torch.from_numpy(np.ascontiguousarray(value)).to(self._model.device)
        return tensor.to(self._model.dtype) if name == "pixel_values" else tensor


class Pretrained(Backend):
    """A backend of networks that were saved by transformers' ``save_pretrained``, or lie so on the hub."""

    parts: ClassVar[tuple[Part, ...]]
    options: ModelOptions

    def __init__(self, options: Any = None) -> None:
        super().__init__(options)
        self._networks: dict[str, Network] = {}

    def missing(self) -> tuple[str, ...]:
        """What of the weights is not on this machine, each in words with how to get it."""
        return tuple(told for part in self.parts for told in lacks(part, self._value(part)))

    def fingerprint(self) -> str:
        """Identity of the weights, without their path."""
        found = [fingerprint_of(self._value(part)) for part in self.parts]
        return " ".join(found) if all(found) else ""

    def load(self, device: str = "cpu") -> None:
        """Read the weights.

        Raises:
            WeightsMissingError: they are not on this machine.
            DeviceError: the device is not there, or cannot compute with such numbers.
            BackendError: the folder holds another model.
        """
        check_device(device)
        self._networks = {
            part.option: open_network(part, self._value(part), self.options, device) for part in self.parts
        }

    def close(self) -> None:
        """Let go of the networks."""
        self._networks = {}

    def network(self, option: str = "weights") -> Network:
        """A loaded network.

        Raises:
            BackendError: ``load`` was not called.
        """
        try:
            return self._networks[option]
        except KeyError:
            name = type(self).__name__
            raise BackendError(f"{name} was asked before its networks were loaded: call load() first") from None

    def _value(self, part: Part) -> str:
        return str(getattr(self.options, part.option))


def array(tensor: Any) -> NDArray[np.float32]:
    """A tensor of any device and type of number as float32 numpy."""

    plain = tensor.detach().float().cpu().numpy() if hasattr(tensor, "detach") else tensor
    return np.asarray(plain, np.float32)


def open_network(part: Part, value: str, options: ModelOptions, device: str) -> Network:
    """Read a model, and its tokenizer if it takes words.

    Args:
        part: which class it is to be.
        value: as for :func:`find_folder`.
        options: types of numbers and threads.
        device: "cpu", "cuda", "cuda:N".

    Raises:
        WeightsMissingError: files are missing.
        DeviceError: the device cannot compute with such numbers.
        BackendError: the folder holds another model, or not all of its weights.
    """
    _check_numbers(options.dtype, device)
    if absent := lacks(part, value):
        raise WeightsMissingError("; ".join(absent))
    folder = find_folder(value)
    check_type(folder, part)
    import torch
    import transformers

    try:
        kind = getattr(transformers, part.kind)
    except (AttributeError, ImportError) as cause:
        raise BackendError(
            f"transformers {transformers.__version__} has no {part.kind}, or needs more for it: "
            f"pip install --upgrade transformers ({cause})"
        ) from cause
    try:
        with _quiet():
            model, told = kind.from_pretrained(
                str(folder), local_files_only=True, dtype=getattr(torch, options.dtype), output_loading_info=True
            )
            tokenizer = None
            if part.tokens:
                tokenizer = transformers.AutoTokenizer.from_pretrained(str(folder), local_files_only=True)
    except Exception as cause:  # a library's door: what it raises for an unfit file is not documented
        raise BackendError(f"{folder} cannot be read as {part.kind}: {type(cause).__name__}: {cause}") from cause
    _check_whole(folder, part, told)
    return Network(model.eval().to(device), tokenizer, threads=options.threads if device == "cpu" else 0)


def _check_numbers(dtype: str, device: str) -> None:
    if dtype == "float16" and device == "cpu":
        raise DeviceError("dtype 'float16' needs a GPU: take 'float32', or 'bfloat16', on the device 'cpu'")
    if dtype == "bfloat16" and device != "cpu":
        import torch

        if not torch.cuda.is_bf16_supported():
            raise DeviceError(f"device '{device}' cannot compute with 'bfloat16': take 'float16' or 'float32'")


def _check_whole(folder: Path, part: Part, told: Any) -> None:
    """Refuse a file from which weights are missing: the library would fill in random numbers."""
    absent = sorted(map(str, told.get("missing_keys", ())))
    if absent:
        names = ", ".join(absent[:_TOLD]) + (", ..." if len(absent) > _TOLD else "")
        raise BackendError(
            f"{folder} has not all weights of {part.kind}: {len(absent)} are expected and not found ({names}); "
            "it is another model, or of another version"
        )


@contextmanager
def _quiet() -> Iterator[None]:
    """No bars and no advice of the library on the user's screen: what matters is raised from here."""
    from transformers.utils import logging as library_logging

    logging: Any = library_logging  # untyped
    level, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        logging.set_verbosity(level)
        if bars:
            logging.enable_progress_bar()
