"""What is suggested for a name of weights that there is not."""

from __future__ import annotations

import pytest

from physic_core.discovery.error_text import format_choice, similar_names

NAMES = (
    *("big-lama", "instanthmr", "lama-carve", "mi-gan", "moge-1-vitl"),
    *("moge-2-vitb-normal", "moge-2-vitl-normal", "moge-2-vits-normal", "sam2.1-hiera-tiny", "sam3-hf"),
    *("vitpose-b-coco", "vitpose-h-wholebody", "vitpose-l-coco", "vitpose-l-wholebody", "vitpose-s-coco"),
)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("moge-2-vits-norml", ["moge-2-vits-normal"]),
        ("oge-2-vits-normal", ["moge-2-vits-normal"]),
        ("moge-2", ["moge-2-vitb-normal", "moge-2-vitl-normal", "moge-2-vits-normal"]),
        ("moge-2-onnx", ["moge-2-vitb-normal", "moge-2-vitl-normal", "moge-2-vits-normal"]),
        ("sam2-onnx", ["sam2.1-hiera-tiny"]),
        ("lama", ["big-lama", "lama-carve"]),
        ("sam", ["sam2.1-hiera-tiny", "sam3-hf"]),
        ("vitpose", [name for name in NAMES if name.startswith("vitpose")]),
        ("yolo", []),
    ],
)
def test_a_common_prefix_is_closer_than_a_common_suffix(name: str, expected: list[str]):
    assert similar_names(name, NAMES) == expected


def test_choices_are_joined_by_commas_and_or():
    assert format_choice(NAMES[:1]) == "'big-lama'"
    assert format_choice(NAMES[:3]) == "'big-lama', 'instanthmr' or 'lama-carve'"
