"""Partners of contact: floor, classified and unclassified surfaces, other people, and the list by
body part.
"""

from __future__ import annotations

import pytest
import torch

from physic_core.engine.body_parts import ContactRegions
from physic_core.engine.contact.distances import (
    KINDS,
    Distances,
    SkinDistances,
    SurfaceDistances,
    dent_depths,
)
from physic_core.engine.contact.partner import (
    HIDDEN,
    HIDDEN_SEAT,
    TouchInPhoto,
    assign_partners,
    body_contacts,
)
from physic_core.engine.contact.parts import SceneParts, scene_parts
from physic_core.geometry.neighbors import NearestPointSearch
from physic_core.types import NO_PARTNER, SURFACE_NAMES, BodyContact, ContactPartner

NAMES = ("unknown", "floor", "seat", "table", "wall", "water")
UP = torch.tensor([0.0, -1.0, 0.0])
BACK = torch.tensor([0.0, 0.0, -1.0])


def square(height, x=0.0):
    """Points of a level square of 40 cm, 2 cm apart, at a height over y = 0; y is down."""
    steps = torch.arange(0, 0.4, 0.02)
    a, b = torch.meshgrid(steps, steps, indexing="xy")
    return torch.stack([a + x, torch.full_like(a, -height), b + 2], -1).reshape(-1, 3)


def parts_of(*squares, normal=UP):
    points = torch.cat([points for points, _, _ in squares])
    label = torch.cat([torch.full((len(p),), NAMES.index(name)) for p, name, _ in squares])
    seen = torch.cat([torch.full((len(p),), seen) for p, _, seen in squares])
    label[~seen] = -1
    scene = NearestPointSearch(points, normal.expand_as(points).contiguous())
    rows = torch.arange(len(points))
    return points, scene_parts(scene, rows, NAMES, label, -points[:, 1], UP)


@pytest.mark.parametrize(("name", "label"), [("seat", NAMES.index("seat")), ("unknown", -1)])
def test_surfaces_of_one_class_or_none_that_are_apart_have_different_ids(name, label):
    _, parts = parts_of((square(0.45), name, True), (square(0.45, x=1.0), name, True))
    assert len(set(parts.surface[:400].tolist())) == 1
    assert len(parts.surface.unique()) == 2
    assert set(parts.label.tolist()) == {label}


def test_hidden_points_get_the_nearest_visible_class_and_raised_ones_are_not_floor():
    _, parts = parts_of(
        (square(0.0), "floor", True),
        (square(0.45, x=0.4), "seat", True),
        (square(0.45), "floor", False),
    )
    assert parts.ground[:400].all()
    assert {NAMES[label] for label in parts.label[-400:].tolist()} == {"seat"}


@pytest.mark.parametrize(("normal", "name"), [(UP, "unknown"), (BACK, "wall")])
def test_a_surface_that_faces_up_is_no_wall_whatever_its_label(normal, name):
    _, parts = parts_of((square(0.45), "wall", True), normal=normal)
    assert set(parts.label.tolist()) == {NAMES.index(name) or -1}


@pytest.mark.parametrize(("height", "on_floor"), [(0.08, True), (0.3, False)])
def test_nobody_stands_on_water(height, on_floor):
    """Wet sand is labelled so: beside the floor it is floor, and elsewhere it has no name."""
    _, parts = parts_of((square(height), "water", True))
    assert bool(parts.ground.all()) is on_floor
    assert set(parts.label.tolist()) == {-1}


FLOOR_PARTNER = ContactPartner("floor", "floor")
SEAT_PARTNER = ContactPartner("scene", "seat", id=2)


ROOM = (square(0.0), "floor", True), (square(0.45), "seat", True)
ON_SEAT = 500  # a point of the seat
FAR = torch.inf


def partners(
    touched,
    *,
    names=("left_foot",),
    part=0,
    scene=FAR,
    floor=FAR,
    point=0,
    facing=(0.0, 0.0, 0.0),
    room=None,
):
    """Return the partner of each vertex of a person in a room, by the kind of what it touches; None
    without contact. Vertex 0 of person 1 is the nearest skin.

    Args:
        touched: kind of each vertex.
        names: of body parts.
        part: of the vertices, or of each.
        scene: distance from the scene, metres.
        floor: distance from its floor, metres.
        point: of the scene, nearest to the vertices.
        facing: normal of the skin.
        room: parts of the scene.
    """

    def row(values):
        return torch.as_tensor(values).expand(1, len(touched))

    skin = SkinDistances(row(0.0), row(1), row(0))
    normals = torch.tensor(facing).expand(1, len(touched), 3)
    surface = SurfaceDistances(row(scene), row(floor), row(point), torch.zeros_like(normals))
    near = Distances(normals, surface, room or parts_of(*ROOM)[1], skin, skin)
    regions = ContactRegions(names, row(part)[0])
    kinds = torch.tensor([touched])
    table, index = assign_partners(kinds, near, regions, UP, TouchInPhoto())
    return [table[i] if i != NO_PARTNER else None for i in index[0].tolist()]


SCENE, PERSON, OWN, HELD = range(len(KINDS))


def test_each_contact_vertex_has_its_partner():
    found = partners(
        [SCENE, SCENE, SCENE, PERSON, OWN, HELD, HIDDEN_SEAT, HIDDEN, -1],
        names=("left_hand", "head"),
        part=[0, 1] * 4 + [0],
        scene=[0.01, 0.01, FAR, 0.01, 0.01, FAR, FAR, FAR, 0.01],
        floor=[FAR, FAR, 0.0, FAR, FAR, FAR, FAR, FAR, FAR],
        point=[0, ON_SEAT, 0, ON_SEAT, ON_SEAT, 0, 0, 0, 0],
    )
    assert found == [
        FLOOR_PARTNER,
        ContactPartner("scene", "seat", id=0),
        FLOOR_PARTNER,
        ContactPartner("person", person=1, part="left_hand"),
        ContactPartner("self", part="left_hand"),
        ContactPartner("object"),
        ContactPartner("hidden", "seat"),
        ContactPartner("hidden"),
        None,
    ]


@pytest.mark.parametrize(
    ("part", "label", "facing", "name"),
    [
        ("left_foot", "wall", 1.0, ""),
        ("left_foot", "wall", 0.0, "wall"),
        ("left_foot", "seat", 1.0, "seat"),
        ("seat", "table", 1.0, "seat"),
        ("seat", "wall", 1.0, "seat"),
        ("seat", "seat", 1.0, "seat"),
    ],
)
def test_a_part_rests_on_no_wall_and_people_sit_on_a_seat(part, label, facing, name):
    _, room = parts_of((square(0.45), label, True), normal=BACK)
    skin = 0.0, facing, 1 - facing
    (found,) = partners([SCENE], names=(part,), scene=0.0, facing=skin, room=room)
    assert found.surface == name


def test_the_list_by_body_part_has_the_most_probable_contact_first():
    table = (FLOOR_PARTNER, SEAT_PARTNER)
    index = torch.tensor([0] * 4 + [1] * 5 + [NO_PARTNER] * 3 + [1] * 2)
    regions = ContactRegions(("seat", "left_foot"), torch.tensor([1] * 4 + [0] * 8 + [1] * 2))
    probability = torch.tensor([0.5] * 4 + [0.8] * 5 + [0.1] * 3 + [0.9] * 2)
    dent = torch.tensor([torch.nan] * 4 + [0.02] * 10)
    contacts = body_contacts(index, probability, dent, table, regions)
    assert contacts == (
        BodyContact("seat", SEAT_PARTNER, 0.8, 5, 0.02),
        BodyContact("left_foot", FLOOR_PARTNER, 0.5, 4),
    )
    assert [str(one) for one in contacts] == ["buttocks: seat, 0.80", "left foot: floor, 0.50"]
    assert body_contacts(index, None, dent, table, regions)[0].probability is None


def test_a_part_that_no_pixel_shows_is_listed_once_on_what_most_of_it_touches():
    table = (FLOOR_PARTNER, SEAT_PARTNER)
    index = torch.tensor([0] * 4 + [1] * 5)
    regions = ContactRegions(("left_foot",), torch.zeros(9, dtype=torch.int64))
    person = index, torch.full((9,), 0.8), torch.full((9,), torch.nan), table, regions
    assert {one.partner for one in body_contacts(*person)} == set(table)
    assumed = body_contacts(*person, assumed={"left_foot": 0.7})
    assert assumed == (BodyContact("left_foot", SEAT_PARTNER, 0.7, 5, assumed=True),)


def test_an_object_is_listed_with_the_probability_of_its_hand_that_no_pixel_shows_too():
    regions = ContactRegions(("left_hand",), torch.zeros(4, dtype=torch.int64))
    person = torch.zeros(4, dtype=torch.int64), torch.full((4,), 0.8), torch.full((4,), torch.nan)
    held = ContactPartner("object")
    listed = body_contacts(
        *person, (held,), regions, assumed={"left_hand": 0.1}, min_probability=0.5
    )
    assert listed == (BodyContact("left_hand", held, 0.8, 4, assumed=True),)


def test_own_parts_are_listed_once_from_the_outer_one_and_adjacent_ones_are_not():
    names = ("left_hand", "head", "left_upper_arm", "torso")
    table = tuple(ContactPartner("self", part=name) for name in names)
    # the last: the torso touches the head
    index = torch.tensor([1, 0, 3, 2, 1]).repeat_interleave(4)
    regions = ContactRegions(names, torch.tensor([0, 1, 2, 3, 3]).repeat_interleave(4))
    likely = torch.tensor([0.4, 0.6, 0.5, 0.5, 0.9]).repeat_interleave(4)
    person = index, likely, torch.full(index.shape, torch.nan), table, regions
    contacts = body_contacts(*person)
    assert [(one.part, one.partner.part) for one in contacts] == [("left_hand", "head")]
    assert body_contacts(*person, min_probability=0.61) == ()


@pytest.mark.parametrize("height", [0.02, -0.01, -0.06, -0.14])
def test_a_dent_is_as_deep_as_the_vertex_and_as_its_surface_gives_way(height):
    label = torch.arange(-1, len(SURFACE_NAMES))
    distance = torch.full((1, len(label)), height)
    none = torch.zeros(len(label), dtype=torch.int64)
    far = torch.full_like(distance, torch.inf)
    near = SurfaceDistances(distance, far, torch.arange(len(label))[None], torch.zeros(1, 1, 3))
    dents = dent_depths(near, SceneParts(SURFACE_NAMES, label, none, none.bool()))[0].tolist()
    gives = {"bed": 0.10, "seat": 0.08, "vegetation": 0.05, "ground": 0.03, "rug": 0.02}
    wanted = [
        min(max(-height, 0), gives[name]) if name in gives else torch.nan
        for name in ("", *SURFACE_NAMES)
    ]
    assert dents == pytest.approx(wanted, nan_ok=True)
