"""What one worker reserves of a node."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from physic_core.errors import ConfigError


@dataclass(frozen=True)
class Resources:
    """What one worker reserves of a node; Ray counts it, and does not enforce it.

    Attributes:
        cpus: cores. A worker computes with one thread.
        gpus: GPUs, such as 0.25 for four workers on one; None for 1 if the configuration names a
            GPU, else 0.
        memory_gb: main memory, GB (1e9 bytes); 0 for no limit. The default fits the networks of
            ``metricbody-embedded``.
    """

    cpus: float = 1.0
    gpus: float | None = None
    memory_gb: float = 1.5

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value is not None and not 0 <= value < float("inf"):
                raise ConfigError(f"{name} of a worker is a number from 0 (got {value})")
        if self.cpus == 0 and not self.gpus:
            raise ConfigError("a worker needs cpus or gpus above 0")

    @classmethod
    def from_options(cls, options: Mapping[str, str]) -> Resources:
        """Return the resources that ``--executor-set`` names.

        Raises:
            ConfigError: a name is unknown, or a value is not a number.
        """
        names = [field.name for field in fields(cls)]
        values = {}
        for name, text in options.items():
            if name not in names:
                raise ConfigError(
                    f"the executor 'ray' has no setting '{name}'; it has {', '.join(names)}"
                )
            try:
                values[name] = float(text)
            except ValueError as error:
                raise ConfigError(f"{name} of a worker is a number (got '{text}')") from error
        return cls(**values)

    def for_device(self, device: str) -> Resources:
        """Return the resources with the number of GPUs filled in."""
        gpus = self.gpus if self.gpus is not None else float(device.startswith("cuda"))
        return Resources(self.cpus, gpus, self.memory_gb)

    def as_ray_arguments(self) -> dict[str, Any]:
        """Return the keyword arguments of Ray for an actor."""
        arguments: dict[str, Any] = {"num_cpus": self.cpus, "num_gpus": self.gpus or 0}
        return arguments | ({"memory": int(self.memory_gb * 1e9)} if self.memory_gb else {})

    def count_slots(self, nodes: Iterable[Mapping[str, Any]]) -> int:
        """Return how many workers fit on the nodes, given as by ``ray.nodes()``."""
        needed = {"CPU": self.cpus, "GPU": self.gpus or 0, "memory": self.memory_gb * 1e9}
        total = 0
        for node in nodes:
            has = node["Resources"] if node["Alive"] else {}
            total += min(
                int(has.get(name, 0.0) / amount) for name, amount in needed.items() if amount
            )
        return total

    def __str__(self) -> str:
        return f"{self.cpus:g} CPU, {self.gpus or 0:g} GPU and {self.memory_gb:g} GB of memory"
