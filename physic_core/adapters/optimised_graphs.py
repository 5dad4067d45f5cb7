"""Graphs that onnxruntime has optimised for this machine, kept in the cache: opening them takes a third of the time."""

from __future__ import annotations

import hashlib
import platform
import secrets
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.cache.folders import graphs_folder
from physic_core.cache.lru_folder import GRAPH_SUFFIX, mark_used, trim_folder

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

__all__ = ["MAX_BYTES", "KeptGraph"]

MAX_BYTES = 1 << 30
"""All kept graphs have at most this size; those of all packaged networks have .17 GB."""


@dataclass(frozen=True)
class KeptGraph:
    """The optimised form of one ONNX graph for this onnxruntime and this processor.

    A file is named for what it was made of and for a checksum of its content: no other version is taken for it, and
    damage is noticed. Files are renamed when they are complete: any number of processes may write.

    Attributes:
        folder: of the cache.
        name: of the file, without the checksum of its content.
    """

    folder: Path
    name: str

    @classmethod
    def of(cls, graph: str, sha256: str) -> KeptGraph | None:
        """Return the kept form of a graph, by its name and SHA-256; None if the cache is switched off."""
        import onnxruntime as ort

        folder = graphs_folder()
        made_of = f"{sha256} {ort.__version__} {ort.get_build_info()} {_processor()}"
        return None if folder is None else cls(folder, f"{graph}-{hashlib.sha256(made_of.encode()).hexdigest()[:24]}")

    def read(self) -> bytes | None:
        """Return the graph, if it is kept; a damaged file is deleted."""
        for path in self._files():
            with suppress(OSError):
                content = path.read_bytes()
                if path.name == self._file_name(content):
                    mark_used(path)
                    return content
                path.unlink()
        return None

    def delete(self) -> None:
        """Delete the file."""
        for path in self._files():
            with suppress(OSError):
                path.unlink()

    def write(self, optimise: Callable[[Path], InferenceSession]) -> InferenceSession | None:
        """Keep the graph that ``optimise`` writes to a path, and return its session; None if nothing can be written."""
        part = self.folder / f".{self.name}{GRAPH_SUFFIX}.{secrets.token_hex(4)}.physic-part"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            part.touch()
        except OSError:  # such as a cache that may only be read
            return None
        try:
            session = optimise(part)
            with suppress(OSError):
                if (
                    not self._files()
                ):  # else another process was faster; onnxruntime writes the same graph in many orders
                    part.rename(self.folder / self._file_name(part.read_bytes()))
                trim_folder(self.folder, MAX_BYTES, GRAPH_SUFFIX)
            return session
        except Exception:  # onnxruntime raises it for a full disk, too; the caller opens the graph again
            return None
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)

    def _files(self) -> list[Path]:
        return list(self.folder.glob(f"{self.name}-*{GRAPH_SUFFIX}"))

    def _file_name(self, content: bytes) -> str:
        return f"{self.name}-{zlib.crc32(content):08x}{GRAPH_SUFFIX}"


@cache
def _processor() -> str:
    """Return what names the instructions of the processor."""
    named = f"{platform.system()} {platform.machine()} {platform.processor()}"
    with suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as lines:
        flags = [line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part"))]
        return " ".join([named, *sorted(set(flags))])
    return named
