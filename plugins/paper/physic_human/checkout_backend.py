"""Base class of backends that run torch code of a checkout: options, checkpoints, precision."""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from physic_core.errors import BackendError, DeviceError
from physic_core.interfaces import Requirement
from physic_networks.checkouts import Checkout
from physic_networks.networks import WEIGHTS_HELP, TorchBackend, TorchOptions, run_in_batches

if TYPE_CHECKING:
    import torch

    from physic_core.types import AnyArray, FloatArray

_LOG = logging.getLogger(__name__)


class CheckoutOptions(TorchOptions):
    """Settings shared by all backends that run a checkout."""

    weights: str = Field("", description=WEIGHTS_HELP)
    checkout: str = Field(
        default="",
        description="folder of your checkout of the project, its root; empty where it is installed",
    )
    batch: int = Field(
        default=8,
        ge=1,
        le=1024,
        description="batch size, people or hands; 8 takes about 4 GB with a ViT-H",
    )
    trust_checkpoint: bool = Field(
        default=False,
        description="read a checkpoint that holds Python objects beside its tensors: this can run "
        "code in the file, so "
        "only for files whose origin you trust",
    )


class CheckoutBackend(TorchBackend):
    """Base class of a backend that runs a checkout of a published repository.

    ``preprocess`` returns arrays (N, ...) by name, and ``postprocess`` gets the joined outputs of
    :meth:`run_network`; there are none if N is 0.

    Attributes:
        project: the checkout with the code; the option ``checkout`` is its folder.
        capabilities: with "needs_cuda" if its code runs on a GPU only.
    """

    project: ClassVar[Checkout]
    capabilities: ClassVar[frozenset[str]] = frozenset()
    options: CheckoutOptions

    def __init__(self, options: Any = None) -> None:
        super().__init__(options)
        self.checkout = replace(
            self.project, folder=self.options.checkout, needs=self.needed_packages()
        )

    def needed_packages(self) -> tuple[str, ...]:
        """Return the packages that the checkout imports with these options."""
        return self.project.needs

    def missing(self) -> tuple[str, ...]:
        """Describe missing code and weights."""
        return (*self.checkout.missing(), *super().missing())

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the repository, its packages, and the memory of a GPU if it was measured."""
        return (*self.checkout.requirements(), *super().requirements())

    def fingerprint(self) -> str:
        """Return the identity of weights and code."""
        return f"{super().fingerprint()} {self.checkout.fingerprint()}"

    def load(self, device: str = "cpu") -> None:
        """Build the network on a device, unless it is built."""
        if "needs_cuda" in self.capabilities and not device.startswith("cuda"):
            raise DeviceError(
                f"{self.project.name}'s own code runs on a GPU only, got '{device}': use 'cuda'"
            )
        super().load(device)

    def close(self) -> None:
        """Unload the network and the modules of the checkout."""
        super().close()
        self.checkout.close()

    def run(self, inputs: Mapping[str, AnyArray]) -> list[FloatArray]:
        """Run the network in batches, and return its joined outputs; none without rows, for which
        it is not run.
        """
        self.network  # noqa: B018 -- raises an error if it is not loaded
        if not len(next(iter(inputs.values()))):
            return []
        return run_in_batches(self._run_on_device, inputs, self.options.batch)

    def run_network(self, inputs: dict[str, torch.Tensor]) -> Sequence[Any]:
        """Run the network once, and return its outputs of n rows each.

        Raises:
            BackendError: it returns something else than the known releases.
        """
        raise NotImplementedError

    def load_checkpoint_into(
        self, network: torch.nn.Module, path: Path, key: str = "state_dict"
    ) -> torch.nn.Module:
        """Load a checkpoint, whose tensors may be under a key, into a network; return it on its
        device.
        """
        state = read_checkpoint(path, trusted=self.options.trust_checkpoint)
        load_parameters(network, state.get(key, state), path)
        return network.eval().to(self.device)

    @contextlib.contextmanager
    def inference(self) -> Iterator[None]:
        """Run code of the checkout without gradients, in the option ``precision``.

        Printed text goes to the log. Code that uses "cuda" without a number uses the chosen device.
        """
        import torch

        output = io.StringIO()
        with (
            self.checkout.activated(),
            torch.cuda.device(self.device) if self.device != "cpu" else contextlib.nullcontext(),
            torch.no_grad(),
            torch.autocast(
                self.device.partition(":")[0],
                dtype=self.dtype,
                enabled=self.dtype is not torch.float32,
            ),
            contextlib.redirect_stdout(output),
        ):
            yield
        if output.getvalue():
            _LOG.debug("%s: %s", self.checkout.name, output.getvalue().strip())

    def _run_on_device(self, part: Mapping[str, AnyArray]) -> Sequence[Any]:
        import torch

        with self.inference():
            return self.run_network(
                {name: torch.from_numpy(value).to(self.device) for name, value in part.items()}
            )


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
        raise BackendError(
            f"{path} is not a complete checkpoint of torch: {type(error).__name__}: {error}"
        ) from error


def checkpoint_error(path: Path, error: Exception, *, trusted: bool) -> BackendError:
    """Return the error for a file that torch could not unpickle."""
    if trusted:
        return BackendError(f"{path} is not a PyTorch checkpoint: {error}")
    return BackendError(
        f"{path} holds Python objects beside its tensors, and reading those can run code: if you "
        "trust its origin, set the option trust_checkpoint = true"
    )


def load_parameters(network: torch.nn.Module, state: Mapping[str, Any], path: Path) -> None:
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
            f"{', '.join(absent[:3])}, ...: use a checkpoint of this network and this version of "
            "the checkout"
        )
