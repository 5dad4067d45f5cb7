"""Saved results: JSON and npz, complete and compact. They are read, or refused with an error that names the file."""

from __future__ import annotations

import json
import random
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

from fuzzing.mutations import mutate_bytes, mutate_text
from fuzzing.target import Target
from fuzzing.tiny_result import tiny_result
from physic_core.errors import InputError
from physic_core.io.result_folder import digest_of
from physic_core.io.results import load_people, load_reconstruction
from physic_core.io.saving import save_reconstruction
from physic_core.types import Reconstruction

DOCUMENT, ARRAYS, PEOPLE = "reconstruction.json", "reconstruction.npz", "people.npz"
SEEDS = ((0, "exact"), (1, "numbers"))
"""Seed, and what is saved."""


@cache
def saved(seed: int, save: str) -> tuple[dict[str, bytes], Reconstruction]:
    with tempfile.TemporaryDirectory() as folder:
        save_reconstruction(tiny_result(seed), folder, save)
        files = {name: Path(folder, name).read_bytes() for name in (DOCUMENT, ARRAYS)}
        return files, load_reconstruction(folder)


def read(files: dict[str, bytes], folder: Path) -> Reconstruction | None:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    try:
        return load_reconstruction(folder)
    except InputError as error:
        message = str(error)
    assert message.startswith(f"cannot read {folder}/reconstruction."), message
    assert len(message) < 1500 + len(str(folder))
    return None


def seeds_of(name: str) -> Callable[[Path], Sequence[bytes]]:
    return lambda _: [saved(*seed)[0][name] for seed in SEEDS]


def with_digest(document: bytes, name: str, content: bytes) -> bytes:
    """State the digest of a file, as a user does who replaces it: otherwise it is refused before it is parsed."""
    edited = json.loads(document)
    edited["digests"][name] = digest_of(content)
    return json.dumps(edited).encode()


def attack_arrays(data: bytes, folder: Path) -> None:
    """Damaged arrays are refused; with their digest stated, they are read or refused."""
    for seed in SEEDS:
        files, _ = saved(*seed)
        assert data == files[ARRAYS] or read({**files, ARRAYS: data}, folder) is None
        read({DOCUMENT: with_digest(files[DOCUMENT], ARRAYS, data), ARRAYS: data}, folder)


@cache
def saved_people() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        save_reconstruction(tiny_result(), folder, "people")
        return {name: Path(folder, name).read_bytes() for name in (DOCUMENT, PEOPLE)}


def attack_people(data: bytes, folder: Path) -> None:
    """Arrays whose digest is stated are read or refused."""
    (folder / DOCUMENT).write_bytes(with_digest(saved_people()[DOCUMENT], PEOPLE, data))
    (folder / PEOPLE).write_bytes(data)
    with suppress(InputError):
        load_people(folder)


def attack_document(data: bytes, folder: Path) -> None:
    """A document is read as it is: numbers may differ, and what cannot be used is refused."""
    files, _ = saved(0, "numbers")
    read({**files, DOCUMENT: data}, folder)


def documents(_: Path) -> list[bytes]:
    document = json.loads(saved(0, "numbers")[0][DOCUMENT])
    del document["arrays"]["shared"][3:], document["arrays"]["of_person_i"][3:]
    return [json.dumps(document, indent=1).encode()]


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
    Target("results-json", documents, attack_document, mutate_document, 600),
    Target("results-npz", seeds_of(ARRAYS), attack_arrays, mutate_archive, 600),
    Target("results-people", lambda _: [saved_people()[PEOPLE]], attack_people, mutate_archive, 200),
]
