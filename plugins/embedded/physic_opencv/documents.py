"""Open a file of another program by its content, as dictionaries, lists and arrays, without running
code.
"""

from __future__ import annotations

import pickle
import zipfile
import zlib
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib import format as npy

from physic_core.body import InvalidArrayError, UnsafePickleError, read_plain
from physic_core.files import open_regular, parse_json

if TYPE_CHECKING:
    from trimesh import Trimesh

MESHES = (".obj", ".ply", ".glb", ".gltf")
_MAX_BYTES = 1 << 30
_CONVERT = """it holds objects that could run code ({what}): convert it where it was made:
    import joblib, torch
    plain = lambda d: {{str(k): plain(v) if hasattr(v, "items") else torch.as_tensor(v) for k, v in d.items()}}
    torch.save(plain(joblib.load("FILE")), "FILE.pt")"""  # noqa: E501


def open_document(path: Path) -> Any:
    """Return the content of an npz, npy, pt, pickle, joblib or JSON file, or of a mesh as
    :class:`trimesh.Trimesh` by name.

    Raises:
        ValueError: it is another file, is too large, or could run code.
    """
    if path.suffix.lower() in MESHES:
        return _meshes(path)
    with open_regular(path) as stream:
        data = stream.read(_MAX_BYTES + 1)
    _check_size(len(data))
    if data[:2] == b"PK":
        return _load_zip(path)
    if data[:6] == b"\x93NUMPY":
        return _load_npy(data)
    if data[:1] == b"\x78":  # joblib's zlib
        unpacked = zlib.decompressobj()
        data = unpacked.decompress(data, _MAX_BYTES + 1)
        _check_size(len(data))
    if data[:1] == b"\x80":
        return _load_pickle(data)
    return parse_json(data.decode("utf-8"))


def _check_size(size: int) -> None:
    if size > _MAX_BYTES:
        raise ValueError("unpacked, it is larger than 1 GiB: keep the pictures that are needed")


def _load_pickle(data: bytes) -> Any:
    try:
        return read_plain(data)
    except UnsafePickleError as error:
        raise ValueError(_CONVERT.format(what=error)) from error
    except (InvalidArrayError, pickle.UnpicklingError) as error:
        raise ValueError(f"it is a damaged pickle: {error}") from error


def _load_npy(data: bytes) -> Any:
    """Return an array, or what an array of objects holds."""
    stream = BytesIO(data)
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    if read(stream)[2].hasobject:
        return _load_pickle(data[stream.tell() :])
    return np.load(BytesIO(data), allow_pickle=False)


def _load_zip(path: Path) -> Any:
    """Return the arrays of an npz by name, or the content of a file of torch."""
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        _check_size(sum(entry.file_size for entry in archive.infolist()))
        if not any(name.endswith("data.pkl") for name in names):
            return {name.removesuffix(".npy"): _load_npy(archive.read(name)) for name in names}
    import torch

    try:
        return _without_tensors(torch.load(path, map_location="cpu", weights_only=True))
    except pickle.UnpicklingError as error:
        what = str(error).partition("\n")[0][:80]
        raise ValueError(_CONVERT.format(what=what)) from error


def _without_tensors(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_tensors(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_tensors(item) for item in value]
    return value.detach().numpy() if hasattr(value, "detach") else value


def _meshes(path: Path) -> dict[str, Trimesh]:
    """Return the meshes of a file in world coordinates, with all their vertices in the order of the
    file.
    """
    import trimesh

    with open_regular(path):
        pass
    try:
        scene = trimesh.load_scene(path, process=False, maintain_order=True)
    except Exception as error:  # trimesh's readers raise many classes
        raise ValueError(f"it cannot be read as a mesh: {error}") from error
    meshes = {}
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        if hasattr(mesh, "faces"):
            meshes[node] = mesh.copy().apply_transform(matrix)
    return meshes
