"""Base classes and helpers of backends that run torch code of a checkout: options, checkpoints, batches, precision."""

from __future__ import annotations

import contextlib
import io
import logging
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core import weights
from physic_core.adapters.checkouts import Checkout
from physic_core.adapters.devices import check_device
from physic_core.errors import BackendError, DeviceError
from physic_core.interfaces import Backend, Options, Requirement

if TYPE_CHECKING:
    import torch

MANIFEST = Path(__file__).parent / "weights"
_LOG = logging.getLogger(__name__)


class CheckoutOptions(Options):
    """Settings shared by all backends that run a checkout."""

    weights: str = Field(default="", description="a name of `physic weights list`, or a path of your own")
    checkout: str = Field(
        default="", description="folder of your checkout of the project, its root; empty where it is installed"
    )
    batch: int = Field(default=8, ge=1, le=1024, description="people or hands at once; 8 takes about 4 GB with a ViT-H")
    half: bool = Field(default=False, description="compute in float16 on a GPU; does nothing on a CPU")
    trust_checkpoint: bool = Field(
        default=False,
        description="read a checkpoint that holds Python objects beside its tensors: it can then run code of whoever "
        "made it, so only for files whose origin you trust",
    )


class CheckoutNetwork:
    """Checkout of a published repository, with its network and its device.

    Args:
        checkout: the code.
        weights_value: the option that names the weights.
    """

    def __init__(self, checkout: Checkout, weights_value: str) -> None:
        self.checkout, self.weights_value = checkout, weights_value
        self.network: Any = None
        self.device = "cpu"

    def missing(self) -> tuple[str, ...]:
        """Describe missing code and weights."""
        return (*self.checkout.missing(), *weights.missing(MANIFEST, self.weights_value))

    def fingerprint(self) -> str:
        """Return the identity of weights and code."""
        return f"{weights.fingerprint(MANIFEST, self.weights_value)} {self.checkout.fingerprint()}"

    def file(self, name: str | None = None) -> Path:
        """Return the path of one weights file; without ``name``, the path of the complete weights.

        Raises:
            WeightsMissingError: it is not there.
        """
        return weights.locate(MANIFEST, self.weights_value, name)

    def loaded(self) -> Any:
        """Return the loaded network.

        Raises:
            BackendError: it is not loaded.
        """
        if self.network is None:
            raise BackendError(f"{self.checkout.name} is not loaded: call load() before infer()")
        return self.network

    def set_network(self, network: Any, device: str) -> None:
        """Store a torch network and move it to its device."""
        self.network, self.device = network.eval().to(device), device

    def close(self) -> None:
        """Unload the network and the modules of the checkout."""
        self.network = None
        self.checkout.close()


@dataclass(frozen=True)
class CheckoutProject:
    """Published repository: name, package, homepage, required packages, and the commit that was tested.

    The fields are those of :class:`physic_core.adapters.checkouts.Checkout`.
    """

    name: str
    package: str
    homepage: str
    needs: tuple[str, ...]
    commit: str = ""


class CheckoutBackend(Backend):
    """Base class of a backend that runs a checkout of a published repository.

    In the list of base classes, it precedes the interface.

    Attributes:
        project: whose code it runs.
    """

    project: ClassVar[CheckoutProject]
    options: CheckoutOptions
    capabilities: frozenset[str] = frozenset()

    def __init__(self, options: Any = None) -> None:
        super().__init__(options)
        described = vars(self.project) | {"needs": self.needs()}
        self._checkout_network = CheckoutNetwork(Checkout(self.options.checkout, **described), self.options.weights)

    def needs(self) -> tuple[str, ...]:
        """Return the packages that the checkout imports with these options."""
        return self.project.needs

    def missing(self) -> tuple[str, ...]:
        """Describe missing code and weights."""
        return self._checkout_network.missing()

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the repository and its packages."""
        return self._checkout_network.checkout.requirements()

    def fingerprint(self) -> str:
        """Return the identity of weights and code."""
        return self._checkout_network.fingerprint()

    def load(self, device: str = "cpu") -> None:
        """Build the network and load its weights.

        Raises:
            DeviceError: the device is not there, or the network does not run on it.
            WeightsMissingError: code, weights or a body model's file are missing.
            BackendError: they are not those of the project.
            BodyModelError: the body model's file cannot be used.
        """
        check_device(device)
        if "needs_cuda" in self.capabilities and not device.startswith("cuda"):
            raise DeviceError(f"{self.project.name}'s own code runs on a GPU only, got '{device}': use 'cuda'")
        if self._checkout_network.network is None:
            self._build(device)

    @abstractmethod
    def _build(self, device: str) -> None:
        """Build the network on a device that exists, load its weights, and store both in ``_checkout_network``."""

    def close(self) -> None:
        """Unload the network and the modules of the checkout."""
        self._checkout_network.close()

    def _load_checkpoint(self, network: torch.nn.Module, path: Path, key: str = "state_dict") -> torch.nn.Module:
        """Load a checkpoint, whose tensors may be under a key, into a network, and return the network."""
        state = read_checkpoint(path, trusted=self.options.trust_checkpoint)
        _load_parameters(network, state.get(key, state), path)
        return network


def read_checkpoint(path: Path, *, trusted: bool) -> Any:
    """Read a ``.pt``, ``.pth`` or ``.ckpt`` file onto the CPU.

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
        raise checkpoint_error(path, error, trusted=trusted) from error
    except Exception as error:  # zip files that end too early, files of something else
        raise BackendError(f"{path} is not a complete checkpoint of torch: {type(error).__name__}: {error}") from error


def checkpoint_error(path: Path, error: Exception, *, trusted: bool) -> BackendError:
    """Return the error for a file that torch could not unpickle."""
    if trusted:
        return BackendError(f"{path} is not a PyTorch checkpoint: {error}")
    return BackendError(
        f"{path} holds Python objects beside its tensors, and reading those can run code: if you trust its origin, "
        "set the option trust_checkpoint = true"
    )


def _load_parameters(network: torch.nn.Module, state: Mapping[str, Any], path: Path) -> None:
    """Load a checkpoint's tensors into a network; unknown tensors are ignored.

    Args:
        network: gets them.
        state: tensors by name.
        path: where they are from, for messages.

    Raises:
        BackendError: a parameter of the network is not in the checkpoint, or has another shape.
    """
    try:
        result = network.load_state_dict(dict(state), strict=False)
    except RuntimeError as error:
        raise BackendError(f"{path} does not fit the network of the checkout: {error}") from error
    parameters = {name for name, _ in network.named_parameters()}
    absent = [key for key in result.missing_keys if key in parameters]
    if absent:
        raise BackendError(
            f"{path} is missing {len(absent)} of {len(parameters)} parameters of the network, "
            f"{', '.join(absent[:3])}, ...: "
            "it is the checkpoint of another network or of another version of the checkout"
        )


def batch_slices(count: int, size: int) -> Iterator[slice]:
    """Yield slices of at most ``size`` rows from 0 to ``count``."""
    for first in range(0, count, size):
        yield slice(first, min(first + size, count))


@contextlib.contextmanager
def inference_context(checkout: Checkout, device: str, *, half: bool = False) -> Iterator[None]:
    """Run a block without gradients, and in float16 if ``half`` on a GPU, as a checkout's network needs.

    Printed text goes to the log. Code that uses "cuda" without a number uses the chosen device.
    """
    import torch

    said = io.StringIO()
    kind = "cuda" if device.startswith("cuda") else "cpu"
    with (
        checkout.activated(),
        torch.cuda.device(device) if kind == "cuda" else contextlib.nullcontext(),
        torch.no_grad(),
        torch.autocast(kind, dtype=torch.float16, enabled=half and kind == "cuda"),
        contextlib.redirect_stdout(said),
    ):
        yield
    if said.getvalue():
        _LOG.debug("%s: %s", checkout.name, said.getvalue().strip())


def to_numpy(value: Any) -> Any:
    """Convert a tensor or an array to float32 numpy."""
    tensor = value.detach().float().cpu().numpy() if hasattr(value, "detach") else value
    return np.asarray(tensor, np.float32)
