"""Saved results, complete and of people: they are read, or refused with an error that names the
folder.
"""

from __future__ import annotations

import random
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

from fuzzing.mutations import mutate_bytes, mutate_text
from fuzzing.target import Target
from fuzzing.tiny_result import tiny_result
from physic_core.errors import InputError
from physic_core.io.results import load_people, load_reconstruction, save_reconstruction
from physic_core.types import Reconstruction

DOCUMENT = "reconstruction.json"
ARRAYS = "reconstruction.npz"
SEEDS = (0, 1)


@cache
def saved(seed: int, save: str = "numbers") -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        save_reconstruction(tiny_result(seed), folder, save)
        return {name: Path(folder, name).read_bytes() for name in (DOCUMENT, ARRAYS)}


def read(files: dict[str, bytes], folder: Path) -> Reconstruction | None:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    try:
        return load_reconstruction(folder)
    except InputError as error:
        message = str(error)
    assert message.startswith(f"cannot read {folder}"), message
    assert len(message) < 1500 + len(str(folder))
    return None


def attack_arrays(data: bytes, folder: Path) -> None:
    """Arrays are read or refused."""
    for seed in SEEDS:
        read({**saved(seed), ARRAYS: data}, folder)


def attack_people(data: bytes, folder: Path) -> None:
    """Arrays of people are read or refused."""
    for name, content in (saved(0, "people") | {ARRAYS: data}).items():
        (folder / name).write_bytes(content)
    with suppress(InputError):
        load_people(folder)


def attack_document(data: bytes, folder: Path) -> None:
    """A document is read as it is: numbers may differ, and what cannot be used is refused."""
    read({**saved(0), DOCUMENT: data}, folder)


def mutate_document(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    match rng.randrange(3):
        case 0:  # one bit of any byte
            out = bytearray(data)
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
            return bytes(out)
        case 1:
            return mutate_bytes(data, rng, others)
        case _:
            text = mutate_text(data.decode(), rng)
            return text.encode("utf-8", "backslashreplace")


def mutate_archive(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    """One bit of any byte, or any other damage, half of it in the list of members at the end."""
    if rng.random() < 0.3:
        out = bytearray(data)
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
        return bytes(out)
    if rng.random() < 0.5:
        return mutate_bytes(data[::-1], rng, others)[::-1]
    return mutate_bytes(data, rng, others)


TARGETS = [
    Target("results-json", lambda _: [saved(0)[DOCUMENT]], attack_document, mutate_document),
    Target(
        "results-npz",
        lambda _: [saved(seed)[ARRAYS] for seed in SEEDS],
        attack_arrays,
        mutate_archive,
    ),
    Target("results-people", lambda _: [saved(0, "people")[ARRAYS]], attack_people, mutate_archive),
]
