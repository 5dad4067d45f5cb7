"""Build CameraHMR, WiLoR and DECO from checkouts and load their checkpoints, ready for export."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from physic_core.adapters.checkouts import Checkout
from physic_core.adapters.chumpy_free import chumpy_free_copy
from physic_core.errors import BackendError, WeightsMissingError

from .graphs import CameraHmrGraph, DecoGraph, WilorGraph

if TYPE_CHECKING:
    from torch import nn

__all__ = ["build_camerahmr", "build_deco", "build_wilor"]


def build_camerahmr(
    folder: Path, checkpoint: Path | None = None, smpl: Path | None = None, *, trusted: bool
) -> nn.Module:
    """Build CameraHMR with SMPL from a checkout and load its checkpoint.

    Args:
        folder: of the checkout; its ``data`` holds the files that its scripts fetch.
        checkpoint: ``camerahmr_checkpoint_cleaned.ckpt``; in the checkout's data where None.
        smpl: ``SMPL_NEUTRAL.pkl`` or ``.npz``; in the checkout's data where None.
        trusted: whether the checkpoint may hold Python objects, and run code by them.

    Raises:
        WeightsMissingError: something is not there.
        BackendError: it does not fit.
        BodyModelError: the SMPL file cannot be used.
    """
    checkout = _checkout(folder, "CameraHMR", "core.camerahmr_model", "https://github.com/pixelite1201/CameraHMR")
    checkpoint = _file(checkpoint or folder / "data/pretrained-models/camerahmr_checkpoint_cleaned.ckpt")
    smpl = _file(smpl or folder / "data/models/SMPL/SMPL_NEUTRAL.pkl")
    with chumpy_free_copy(smpl, "smpl") as plain, _working_in(checkout, folder):
        network = checkout.attribute("CameraHMR")()
        _fill(network, _read(checkpoint, trusted), "state_dict", checkpoint)
        layer = checkout.attribute("SMPLLayer", "smplx")(model_path=str(plain), num_betas=10)
    return CameraHmrGraph(network, layer).eval()


def build_wilor(folder: Path, files: Path, *, trusted: bool) -> nn.Module:
    """Build WiLoR with WiLoR-mini's network from a checkout and load its checkpoint.

    Args:
        folder: of the checkout.
        files: folder of ``wilor_final.ckpt``, ``MANO_RIGHT.pkl`` and ``mano_mean_params.npz``.
        trusted: as of :func:`camerahmr`.

    Raises:
        WeightsMissingError: something is not there.
        BackendError: it does not fit.
        BodyModelError: the MANO file cannot be used.
    """
    checkout = _checkout(folder, "WiLoR-mini", "wilor_mini.models.wilor", "https://github.com/warmshao/WiLoR-mini")
    checkpoint, mano, mean = (
        _file(files / name) for name in ("wilor_final.ckpt", "MANO_RIGHT.pkl", "mano_mean_params.npz")
    )
    with chumpy_free_copy(mano, "mano") as plain, _working_in(checkout, folder):
        network = checkout.attribute("WiLor")(
            mano_model_path=str(plain), mano_mean_path=str(mean), focal_length=5000, image_size=256
        )
        _fill(network, _read(checkpoint, trusted), "state_dict", checkpoint)
    return WilorGraph(network).eval()


def build_deco(folder: Path, checkpoint: Path | None = None, tpose: Path | None = None, *, trusted: bool) -> nn.Module:
    """Build DECO from a checkout and load its checkpoint.

    Args:
        folder: of the checkout.
        checkpoint: ``deco_best.pth``; in the checkout's folder ``checkpoints`` where None.
        tpose: mesh of SMPL in the T-pose; the one of the checkout's data where None.
        trusted: as of :func:`camerahmr`.

    Raises:
        WeightsMissingError: something is not there.
        BackendError: it does not fit.
    """
    import inspect

    import trimesh

    checkout = _checkout(folder, "DECO", "models.deco", "https://github.com/sha2nkt/deco")
    checkpoint = _file(checkpoint or folder / "checkpoints/Release_Checkpoint/deco_best.pth")
    tpose = _file(tpose or folder / "data/smpl/smpl_neutral_tpose.ply")
    mesh: Any = trimesh.load(tpose, process=False)
    with _working_in(checkout, folder):
        kind = checkout.attribute("DECO")
        # Encoder, whether it looks at the context too, device; older versions always do, and have no such argument.
        takes_context = "context" in inspect.signature(kind).parameters
        network = kind("hrnet", True, "cpu") if takes_context else kind("hrnet", "cpu")
        _fill(network, _read(checkpoint, trusted), "deco", checkpoint)
    return DecoGraph(network, mesh.vertices, mesh.faces).eval()


def _checkout(folder: Path, name: str, package: str, homepage: str) -> Checkout:
    """Return the checkout, or raise WeightsMissingError if it is incomplete."""
    checkout = Checkout(str(folder), name=name, package=package, homepage=homepage, option="--checkout")
    lacking = checkout.missing()
    if lacking:
        raise WeightsMissingError("; ".join(lacking))
    return checkout


def _file(path: Path) -> Path:
    """Return the path of an existing file, or raise WeightsMissingError."""
    if not path.is_file():
        raise WeightsMissingError(f"there is no file {path}: get it as the checkout's own instructions say")
    return path.absolute()  # a link keeps its name, by which smplx tells right hands


@contextmanager
def _working_in(checkout: Checkout, folder: Path) -> Iterator[None]:
    """Import from a checkout and run in its folder, from which it reads its data."""
    before = Path.cwd()
    with checkout.activated():
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)


def _read(path: Path, trusted: bool) -> Any:
    """Read a checkpoint, or raise BackendError."""
    try:
        return torch.load(path, map_location="cpu", weights_only=not trusted)
    except Exception as error:  # pickle's, zipfile's and torch's own
        hint = "" if trusted else "; if it holds Python objects and you trust its origin, add --trust"
        raise BackendError(f"{path} cannot be read: {type(error).__name__}: {error}{hint}") from error


def _fill(network: nn.Module, state: Mapping[str, Any], key: str, path: Path) -> None:
    """Load a checkpoint's tensors into a network; unknown tensors are ignored."""
    try:
        result = network.load_state_dict(state.get(key, state), strict=False)
    except RuntimeError as error:
        raise BackendError(f"{path} does not fit the network of the checkout: {error}") from error
    absent = [name for name, _ in network.named_parameters() if name in result.missing_keys]
    if absent:
        raise BackendError(
            f"{path} is missing {len(absent)} parameters of the network, {', '.join(absent[:3])}, ...: "
            "it is the checkpoint of another network or of another version of the checkout"
        )
