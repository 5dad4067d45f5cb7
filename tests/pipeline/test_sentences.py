"""Notes and warnings say nothing that the result denies."""

from __future__ import annotations

import re
from contextlib import ExitStack

import pytest

from physic_core import Pipeline, load_config
from physic_core.types.contacts import has_sole_on_floor
from physic_testing.contradictions import contradictions
from physic_testing.worlds import WORLDS, load_world

NO_FLOOR = ['engine.scene.floor="off"']


NOT_SLOW = ("stand", "jump", "hang_from_bar", "hug", "child_by_the_hand")


def case(world, *, floor):
    marks = () if world in NOT_SLOW and (floor or world == "stand") else pytest.mark.slow
    name = world if floor else f"{world} without floor"
    return pytest.param((world, [] if floor else NO_FLOOR), id=name, marks=marks)


@pytest.fixture(scope="module")
def pipelines(few_steps):
    """One with a floor, and one without."""
    noise = ["metric_depth.options.stated_sigma=0.2"]
    with ExitStack() as stack:
        yield [
            stack.enter_context(Pipeline(load_config(preset="mock", overrides=[*noise, *settings])))
            for settings in ([], NO_FLOOR)
        ]


@pytest.fixture(
    scope="module", params=[case(world, floor=floor) for world in WORLDS for floor in (True, False)]
)
def result(request, pipelines):
    world, settings = request.param
    return pipelines[bool(settings)](load_world(world, (160, 120)).image)


def test_sentences_agree_with_contacts_and_floor(result):
    sentences = [*result.notes, *result.warnings]
    assert [denied for denied in sentences if is_denied(denied, result)] == []
    assert re.search(r"all sizes depend|gives the scale|like the sizes", " ".join(sentences))


def test_results_of_worlds_do_not_contradict_themselves(result):
    assert contradictions(result) == []


def is_denied(sentence, result):
    """Return whether contacts or floor of a result deny a sentence."""
    on_floor = [has_sole_on_floor(person.contacts) for person in result.people]
    has_floor = result.scene.floor is not None
    by_soles, by_size, small = (
        re.search(words, sentence)
        for words in (
            r"feet of (\d+)",
            r"usual height of (\d+)",
            r"person (\d+) would be .* tall on",
        )
    )
    return any(
        (
            by_soles and not (has_floor and int(by_soles[1]) == sum(on_floor)),
            by_size and (int(by_size[1]) != len(result.people) or (has_floor and any(on_floor))),
            small and not (on_floor[int(small[1])] and sum(on_floor) > 1),
            has_floor and re.search(r"no floor was detected|look of the photo alone", sentence),
            not has_floor and "upright on the floor" in sentence,
            any(on_floor)
            and re.search(r"no feet on a floor|shows the ground at the feet", sentence),
        )
    )
