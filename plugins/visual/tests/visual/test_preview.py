"""Pictures: what is drawn lies where the camera sees it, and the preview holds every panel."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from PIL import Image

from physic_core.body import JOINT_INDEX
from physic_core.types import Intrinsics
from physic_visual.palette import person_color
from physic_visual.panels import (
    CONTACT_VIEWS,
    depth_panel,
    depth_range,
    overlay_panel,
    render_contact_views,
)
from physic_visual.preview import preview_image, preview_png
from physic_visual.render import View, prepare_meshes, render_mesh
from physic_visual.views import (
    build_preview_geometry,
    crown,
    side_view,
    top_view,
)

SPHERE = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
CAMERA = Intrinsics.from_focal(100.0, 101, 81)
PINHOLE = View.perspective(CAMERA, 101, 81)


def in_colors_of_numbers(reconstruction):
    geometry = build_preview_geometry(reconstruction)
    return replace(geometry, dress_colors=geometry.people_colors)


def drawn(view, *centers, colors=1.0):
    """Spheres, the first in the first of the colours."""
    shades = np.broadcast_to(colors, (len(centers), 3)).repeat(len(SPHERE.vertices), axis=0)
    bodies = [SPHERE.vertices + center for center in centers]
    return render_mesh(prepare_meshes(bodies, SPHERE.faces), view, shades)


def is_hue(picture, index):
    """Pixels that show a person's colour, whatever the light."""
    wanted = np.array(person_color(index)) / np.linalg.norm(person_color(index))
    values = picture.astype(float)
    return (values @ wanted > 0.995 * np.linalg.norm(values, axis=-1)) & (values.max(-1) > 40)


def test_the_nearer_hides_the_farther():
    layer = drawn(PINHOLE, [0, 0, 6.0], [0, 0, 4.0], colors=[[1.0, 0, 0], [0, 1.0, 0]])
    assert layer.color[40, 50, 1] > 0.5
    assert layer.color[40, 50, 0] == 0
    assert layer.distance[40, 50] == pytest.approx(3.5, abs=0.005)
    assert np.isinf(layer.distance[0, 0])


def test_what_lies_behind_the_camera_is_not_drawn():
    assert drawn(PINHOLE, [0, 0, -4.0]).alpha.max() == 0


def test_people_are_drawn_where_their_joints_project(reconstruction):
    picture = overlay_panel(reconstruction, in_colors_of_numbers(reconstruction), 320, 240)
    for index, person in enumerate(reconstruction.people):
        spots = person.joints[[0, 9]] @ reconstruction.intrinsics.resized(320, 240).matrix.T
        for column, row in spots[:, :2] / spots[:, 2:]:
            assert is_hue(picture[round(row)][round(column)], index), (index, row, column)


def test_side_and_top_views_frame_the_main_people(make):
    """A stranger far behind, who is small in the photo, does not shrink them."""
    pair = make(people=2)
    alone = replace(pair, people=pair.people[:1])
    near, other = pair.people
    x0, y0, _, _ = other.box
    stranger = replace(
        other,
        vertices=other.vertices + np.float32([0, 0, 20]),
        box=np.array([x0, y0, x0 + 8, y0 + 20], other.box.dtype),
    )
    crowd = replace(pair, people=(near, stranger))
    for draw in (side_view, top_view):
        plans = [draw(build_preview_geometry(result), 600, 440) for result in (alone, crowd)]
        assert plans[0].pixels_per_metre == pytest.approx(plans[1].pixels_per_metre)
        assert set(plans[1].crowns) == {0}


def test_depth_runs_from_red_to_blue_and_unknown_is_grey(reconstruction):
    valid = reconstruction.scene.valid.copy()
    valid[50:60, 100:110] = False
    result = replace(reconstruction, scene=replace(reconstruction.scene, valid=valid), people=())
    picture = depth_panel(result, 160, 120)
    near, far = depth_range(result)
    assert near == pytest.approx(reconstruction.scene.points[..., 2].min(), rel=0.1)
    assert far == pytest.approx(reconstruction.scene.points[..., 2].max(), rel=0.05)
    assert picture[119, 80, 0] > picture[119, 80, 2]  # the floor before the feet
    assert picture[68, 80, 2] > picture[68, 80, 0]  # the foot of the wall
    assert (picture[55, 105] == [190, 190, 188]).all()


def test_a_raised_hand_is_no_crown(reconstruction):
    person, up = reconstruction.people[0], np.array([0.0, -1.0, 0.0])
    top = crown(person, up)
    wrist = person.joints[JOINT_INDEX["left_wrist"]]
    vertices = person.vertices.copy()
    vertices[np.linalg.norm(vertices - wrist, axis=1).argmin()] = top + up
    assert (crown(replace(person, vertices=vertices), up) == top).all()


def test_from_the_side_people_stand_on_the_floor_line(reconstruction):
    plan = side_view(in_colors_of_numbers(reconstruction), 600, 440)
    metre = plan.pixels_per_metre
    middles = []
    for index in (0, 1):
        rows, columns = np.nonzero(is_hue(plan.picture, index))
        assert plan.floor_row - rows.min() == pytest.approx(1.69 * metre, abs=4)
        middles.append((columns.min() + columns.max()) / 2)
        assert columns.min() < plan.crowns[index][0] < columns.max()
        assert plan.crowns[index][1] == pytest.approx(rows.min(), abs=3)
        if index == 1:  # the other's legs are veiled by the box
            assert rows.max() == pytest.approx(plan.floor_row, abs=0.03 * metre)
    assert middles[1] - middles[0] == pytest.approx((3.8 - 3.0) * metre, abs=0.1 * metre)


def test_from_above_people_stand_beside_each_other(reconstruction):
    plan = top_view(in_colors_of_numbers(reconstruction), 400, 900)
    spots = []
    for index in (0, 1):
        rows, columns = np.nonzero(is_hue(plan.picture, index))
        spots.append([(columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2])
    offset = (np.array(spots[1]) - spots[0]) / plan.pixels_per_metre
    assert_allclose(offset, [0.9, -0.8], atol=0.1)  # farther is higher
    assert plan.floor_row is None
    assert (spots[0][0] - plan.camera_px[0]) / plan.pixels_per_metre == pytest.approx(-0.6, abs=0.1)


def test_contact_with_the_floor_is_green_from_below_only(reconstruction):
    shown = render_contact_views(reconstruction, 0, 600, 300)
    green = (shown[..., 1].astype(int) - shown[..., 0]) > 40
    counts = [int(view.sum()) for view in np.split(green, len(CONTACT_VIEWS), axis=1)]
    assert counts[2] > 5 * max(counts[0], counts[1], 1)


def test_the_front_is_the_side_with_the_toes(reconstruction):
    """The mannequin's toes point ahead: they are seen from the front, and the heels from the
    back.
    """
    person = reconstruction.people[0]
    toes = np.zeros(len(person.vertices), bool)
    toe = (person.joints[10] + person.joints[11]) / 2
    toes[np.linalg.norm(person.vertices - toe, axis=1) < 0.17] = True
    result = replace(reconstruction, people=(replace(person, contact=toes, contact_partner=None),))
    shown = render_contact_views(result, 0, 600, 300)
    red = (shown[..., 0].astype(int) - shown[..., 1]) > 60
    assert red[:, :200].sum() > red[:, 200:400].sum()


@pytest.mark.parametrize(("width", "height", "people"), [(320, 90, 0), (64, 960, 1)])
def test_the_preview_is_a_page_of_fixed_width(make, width, height, people):
    image = Image.open(io.BytesIO(preview_png(make(width, height, people=people))))
    assert image.format == "PNG"
    assert image.width == 1280
    assert 500 < image.height < 1500
    assert image.getextrema() != ((250, 250), (250, 250), (248, 248))


def test_a_crowd_and_broken_bodies_do_not_break_the_preview(make):
    before = make(people=2)
    person = before.people[0]
    lost = replace(person, vertices=person.vertices * np.nan, joints=person.joints * np.nan)
    crowd = replace(before, people=(lost, *[before.people[1]] * 19))
    page = preview_image(crowd)
    assert page.width == 1280
    assert page.height < 2000
