"""Models of Hugging Face transformers, opened from folders on this machine.

Only model classes and tokenizers of the library are used: its image processors want torchvision, and what they do is
little. Nothing is fetched from here; ``physic weights fetch NAME`` does that.
"""

from __future__ import annotations

import json
import re
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field

from physic_core import weights
from physic_core.devices import check_device
from physic_core.errors import BackendError, DeviceError, WeightsMissingError
from physic_core.interfaces import Backend, Options

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray

__all__ = [
    "MANIFEST",
    "ModelOptions",
    "Network",
    "Part",
    "Pretrained",
    "array",
    "find_folder",
    "fingerprint_of",
    "lacks",
    "open_network",
]

MANIFEST = Path(__file__).parent / "weights"
"""What ``physic weights`` knows of this plugin's files."""

_HUB_ID = re.compile(r"[A-Za-z0-9][\w.-]*/[A-Za-z0-9][\w.-]*")
_CONFIG = "config.json"
_WEIGHTS = ("model.safetensors", "model.safetensors.index.json", "pytorch_model.bin", "pytorch_model.bin.index.json")
_TOKENS = ("tokenizer.json", "vocab.txt", "vocab.json")
_TOLD = 4  # names of weights in a message
WHERE = (
    "a name of `physic weights list`, a folder of your own, or owner/repository of what lies in Hugging Face's cache"
)
"""What the option that names weights takes, in words."""


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


@dataclass(frozen=True)
class Part:
    """One network of a backend.

    Attributes:
        option: name of the option that says where its weights are.
        kind: class in transformers.
        types: values of ``model_type`` in config.json that the class can read.
        tokens: whether words are asked for, and a tokenizer is needed.
    """

    option: str
    kind: str
    types: tuple[str, ...]
    tokens: bool = False


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
        with torch.inference_mode(), _threads(self._threads):
            return call(**{name: self._tensor(name, value) for name, value in inputs.items()})

    def _tensor(self, name: str, value: Any) -> Any:
        import numpy as np
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
    import numpy as np

    plain = tensor.detach().float().cpu().numpy() if hasattr(tensor, "detach") else tensor
    return np.asarray(plain, np.float32)


def find_folder(value: str) -> Path:
    """The folder of a model.

    Args:
        value: a name in the manifest, a folder, or owner/repository of a model in Hugging Face's cache.

    Raises:
        WeightsMissingError: there is no such folder on this machine.
    """
    known = weights.read_manifest(MANIFEST)
    if value not in known and _HUB_ID.fullmatch(value) and not Path(value).exists():
        cached = _cached(value)
        if cached is not None:
            return cached
        same = [name for name, group in known.items() if any(f"://{value}/" in file.source for file in group.files)]
        advice = f"physic weights fetch {same[0]}" if same else f"hf download {value}"
        raise WeightsMissingError(
            f"'{value}' is no folder here, and Hugging Face's cache does not hold it; nothing is fetched while a photo "
            f"is reconstructed: run `{advice}` first, or give a folder"
        )
    folder = weights.locate(MANIFEST, value)
    return folder if folder.is_dir() else folder.parent


def lacks(part: Part, value: str) -> tuple[str, ...]:
    """What a network's folder lacks, each in words; cheap and offline."""
    known = weights.read_manifest(MANIFEST)
    if value in known:
        return weights.missing(MANIFEST, value)
    try:
        folder = find_folder(value)
    except WeightsMissingError as error:
        return (str(error),)
    wanted = [(_CONFIG,), _WEIGHTS, *([_TOKENS] if part.tokens else [])]
    return tuple(
        f"{folder} has no {' or '.join(names[:2])}: it must be a folder as save_pretrained of transformers writes it"
        for names in wanted
        if not any((folder / name).is_file() for name in names)
    )


def fingerprint_of(value: str) -> str:
    """Identity of a model's files, without their path; empty where they are missing."""
    if value in weights.read_manifest(MANIFEST) or not _HUB_ID.fullmatch(value) or Path(value).exists():
        return weights.fingerprint(MANIFEST, value)
    cached = _cached(value)
    return "" if cached is None else f"{value}@{cached.name}"  # a snapshot's folder is named after its commit


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
    _check_type(folder, part)
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


def _check_type(folder: Path, part: Part) -> None:
    try:
        found = json.loads((folder / _CONFIG).read_text("utf-8")).get("model_type")
    except (OSError, ValueError, AttributeError) as cause:
        raise BackendError(f"{folder / _CONFIG} cannot be read: {cause}") from cause
    if found not in part.types:
        wanted = " or ".join(f"'{name}'" for name in part.types)
        raise BackendError(f"{folder} holds a model of the type '{found}', expected {wanted} for {part.kind}")


def _check_whole(folder: Path, part: Part, told: Any) -> None:
    """Refuse a file from which weights are missing: the library would fill in random numbers."""
    absent = sorted(map(str, told.get("missing_keys", ())))
    if absent:
        names = ", ".join(absent[:_TOLD]) + (", ..." if len(absent) > _TOLD else "")
        raise BackendError(
            f"{folder} has not all weights of {part.kind}: {len(absent)} are expected and not found ({names}); "
            "it is another model, or of another version"
        )


def _cached(repository: str) -> Path | None:
    """The newest snapshot of a repository in Hugging Face's cache."""
    from huggingface_hub import try_to_load_from_cache

    found = try_to_load_from_cache(repository, _CONFIG)
    return Path(found).parent if isinstance(found, str) else None


@contextmanager
def _threads(count: int) -> Iterator[None]:
    import torch

    before = torch.get_num_threads()
    if count in (0, before):
        yield
        return
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def _quiet() -> Iterator[None]:
    """No bars and no advice of the library on the user's screen: what matters is raised from here."""
    from transformers.utils import logging

    level, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        logging.set_verbosity(level)
        if bars:
            logging.enable_progress_bar()
