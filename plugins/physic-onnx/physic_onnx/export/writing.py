"""Write a torch module as an ONNX file, and compare the outputs of both."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.errors import BackendError, OutputError

from .graphs import UNBATCHED

if TYPE_CHECKING:
    from torch import Tensor, nn

    from .graphs import Ports

__all__ = ["max_relative_difference", "write_graph"]

OPSET = 17


def write_graph(module: nn.Module, inputs: tuple[Tensor, ...], ports: Ports, path: Path) -> None:
    """Trace a module and write it as an ONNX file.

    Tensors of more than 2 GB in total are written to separate files in the same folder.

    Args:
        module: in evaluation mode, on the CPU.
        inputs: an example with at least two rows.
        ports: names of inputs and outputs; the first axis of all but a held mesh is free.
        path: of the file; its folder is made.

    Raises:
        BackendError: torch cannot export it.
        OutputError: the file cannot be written.
    """
    names, outputs = ports
    free = {name: {0: "batch"} for name in (*names, *outputs) if name not in UNBATCHED}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path.parent} cannot be made: {error.strerror}") from error
    try:
        with torch.no_grad(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the tracer, about every shape that it takes for a constant
            torch.onnx.export(
                module,
                inputs,
                str(path),
                input_names=list(names),
                output_names=list(outputs),
                dynamic_axes=free,
                opset_version=OPSET,
                dynamo=False,
            )
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error}") from error
    except Exception as error:  # the exporter's many
        raise BackendError(f"torch {torch.__version__} cannot export it: {type(error).__name__}: {error}") from error


def max_relative_difference(
    module: nn.Module, inputs: tuple[Tensor, ...], ports: Ports, path: Path
) -> dict[str, float]:
    """Return the largest difference of each output between module and file, relative to the output's largest value."""
    import onnxruntime as ort

    session = ort.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    found = session.run(list(ports[1]), {name: value.numpy() for name, value in zip(ports[0], inputs, strict=True)})
    with torch.no_grad():
        wanted = [value.numpy() for value in module(*inputs)]
    return {
        name: float(np.abs(own - true).max() / max(float(np.abs(true).max()), 1e-9))
        for name, own, true in zip(ports[1], found, wanted, strict=True)
    }
