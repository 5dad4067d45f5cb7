"""What one attack is: where its data comes from, and what must not happen."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fuzzing.mutations import mutate_bytes

CORPUS = Path(__file__).parents[1] / "corpus"


@dataclass(frozen=True)
class Target:
    """A reader under attack.

    Args:
        name: also the folder of the files that failed once, in ``corpus/``.
        make_seeds: writes valid inputs, given an empty folder, and returns them.
        attack: reads the data, given an empty folder; it raises whatever a user must not see, and
            returns otherwise. An answer that a user may see, such as InputError, is caught by it.
        mutate: how seeds are damaged.
    """

    name: str
    make_seeds: Callable[[Path], Sequence[bytes]]
    attack: Callable[[bytes, Path], None]
    mutate: Callable[[bytes, random.Random, Sequence[bytes]], bytes] = mutate_bytes

    def corpus(self) -> list[Path]:
        """Inputs that failed once."""
        return sorted(path for path in (CORPUS / self.name).glob("*") if path.is_file())

    def mutated(self, folder: Path, seed: int, count: int) -> Iterator[tuple[int, bytes]]:
        """Yield ``count`` damaged inputs, each with the number that it can be made from again."""
        seeds = self.make_seeds(folder)
        for case in range(seed, seed + count):
            rng = random.Random(f"{self.name} {case}")
            yield case, self.mutate(rng.choice(seeds), rng, seeds)
