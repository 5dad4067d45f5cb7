"""The offline default on the photos of examples/, with real networks. One result of each photo
serves all tests; those of more than a photo of one person and one of two are slow.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.same_photo import PHOTO, Variant, answer_of, change
from physic_batch.photo_processor import batch_config
from physic_core import Pipeline, load_config
from physic_core.body import load_body
from physic_core.cache.folders import CACHE_VARIABLE
from physic_core.types import CameraTrust, Intrinsics, PeoplePrompt
from physic_testing.worlds import load_world

EXAMPLES = Path(__file__).parents[2] / "examples"
NUMBERS = Path(__file__).parents[2] / "docs" / "pictures" / "numbers"
MIRRORED_AND_CROPPED = Variant("mirrored and cropped", mirrored=True, margin=0.02)


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    """With a cache of its own: several tests show a photo to the same networks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, str(tmp_path_factory.mktemp("cache")))
        with Pipeline(batch_config(load_config(preset="embedded"), with_cache=True)) as pipeline:
            yield pipeline


PHOTOS = {file.stem: file for file in EXAMPLES.iterdir() if file.suffix in (".jpg", ".png")}
"""By the names that pages give them."""
QUICK = ("couple",)


@pytest.fixture(scope="module")
def result_of(pipeline):
    """A function that gives the result of a photo by its name."""
    return cache(lambda name: pipeline(PHOTOS[name]))


MAN = (395.0, 420.0, 589.0, 1044.0)
"""Box of a man of the photo "slope", px."""


@pytest.fixture(scope="module")
def joints_alone(pipeline):
    """Joints (55, 3) of the man who is chosen alone."""
    return pipeline(PHOTOS["slope"], people=PeoplePrompt(boxes=(MAN,))).people[0].joints


@pytest.mark.slow
@pytest.mark.parametrize(("top", "bottom"), [(0.2, 0.6), (0.0, 0.35), (0.5, 1.0)])
def test_a_false_person_within_a_person_moves_no_other(pipeline, joints_alone, top, bottom):
    within = (MAN[0] + 20, MAN[1] + top * 624, MAN[2] - 20, MAN[1] + bottom * 624)
    both = pipeline(PHOTOS["slope"], people=PeoplePrompt(boxes=(MAN, within)))
    (person,) = both.people
    moved = np.linalg.norm(person.joints - joints_alone, axis=1)
    assert moved.max() < 0.02 * np.linalg.norm(person.joints[0])
    assert len(both.unposed) == 1


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(file.stem, marks=[] if file.stem in QUICK else pytest.mark.slow)
        for file in sorted(NUMBERS.glob("*.json"))
    ],
)
def test_pictures_and_pages_show_the_numbers_of_the_result(result_of, name, module_at):
    docs = module_at("tools/docs_numbers.py")
    shown = docs.read_numbers()[name]
    if name in PHOTOS:
        result = result_of(name)
    else:
        with Pipeline("mock") as pipeline:
            result = pipeline(load_world(shown["of"].removeprefix("world ")).image)
    assert docs.differences(shown, docs.numbers_of(result)) == [], (
        f"`{docs.COMMAND}` renews what is old"
    )


@pytest.mark.slow
def test_people_stay_where_they_are_if_the_photo_is_mirrored_and_cropped(result_of, pipeline):
    changes = []
    for result in map(result_of, PHOTOS):
        height, width = result.image.shape[:2]
        camera = Intrinsics.from_focal(result.intrinsics.fx, width, height, trust=CameraTrust.KNOWN)
        picture = MIRRORED_AND_CROPPED.picture(result.image)
        other = pipeline(picture, intrinsics=MIRRORED_AND_CROPPED.camera(camera))
        changes.append(
            change(
                answer_of(result.people, PHOTO, width, height),
                answer_of(other.people, MIRRORED_AND_CROPPED, width, height),
            )
        )
    people = [person for found in changes for person in found.people]
    ratios = np.exp([abs(person.distance) for person in people])
    assert [found.lost for found in changes] == [0] * len(PHOTOS)
    assert np.median(ratios) <= 1.02
    assert np.percentile(ratios, 90) <= 1.2
    assert np.mean([len(set(person.usable)) > 1 for person in people]) <= 0.3


# ---- the photo with one man who stands whole, and one who is cut at the hips
# -----------------------------------------


@pytest.fixture
def result(result_of):
    return result_of("basketball")


def whole_and_cut(result):
    """The man on the left of the photo, and the one on its right."""
    first, second = np.argsort([person.box[0] for person in result.people])
    return int(first), int(second)


@pytest.mark.slow
def test_the_man_who_is_not_cut_off_stands_on_the_floor(result):
    whole, cut = whole_and_cut(result)
    person = result.people[whole]
    assert not person.failed_checks
    assert person.trust > result.people[cut].trust
    assert person.joints[0, 2] > result.people[cut].joints[0, 2] > 0
    (lean,) = (check for check in result.checks if (check.name, check.person) == ("lean", whole))
    assert abs(lean.value) < 12
    assert (person.distance < -0.03).mean() < 0.01
    floor = result.scene.floor
    heights = person.joints @ floor.normal + floor.offset
    soles = [load_body().contact_sets[f"{side}_sole"].numpy() for side in ("left", "right")]
    lowest = (person.vertices[np.concatenate(soles)] @ floor.normal + floor.offset).min()
    assert abs(lowest) < 0.03
    assert heights[12] - heights[7:9].min() > 1.0
