"""What backends around somebody else's torch code share: options, checkpoints, batches, precision, quiet."""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core import weights
from physic_core.adapters.checkouts import Checkout
from physic_core.errors import BackendError
from physic_core.interfaces import Backend, Options

if TYPE_CHECKING:
    import torch

__all__ = [
    "MANIFEST",
    "CheckoutOptions",
    "Host",
    "Hosted",
    "Project",
    "SeenConfidence",
    "batches",
    "computing",
    "fill",
    "read_checkpoint",
    "refused_checkpoint",
    "to_numpy",
]

MANIFEST = Path(__file__).parent / "weights"
_LOG = logging.getLogger(__name__)

SeenConfidence = Annotated[
    float,
    Field(ge=0, le=1, description="of keypoints from which their joints count as seen in the photo; 0 takes all"),
]
"""Option of backends that say which joints the photo shows."""


class CheckoutOptions(Options):
    """Settings that all backends around a checkout share."""

    weights: str = Field(default="", description="a name of `physic weights list`, or a path of your own")
    checkout: str = Field(
        default="", description="folder of your checkout of the project, its root; empty where it is installed"
    )
    batch: int = Field(default=8, ge=1, description="people or hands at once; 8 takes about 4 GB with a ViT-H")
    half: bool = Field(default=False, description="compute in float16 on a GPU; does nothing on a CPU")
    trust_checkpoint: bool = Field(
        default=False,
        description="read a checkpoint that holds Python objects beside its tensors: it can then run code of whoever "
        "made it, so only for files whose origin you trust",
    )


class Host:
    """What one backend holds of a checkout: its code, its network, its device.

    Args:
        checkout: the code.
        weights_value: the option that names the weights.
    """

    def __init__(self, checkout: Checkout, weights_value: str) -> None:
        self.checkout, self.weights_value = checkout, weights_value
        self.network: Any = None
        self.device = "cpu"

    def missing(self) -> tuple[str, ...]:
        """What is lacking of code and weights."""
        return (*self.checkout.missing(), *weights.missing(MANIFEST, self.weights_value))

    def fingerprint(self) -> str:
        """Changes with weights and code."""
        return f"{weights.fingerprint(MANIFEST, self.weights_value)} {self.checkout.fingerprint()}"

    def file(self, name: str | None = None) -> Path:
        """A file of the weights; or all of them.

        Raises:
            WeightsMissingError: it is not there.
        """
        return weights.locate(MANIFEST, self.weights_value, name)

    def loaded(self) -> Any:
        """The network.

        Raises:
            BackendError: it is not loaded.
        """
        if self.network is None:
            raise BackendError(f"{self.checkout.name} is not loaded: call load() before infer()")
        return self.network

    def keep(self, network: Any, device: str) -> None:
        """Hold a network of torch, moved to its device."""
        self.network, self.device = network.eval().to(device), device

    def close(self) -> None:
        """Let go of network and code."""
        self.network = None
        self.checkout.close()


@dataclass(frozen=True)
class Project:
    """Somebody's repository, as :class:`physic_core.adapters.checkouts.Checkout` has it, wherever it lies."""

    name: str
    package: str
    homepage: str
    needs: tuple[str, ...]


class Hosted(Backend):
    """A backend around one checkout, before the interface among its bases.

    Attributes:
        project: whose code it runs.
    """

    project: ClassVar[Project]
    options: CheckoutOptions

    def __init__(self, options: Any = None) -> None:
        super().__init__(options)
        described = vars(self.project) | {"needs": self.needs()}
        self._host = Host(Checkout(self.options.checkout, **described), self.options.weights)

    def needs(self) -> tuple[str, ...]:
        """Packages of the environment that its code imports with these options."""
        return self.project.needs

    def missing(self) -> tuple[str, ...]:
        """Of checkout, packages and weights."""
        return self._host.missing()

    def fingerprint(self) -> str:
        """Changes with weights and code."""
        return self._host.fingerprint()

    def close(self) -> None:
        """Let go of network and code."""
        self._host.close()

    def _filled(
        self, network: torch.nn.Module, path: Path, key: str = "state_dict", besides: str | None = None
    ) -> torch.nn.Module:
        """The network with the tensors of a checkpoint, which may hold them under a key; ``besides`` as of `fill`."""
        state = read_checkpoint(path, trusted=self.options.trust_checkpoint)
        fill(network, state.get(key, state), path, besides=besides)
        return network


def read_checkpoint(path: Path, *, trusted: bool) -> Any:
    """What a ``.pt``, ``.pth`` or ``.ckpt`` file holds, on the CPU.

    Args:
        path: of the file.
        trusted: whether it may hold more than tensors and plain containers.

    Raises:
        BackendError: it cannot be read, or only by trusting it.
    """
    import pickle

    import torch

    try:
        return torch.load(path, map_location="cpu", weights_only=not trusted)
    except pickle.UnpicklingError as error:
        raise refused_checkpoint(path, error, trusted=trusted) from error
    except Exception as error:  # zip files that end too early, files of something else
        raise BackendError(f"{path} is no whole checkpoint of torch: {type(error).__name__}: {error}") from error


def refused_checkpoint(path: Path, error: Exception, *, trusted: bool) -> BackendError:
    """What to say of a file that torch could not unpickle."""
    if trusted:
        return BackendError(f"{path} is no checkpoint of torch: {error}")
    return BackendError(
        f"{path} holds Python objects beside its tensors, and reading those can run code: if you trust its origin, "
        "set the option trust_checkpoint = true"
    )


def fill(
    network: torch.nn.Module, state: Mapping[str, Any], path: Path, prefix: str = "", besides: str | None = None
) -> None:
    """Put a checkpoint's tensors into a network; those that it does not know are left out.

    Args:
        network: gets them.
        state: tensors by name.
        path: where they are from, for messages.
        prefix: with which their names begin, and the network's do not.
        besides: with this begin names of parameters that the checkpoint need not have.

    Raises:
        BackendError: a parameter of the network is not in the checkpoint, or has another shape.
    """
    own = {key.removeprefix(prefix): value for key, value in state.items() if key.startswith(prefix)}
    try:
        result = network.load_state_dict(own, strict=False)
    except RuntimeError as error:
        raise BackendError(f"{path} does not fit the network of the checkout: {error}") from error
    parameters = {name for name, _ in network.named_parameters()}
    absent = [key for key in result.missing_keys if key in parameters and not (besides and key.startswith(besides))]
    if absent:
        raise BackendError(
            f"{path} lacks {len(absent)} of {len(parameters)} parameters of the network, {', '.join(absent[:3])}, ...: "
            "it is the checkpoint of another network or of another version of the checkout"
        )


def batches(count: int, size: int) -> Iterator[slice]:
    """Rows 0 to ``count``, at most ``size`` at once."""
    for first in range(0, count, size):
        yield slice(first, min(first + size, count))


@contextlib.contextmanager
def computing(checkout: Checkout, device: str, *, half: bool = False) -> Iterator[None]:
    """While a checkout's network runs: no gradients, float16 if asked for on a GPU, and its prints go to the log.

    What its code sends to "cuda", without a number, goes to the device that is asked for.
    """
    import torch

    said = io.StringIO()
    kind = "cuda" if device.startswith("cuda") else "cpu"
    with (
        checkout.inside(),
        torch.cuda.device(device) if kind == "cuda" else contextlib.nullcontext(),
        torch.no_grad(),
        torch.autocast(kind, dtype=torch.float16, enabled=half and kind == "cuda"),
        contextlib.redirect_stdout(said),
    ):
        yield
    if said.getvalue():
        _LOG.debug("%s: %s", checkout.name, said.getvalue().strip())


def to_numpy(value: Any) -> Any:
    """A tensor, or an array already, as float32 numpy."""
    tensor = value.detach().float().cpu().numpy() if hasattr(value, "detach") else value
    return np.asarray(tensor, np.float32)
