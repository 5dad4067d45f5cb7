"""Graphs that onnxruntime has optimised for this machine, kept in the cache: opening them takes a
third of the time.

A file has the weights, which onnxruntime maps into memory, then the graph, its size and a sum of
both. The sum finds damage, not forgery: files are kept only in a folder that no one else can write
to.
"""

from __future__ import annotations

import hashlib
import mmap
import platform
import secrets
import shutil
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.cache import LruFolder, belongs_to_user, claimed_cache
from physic_networks.runtime import onnxruntime

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

MAX_GRAPH_BYTES = 1 << 30
"""Size limit of all kept graphs together; those of all packaged networks have .2 GB."""
_END = struct.Struct("<QQ")
"""Size of the graph and sum of weights and graph, at the end of a file."""


@dataclass(frozen=True)
class KeptGraph:
    """The optimised form of one ONNX graph for this onnxruntime and this processor.

    The name of a file is a digest of its inputs, so another version never passes for it; its sum
    shows damage. Files are renamed when they are complete, so several processes may write at once.

    Attributes:
        kept: the cache.
        name: of the file, without the random number at its end.
    """

    kept: LruFolder
    name: str

    @classmethod
    def of(cls, graph: str, sha256: str) -> KeptGraph | None:
        """Return the kept form of a graph, by its name and the SHA-256 of its files; None if none
        can be kept.
        """
        ort = onnxruntime()

        kept = claimed_cache("graphs")
        made_of = (
            f"mapped weights, sum {sha256} {ort.__version__} {ort.get_build_info()} {_processor()}"
        )
        return (
            None
            if kept is None
            else cls(kept, f"{graph}-{hashlib.sha256(made_of.encode()).hexdigest()[:24]}")
        )

    def read(self) -> bytes | None:
        """Return the graph, whose weights are in a file of the cache, if it is kept; a damaged file
        is deleted.
        """
        for path in self._files():
            with suppress(OSError):
                if (graph := _read_graph(path)) is not None:
                    self.kept.mark_used(path.name)
                    return graph
                path.unlink()
        return None

    def delete(self) -> None:
        """Delete the file."""
        for path in self._files():
            with suppress(OSError):
                path.unlink()

    def write(self, optimise: Callable[[Path, str], InferenceSession]) -> InferenceSession | None:
        """Keep the graph that ``optimise`` writes, and return its session; None if nothing can be
        written.

        Args:
            optimise: writes a graph to a path and its weights to a file of a name beside it.
        """
        token = secrets.token_hex(4)
        part = self.kept.path / f".{self.name}{self.kept.suffix}.{token}.physic-part"
        complete = self.kept.path / f"{self.name}-{token}{self.kept.suffix}"
        try:
            part.mkdir(mode=0o700)
        except OSError:  # such as a read-only cache
            return None
        try:
            graph = part / "graph"
            weights = part / complete.name
            session = optimise(graph, weights.name)
            with suppress(OSError):
                if not self._files():  # else another process was faster
                    _append_graph(weights, graph.read_bytes())
                    weights.chmod(0o600)
                    weights.rename(complete)
                self.kept.trim(MAX_GRAPH_BYTES)
            return session
        # onnxruntime raises it for a full disk, too; the caller opens the graph again
        except Exception:
            return None
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def _files(self) -> list[Path]:
        # A file of another user is from a time when others could write to the folder.
        return list(
            filter(belongs_to_user, self.kept.path.glob(f"{self.name}-*{self.kept.suffix}"))
        )


def _append_graph(weights: Path, graph: bytes) -> None:
    """Write a graph to the end of the file of its weights."""
    with weights.open("ab+") as file:
        file.write(graph)
        file.flush()
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            total = _checksum(content)
        file.write(_END.pack(len(graph), total))


def _read_graph(path: Path) -> bytes | None:
    """Return the graph in a file, or None if the file is damaged."""
    size = path.stat().st_size - _END.size
    if size <= 0:
        return None
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        length, total = _END.unpack(content[size:])
        with memoryview(content) as every, every[:size] as covered:
            undamaged = _checksum(covered) == total and length <= size
        return content[size - length : size] if undamaged else None


def _checksum(content: mmap.mmap | memoryview) -> int:
    """Return the sum of the 64-bit words of a file, of which the last may be shorter: a third of
    the time of a CRC.
    """
    count = len(content) // 8
    words = int(np.add.reduce(np.frombuffer(content, "<u8", count)))
    return (words + int.from_bytes(content[8 * count :], "little")) % (1 << 64)


@cache
def _processor() -> str:
    """Return a text that identifies the instruction set of the processor."""
    named = f"{platform.system()} {platform.machine()} {platform.processor()}"
    with suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as lines:
        flags = [
            line
            for line in lines
            if line.startswith(("model name", "flags", "Features", "CPU part"))
        ]
        return " ".join([named, *sorted(set(flags))])
    return named
