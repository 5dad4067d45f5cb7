"""Notes and warnings say nothing that the result denies."""

from __future__ import annotations

import re

import pytest

from physic_core import load_config, reconstruct
from physic_testing.worlds import load_world

NO_FLOOR = ['engine.scene.floor="off"']


@pytest.fixture(
    scope="module",
    params=[
        ("stand", []),
        ("stand", NO_FLOOR),
        ("jump", []),
        ("hang_from_bar", []),
        ("sit_on_stool", []),
        ("hug", []),
    ],
    ids=lambda case: "-".join([case[0], *("no floor" for _ in case[1])]),
)
def result(request, few_steps):
    world, settings = request.param
    noise = ["metric_depth.options.stated_sigma=0.095"]
    return reconstruct(
        load_world(world).image, load_config(preset="mock", overrides=[*noise, *settings])
    )


def test_sentences_agree_with_contacts_and_floor(result):
    sentences = " ".join([*result.notes, *result.warnings])
    stand = [
        any(
            c.likely and c.partner.kind == "floor" and c.part in ("left_foot", "right_foot")
            for c in person.contacts
        )
        for person in result.people
    ]
    for count in re.findall(r"soles of (\d+)", sentences):
        assert int(count) == sum(stand)
        assert result.scene.floor is not None
    for count in re.findall(r"body size of (\d+)", sentences):
        assert int(count) == len(result.people)
        assert result.scene.floor is None or not any(stand)
    if re.search(r"no (plane|floor) was found", sentences):
        assert result.scene.floor is None
    assert re.search(r"the scale is from|gives the scale|beside the sizes", sentences)
