"""Known distributions: backends, commands, energies, executors, export formats; only for hints in messages."""

from __future__ import annotations

__all__ = [
    "CATALOG",
    "COMMANDS",
    "ENERGIES",
    "EXECUTORS",
    "EXPORTERS",
    "distribution_for",
    "how_to_install",
    "known_names",
]

CATALOG: dict[str, dict[str, tuple[str, ...]]] = {
    "physic-embedded": {
        "body_estimator": ("embedded",),
        "contact_prior": ("embedded",),
        "hand_estimator": ("embedded",),
        "inpainter": ("embedded",),
        "keypoint_detector": ("embedded",),
        "metric_depth": ("embedded",),
        "relative_pointmap": ("embedded",),
        "segmenter": ("embedded",),
    },
    "physic-human": {
        "body_estimator": ("camerahmr", "nlf", "sam-3d-body"),
        "contact_prior": ("deco", "interactvlm-results"),
        "hand_estimator": ("hamer", "wilor"),
        "metric_depth": ("unidepth-v2",),
        "relative_pointmap": ("moge-1",),
    },
    "physic-mock": {
        "body_estimator": ("mock",),
        "contact_prior": ("mock",),
        "hand_estimator": ("mock",),
        "inpainter": ("mock",),
        "keypoint_detector": ("mock",),
        "metric_depth": ("mock",),
        "relative_pointmap": ("mock",),
        "segmenter": ("mock",),
    },
    "physic-omnieraser": {
        "inpainter": ("omnieraser",),
    },
    "physic-onnx": {
        "body_estimator": ("camerahmr-onnx",),
        "contact_prior": ("deco-onnx",),
        "hand_estimator": ("wilor-onnx",),
        "inpainter": ("lama-onnx", "mi-gan-onnx"),
        "keypoint_detector": ("rtmo-onnx", "rtmpose-onnx", "vitpose-onnx"),
        "metric_depth": (
            "depth-anything-3-metric-onnx",
            "depth-anything-v2-metric-onnx",
            "depth-pro-onnx",
            "metric3d-v2-onnx",
            "moge-2-onnx",
        ),
        "relative_pointmap": ("depth-anything-onnx", "moge-2-onnx"),
        "segmenter": ("eomt-onnx", "sam2-onnx"),
    },
    "physic-opencv": {
        "inpainter": ("navier-stokes", "patch-based", "telea"),
        "metric_depth": ("file",),
        "relative_pointmap": ("file",),
        "segmenter": ("grabcut",),
    },
    "physic-transformers": {
        "keypoint_detector": ("sapiens2-hf", "vitpose-hf"),
        "metric_depth": ("depth-anything-v2-metric-hf", "depth-pro-hf", "zoedepth-hf"),
        "relative_pointmap": ("depth-anything-hf",),
        "segmenter": ("eomt-hf", "grounded-sam2-hf", "sam3-hf"),
    },
}
"""Backend names by distribution and interface; a test compares them with the installed distributions."""

COMMANDS = {
    **dict.fromkeys(
        ("bench", "plugins check", "plugins compare", "plugins doctor", "plugins new", "setup"),
        "physic-testing",
    ),
    "evaluate": "physic-evaluate",
    "serve": "physic-serve",
    "simulate": "physic-export",
    "view": "physic-viewer",
}
"""Distribution of each known plugin command of ``physic``; a test compares them with the distribution."""

ENERGIES = dict.fromkeys(("paper", "prox", "release"), "physic-paper")
"""Distribution of each known preset of the engine; a test compares them with the distribution."""

EXECUTORS = {"ray": "physic-ray"}
"""Distribution of each known executor of ``physic batch``; a test compares them with the distribution."""

EXPORTERS: dict[str, dict[str, tuple[str, ...]]] = {
    "physic-export": {
        "amass": (".npz",),
        "bvh": (".bvh",),
        "coco": (".json",),
        "glb": (".glb",),
        "hot": (".json",),
        "mjcf": (".xml", ".mjcf"),
        "obj": (".obj",),
        "ply": (".ply",),
        "usd": (".usdc", ".usda", ".usd", ".usdz"),
    },
}
"""Export formats and their suffixes, by distribution; a test compares them with the distribution."""

_IN_CONTRIB = ("physic-omnieraser", "physic-ray")


def distribution_for(interface: str | None, name: str) -> str | None:
    """Return the known distribution that offers a backend, or None; ``interface`` None means any interface."""
    for distribution, offers in CATALOG.items():
        if name in _names(offers, interface):
            return distribution
    return None


def known_names(interface: str | None) -> tuple[str, ...]:
    """Return the backend names that known distributions offer for an interface, or for all interfaces if it is None."""
    return tuple(dict.fromkeys(name for offers in CATALOG.values() for name in _names(offers, interface)))


def _names(offers: dict[str, tuple[str, ...]], interface: str | None) -> tuple[str, ...]:
    if interface is not None:
        return offers.get(interface, ())
    return tuple(name for names in offers.values() for name in names)


def how_to_install(distribution: str, extra: str = "") -> str:
    """Return the install command of a distribution; distributions of this project are installed from a checkout."""
    own = distribution in {*CATALOG, *COMMANDS.values(), *ENERGIES.values(), *EXECUTORS.values(), *EXPORTERS}
    folder = "contrib" if distribution in _IN_CONTRIB else "plugins"
    source = f"{folder}/{distribution}" if own else distribution
    if extra:
        source = f"'{source}[{extra}]'"
    return f"`pip install -e {source}` in a checkout of PhySIC" if own else f"`pip install {source}`"
