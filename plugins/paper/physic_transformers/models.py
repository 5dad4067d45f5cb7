"""Load models of Hugging Face transformers from local folders.

Only model classes and tokenizers of the library are used: its image processors need torchvision and
do little. Where torchvision is installed, model classes import it, too. Nothing is downloaded here;
``physic weights fetch NAME`` does that.
"""

from __future__ import annotations

import importlib.util
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib.metadata import version  # noqa: TID251 -- of a package that cannot be imported
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.backends.devices import limited_threads
from physic_core.errors import BackendError
from physic_core.files import parse_json, read_text
from physic_networks.networks import TorchBackend, TorchOptions

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_MAX_CONFIG_BYTES = 1 << 20
_TOLD = 4  # names of weights in a message


@dataclass(frozen=True)
class ModelSpec:
    """Network of a backend: name of its weights option, class in transformers and readable model
    types.

    Attributes:
        option: name of the option that names its weights.
        class_name: class in transformers.
        model_types: values of ``model_type`` in config.json that the class can read.
        needs_tokenizer: whether the network takes text.
        samples_grids: whether the class calls torch's ``grid_sample``, which returns NaN by chance
            in half precision on a CPU (2.13.0): such a network is read in float32 there.
    """

    option: str
    class_name: str
    model_types: tuple[str, ...]
    needs_tokenizer: bool = False
    samples_grids: bool = False


class ModelOptions(TorchOptions):
    """Settings shared by all backends of this plugin."""

    threads: int = Field(
        default=0,
        ge=0,
        le=256,
        description="Threads of torch on a CPU while this network runs; 0 leaves them as they "
        "are. As many as cores "
        "that are idle: more are far slower beside a busy process.",
    )


class TransformersModel:
    """Loaded transformers model that takes numpy arrays and returns the library's outputs.

    Attributes:
        config: the model's, as the library has it.
        tokenizer: of the words that it takes; None where it takes none.
    """

    def __init__(self, model: Any, tokenizer: Any = None, *, threads: int = 0) -> None:
        self.config = model.config
        self.tokenizer = tokenizer
        self._model = model
        self._threads = threads

    def run(self, method: str = "", /, **inputs: Any) -> Any:
        """Call the model, or one of its methods.

        Args:
            method: its name; empty for the model's own call.
            inputs: arrays and tensors, which come to its device, or whatever an earlier call gave.
                Only pixels take its type of number: coordinates of a prompt would lose whole pixels
                in bfloat16.
        """
        import torch

        call = getattr(self._model, method) if method else self._model
        with (
            torch.inference_mode(),
            limited_threads(self._threads) if self._threads else nullcontext(),
        ):
            return call(**{name: self._tensor(name, value) for name, value in inputs.items()})

    def _tensor(self, name: str, value: Any) -> Any:
        """Convert an input to a tensor on the model's device."""
        import torch

        if not isinstance(value, np.ndarray | torch.Tensor):
            return value
        tensor = torch.as_tensor(value).to(self._model.device)
        return tensor.to(self._model.dtype) if name == "pixel_values" else tensor


class PretrainedBackend(TorchBackend):
    """Base class of backends whose networks are in the format of transformers' ``save_pretrained``.

    Attributes:
        specs: of its networks.
    """

    specs: ClassVar[tuple[ModelSpec, ...]]
    options: ModelOptions

    def __init_subclass__(cls, **named: Any) -> None:
        """Name the options with weights, which the specs of a backend state."""
        super().__init_subclass__(**named)
        cls.weight_options = tuple(spec.option for spec in cls.specs)

    def build(self, device: str) -> dict[str, TransformersModel]:
        """Read the weights, by the names of their options."""
        models = {}
        for spec in self.specs:
            place = self.file(option=spec.option)
            folder = place if place.is_dir() else place.parent
            models[spec.option] = open_model(spec, folder, self.options, device)
        return models

    def model(self, option: str = "weights") -> TransformersModel:
        """Return the loaded network of a weights option.

        Raises:
            BackendError: ``load`` was not called.
        """
        network: TransformersModel = self.network[option]
        return network


def open_model(
    spec: ModelSpec, folder: Path, options: ModelOptions, device: str
) -> TransformersModel:
    """Load a model, and its tokenizer if it takes text.

    Args:
        spec: which class it is to be.
        folder: of the model.
        options: precision and threads.
        device: "cpu", "cuda", "cuda:N".

    Raises:
        BackendError: the folder holds another model, or not all of its weights.
    """
    _check_model_type(folder, spec)
    import torch
    import transformers

    try:
        kind = getattr(transformers, spec.class_name)
    except (AttributeError, ImportError) as cause:
        _check_torchvision()
        raise BackendError(
            f"transformers {transformers.__version__} has no {spec.class_name}, or needs more for "
            f"it: pip install --upgrade transformers ({cause})"
        ) from cause
    precision = "float32" if spec.samples_grids and device == "cpu" else options.precision
    try:
        with _quiet_loading():
            model, loading_info = kind.from_pretrained(
                str(folder),
                local_files_only=True,
                dtype=getattr(torch, precision),
                output_loading_info=True,
            )
            tokenizer = None
            if spec.needs_tokenizer:
                tokenizer = transformers.AutoTokenizer.from_pretrained(
                    str(folder), local_files_only=True
                )
    # a library's door: what it raises for an unfit file is not documented
    except Exception as cause:
        raise BackendError(
            f"{folder} cannot be read as {spec.class_name}: {type(cause).__name__}: {cause}"
        ) from cause
    _check_complete(folder, spec, loading_info)
    return TransformersModel(
        model.eval().to(device), tokenizer, threads=options.threads if device == "cpu" else 0
    )


def _check_torchvision() -> None:
    """Raise BackendError if torchvision, which the library imports where it finds it, does not fit
    torch.
    """
    import torch

    if importlib.util.find_spec("torchvision") is None:
        return
    try:
        importlib.import_module("torchvision")
    except Exception as cause:  # a missing operator is a RuntimeError, a missing library an OSError
        raise BackendError(
            f"torchvision {version('torchvision')} does not fit torch {torch.__version__} "
            f"({cause}), and transformers imports it where it is installed: remove it (pip "
            "uninstall torchvision), or install the one for this torch"
        ) from cause


def _check_model_type(folder: Path, spec: ModelSpec) -> None:
    """Raise BackendError if the folder contains another type of model."""
    try:
        model_type = parse_json(read_text(folder / "config.json", _MAX_CONFIG_BYTES)).get(
            "model_type"
        )
    except (OSError, ValueError, AttributeError) as cause:
        raise BackendError(f"{folder / 'config.json'} cannot be read: {cause}") from cause
    if model_type not in spec.model_types:
        wanted = " or ".join(f"'{name}'" for name in spec.model_types)
        raise BackendError(
            f"{folder} holds a model of the type '{model_type}': give one of type {wanted} for "
            f"{spec.class_name}"
        )


def _check_complete(folder: Path, spec: ModelSpec, loading_info: Any) -> None:
    """Raise BackendError if weights are missing, which the library would fill with random
    numbers.
    """
    absent = sorted(map(str, loading_info.get("missing_keys", ())))
    if absent:
        names = ", ".join(absent[:_TOLD]) + (", ..." if len(absent) > _TOLD else "")
        raise BackendError(
            f"{folder} has not all weights of {spec.class_name}: {len(absent)} are expected and "
            f"not found ({names}); it is another model, or of another version"
        )


@contextmanager
def _quiet_loading() -> Iterator[None]:
    """Hide the library's progress bars and advice."""
    from transformers.utils import logging as library_logging

    logging: Any = library_logging  # untyped
    level = logging.get_verbosity()
    bars = logging.is_progress_bar_enabled()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        logging.set_verbosity(level)
        if bars:
            logging.enable_progress_bar()


def size_from_edges(height: int, width: int, short: int, long: int) -> tuple[int, int]:
    """Return height and width with the shorter side ``short`` px, or less if the longer side would
    exceed ``long`` px.

    Sides are cut to whole pixels as DETR and its descendants were trained.
    """
    low = min(height, width)
    high = max(height, width)
    edge: float = short
    if high / low * short > long:
        edge = long * low / high
    side = round(edge)
    if low == side:
        return height, width
    other = max(1, int(edge * high / low))
    side = max(1, side)
    return (side, other) if height <= width else (other, side)
