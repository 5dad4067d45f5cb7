"""Command line of ``python -m physic_onnx.export``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from physic_core.errors import PhysicError

__all__ = ["main"]

_MOST_DIFFERENCE = 1e-3


def main(arguments: Sequence[str] | None = None) -> int:
    """Export one network and return the exit status."""
    given = _parser().parse_args(arguments)
    try:
        path = given.output or _place(given.network)
        _export(given, path)
    except PhysicError as error:
        sys.stderr.write(f"error: {error}\n")
        return 1
    sys.stdout.write(f"{path} is written, for the backend '{given.network}-onnx'\n")
    return 0


def _export(given: argparse.Namespace, path: Path) -> None:
    from physic_core.errors import BackendError

    from . import checkouts, graphs
    from .writing import max_relative_difference, write_graph

    folder, trusted = given.checkout.expanduser().resolve(), given.trust
    if given.network == "camerahmr":
        module, ports = (
            checkouts.build_camerahmr(folder, given.checkpoint, given.smpl, trusted=trusted),
            graphs.CAMERAHMR,
        )
    elif given.network == "wilor":
        module, ports = checkouts.build_wilor(folder, given.files, trusted=trusted), graphs.WILOR
    else:
        module, ports = checkouts.build_deco(folder, given.checkpoint, given.tpose, trusted=trusted), graphs.DECO
    write_graph(module, graphs.example_inputs(given.network), ports, path)
    # Another number of rows than it was traced with, so that a batch that became a constant shows.
    apart = max_relative_difference(module, graphs.example_inputs(given.network, 3), ports, path)
    worst = max(apart, key=lambda name: apart[name])
    sys.stdout.write(f"file and network differ by {apart[worst]:.1e} of the largest value at most, in {worst}\n")
    if not apart[worst] < _MOST_DIFFERENCE:
        raise BackendError(f"{path} returns other values than the network: do not use it")


def _place(network: str) -> Path:
    """Return the path at which the backend looks for the file."""
    from physic_core.errors import OutputError
    from physic_core.weights.folders import default_download_folder, user_folders

    folders = [*user_folders(), default_download_folder()]
    if folders[0] is None:
        raise OutputError("there is no folder for weights: give --output FILE")
    return folders[0] / f"{network}-onnx" / "model.onnx"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m physic_onnx.export",
        description="Export a network that you have the licence of, from its checkout and checkpoint, to ONNX.",
    )
    networks = parser.add_subparsers(dest="network", required=True)
    camerahmr = networks.add_parser("camerahmr", help="CameraHMR with SMPL: bodies")
    camerahmr.add_argument("--checkpoint", type=Path, help="camerahmr_checkpoint_cleaned.ckpt")
    camerahmr.add_argument("--smpl", type=Path, help="SMPL_NEUTRAL.pkl")
    wilor = networks.add_parser("wilor", help="WiLoR by WiLoR-mini's network: hands")
    wilor.add_argument(
        "--files", type=Path, required=True, help="folder of wilor_final.ckpt, MANO_RIGHT.pkl, mano_mean_params.npz"
    )
    deco = networks.add_parser("deco", help="DECO: contact")
    deco.add_argument("--checkpoint", type=Path, help="deco_best.pth")
    deco.add_argument("--tpose", type=Path, help="mesh of SMPL in the T-pose, smpl_neutral_tpose.ply")
    for one in (camerahmr, wilor, deco):
        one.add_argument("--checkout", type=Path, required=True, help="root of your checkout of the project")
        one.add_argument("--output", type=Path, help="file to write; where the adapter looks for it, if left out")
        one.add_argument(
            "--trust",
            action="store_true",
            help="read a checkpoint that holds Python objects: it can then run code of whoever made it",
        )
    return parser


if __name__ == "__main__":
    sys.exit(main())
