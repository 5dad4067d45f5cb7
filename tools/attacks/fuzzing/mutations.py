"""Seeded mutations of bytes and of text."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence

NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
"""Values at which the arithmetic of decoders overflows."""

TOKENS = (
    "0", "-1", "1e309", "-1e309", "nan", "NaN", "inf", "Infinity", "1e-320", "9" * 5000, "0x", "1_0", "true", "null",  # noqa: E501
    '""', "[]", "{}", "[" * 2000, "{" * 500, '"\\u0000"', '"\\ud800"', '"é\U0001f600"', '"~nobody"', '"/dev/zero"',  # noqa: E501
    "\x00", "'", "=", "\n", "[[a]]", "a.b.c=1", "1979-05-27T07:32:00Z",
)  # fmt: skip
"""Tokens of TOML and JSON that parsers and checks of values have failed on."""

_TOKEN = re.compile(r"\"[^\"\n]*\"|[A-Za-z_]+|-?\d+(?:\.\d+)?|[\[\]{}=:,]")


def mutate_bytes(data: bytes, rng: random.Random, others: Sequence[bytes] = ()) -> bytes:
    """Return the data after one to four mutations; parts of ``others`` may be spliced in."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        _mutate_once(out, rng, others)
    return bytes(out)


def _mutate_once(out: bytearray, rng: random.Random, others: Sequence[bytes]) -> None:
    if not out:
        out += rng.randbytes(rng.randrange(1, 64))
        return
    # Headers are short and decide most: half of the mutations hit the first 256 bytes.
    end = len(out) if rng.random() < 0.5 else min(len(out), 256)
    at = rng.randrange(end)
    match rng.randrange(8):
        case 0:
            out[at] ^= 1 << rng.randrange(8)
        case 1:
            out[at] = rng.randrange(256)
        case 2:
            size = rng.choice((1, 2, 4))
            number = rng.choice(NUMBERS) & ((1 << 8 * size) - 1)
            out[at : at + size] = number.to_bytes(size, rng.choice(("little", "big")))
        case 3:
            del out[at:]
        case 4:
            del out[at : at + rng.choice((1, 2, 4, 16, 256))]
        case 5:
            out[at:at] = rng.randbytes(rng.choice((1, 2, 4, 16, 256)))
        case 6:
            size = rng.choice((4, 16, 64, 256))
            out[at:at] = out[at : at + size]
        case _:
            other = rng.choice(others) if others else bytes(out)
            start = rng.randrange(len(other) + 1)
            out[at : at + rng.choice((4, 16, 64, 1024))] = other[
                start : start + rng.choice((4, 16, 64, 1024))
            ]


def mutate_text(text: str, rng: random.Random, tokens: Sequence[str] = TOKENS) -> str:
    """Return the text after one to three mutations of its tokens."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        spans = [match.span() for match in _TOKEN.finditer(text)]
        if not spans:
            return rng.choice(tokens)
        start, end = rng.choice(spans)
        match rng.randrange(5):
            case 0 | 1:
                text = text[:start] + rng.choice(tokens) + text[end:]
            case 2:
                text = text[:start] + text[end:]
            case 3:
                text = text[:start] + text[start:end] * rng.choice((2, 50)) + text[end:]
            case _:
                other = rng.choice(spans)
                text = text[:start] + text[slice(*other)] + text[end:]
    return text
