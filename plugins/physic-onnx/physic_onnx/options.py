"""Settings shared by all backends that run ONNX files."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from physic_core.interfaces import Options

ProviderName = Literal["auto", "cpu", "cuda", "tensorrt", "coreml", "directml"]


class OnnxOptions(Options):
    """Base class of the settings of backends that run ONNX files: provider and threads.

    Files in half precision are taken as they come: what is fed is cast to the type that the file asks for.
    """

    provider: ProviderName = Field(
        "auto",
        description="what onnxruntime computes with; 'auto' follows the device: the CPU, or CUDA on a GPU of NVIDIA",
    )
    threads: int = Field(2, ge=0, le=256, description="threads on the CPU; 0 leaves the choice to onnxruntime")
