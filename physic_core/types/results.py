"""Result of a run: scene, people and contacts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from physic_core.doors import DOORS
from physic_core.errors import InputError, PackageMissingError
from physic_core.types.arrays import shape
from physic_core.types.bodies import JOINT_INDEX
from physic_core.types.depth import Plane
from physic_core.types.records import MARKS, Measures, is_usable
from physic_core.types.short_repr import ShortRepr
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from physic_core.types.arrays import BoolArray, Float64Array, FloatArray, UInt8Array
    from physic_core.types.bodies import BodyParameters
    from physic_core.types.camera import Intrinsics, Lens
    from physic_core.types.contacts import BodyContact, ContactPartner, Support
    from physic_core.types.people import UnposedPerson
    from physic_core.types.records import CheckResult, Exported, StageRecord
    from physic_core.types.skeletons import Skeleton


KNOWN_UP_SIGMA_DEG = 8.0
"""Standard deviation from which on an up direction tells no more than that cameras are upright."""


UNSURE_M = 0.25
"""Error of a wrist or an ankle from which on an arm or leg counts as unsure."""

LIMB_ENDS = {
    f"{side}_{limb}": f"{side}_{joint}"
    for limb, joint in (("arm", "wrist"), ("leg", "ankle"))
    for side in SIDES
}
"""Arm or leg -> joint at its end."""


@dataclass(frozen=True)
class Scene(ShortRepr):
    """Point map and floor of the scene without people, meters, camera frame.

    Attributes:
        points: (H, W, 3) float32, meters.
        normals: (H, W, 3) float32, unit, facing the camera; zero where unreliable.
        colors: (H, W, 3) uint8 RGB of the inpainted photo.
        valid: (H, W) bool, whether a pixel has a point.
        floor: plane, or None if none was found.
        floor_points: (M, 3) float32, meters, sampled on the floor; M = 0 without one.
        scale: the factor that the joint optimization applied to the scene (already in the points).
        scale_sigma: standard deviation of log(scale), or None.
        measured: whether a measured depth gave the scale: it does not depend on the focal length.
        up: (3,) unit vector against gravity, camera frame; None if unknown. On a slope, it differs
            from the floor's normal.
        up_sigma: standard deviation of its angle to the truth in each direction, degrees.
        up_source: what tells it, in words.
    """

    points: FloatArray = field(metadata=shape("H", "W", 3))
    normals: FloatArray = field(metadata=shape("H", "W", 3))
    colors: UInt8Array = field(metadata=shape("H", "W", 3))
    valid: BoolArray = field(metadata=shape("H", "W"))
    floor: Plane | None
    floor_points: FloatArray = field(metadata=shape("M", 3))
    scale: float = 1.0
    scale_sigma: float | None = None
    measured: bool = False
    up: FloatArray | None = field(default=None, metadata=shape(3))
    up_sigma: float | None = None
    up_source: str = ""

    @property
    def level(self) -> Plane | None:
        """The floor; without one, the level plane through the camera; None if up is not known."""
        if self.floor is not None or self.up is None or self.up_sigma is None:
            return self.floor
        return Plane(self.up, 0.0) if self.up_sigma < KNOWN_UP_SIGMA_DEG else None


@dataclass(frozen=True)
class Person(ShortRepr):
    """Body, contacts and detections of one person, meters, camera frame.

    If the body estimator failed for a person, parameters, vertices and joints are NaN and no vertex
    is in contact.

    Attributes:
        box: (4,) x0 y0 x1 y1 in px, half open.
        score: in [0, 1].
        mask: (H, W) bool, visible pixels; empty, with a box of zeros, if the photo does not show
            them.
        keypoints: (J, 2) px.
        keypoint_confidence: (J,) in [0, 1].
        parameters: a batch of one.
        vertices: (V, 3) float32, meters.
        joints: (55, 3) float32, meters, in SMPL-X order.
        contact: (V,) bool, whether the vertex touches something.
        distance: (V,) float32, signed distance to floor or scene, negative inside, inf beyond the
            search radius.
        contact_probability: (V,) float16 in [0, 1], that the vertex touches its partner, or floor
            or scene without a partner. None if the preset estimates none.
        contact_partner: (V,) int16, index into ``Reconstruction.contact_partners``,
            :data:`NO_PARTNER` for vertices that are not in contact. None if the contacts were not
            assigned to partners.
        contacts: contacts by body part, most probable first.
        support: what carries this person; None without a body.
        world_contact: body part -> probability in [0, 1] that it touches the world: floor, scene,
            or a support that the photo does not show. Own body, other people, held objects and
            animals do not count. Parts that ``contacts`` does not list are included; "seat" is the
            buttocks. None without a body, and if the preset estimates none.
        unseen: limbs, hands and feet without a confident keypoint inside the photo at their end:
            their pose is mostly a guess.
        joint_sigma: (55,) meters, root mean square error of each joint relative to the middle of
            the hips, as the body estimator states it; NaN where unknown, None if not stated.
        body_source: what the user gives as this body, such as the tool and its file; "" for an
            estimated one.
        given_joints: (55, 3) meters, joints of a given body in the camera frame; None for an
            estimated body.
        failed_checks: names of the ``Reconstruction.checks`` about this person that failed.
        unknown_checks: names of those for which nothing could be measured.
        trust: probability in [0, 1] that pose, place, contact and size are right; None without
            checks.
        trust_pose: probability in [0, 1] that the pose is right where the photo shows it; None
            without checks.
        trust_place: that the place is right.
        trust_contact: that the contacts of feet, hands and seat are right.
        trust_size: that the size is right.
        why: sentence that names what lowers ``trust`` most, and what to do.
        age: years, as given; None where unknown.
        stature: standing height of the body from soles to crown, meters; None without a body.
        stature_sigma: standard deviation of log(stature), which includes children among people of
            unknown age; None without a body.
        posture: most probable one of :data:`physic_core.types.POSTURES`, by the person observer and
            the axis of the trunk in the photo.
        posture_probability: its probability in [0, 1].
        child_probability: that the person is younger than about 12 years, by the person observer.
            All three are None where it does not say.
        sizes: pelvis_height_m of the joint and seat_height_m of the lowest point of the buttocks,
            over the floor; empty without a body or a floor.
        measures: what the checks judge.
        faces: (F, 3) int32, triangles of the vertices; set by the ``Reconstruction`` that contains
            the person.
    """

    box: FloatArray = field(metadata=shape(4))
    score: float
    mask: BoolArray = field(metadata=shape("H", "W"))
    keypoints: FloatArray = field(metadata=shape("J", 2))
    keypoint_confidence: FloatArray = field(metadata=shape("J"))
    parameters: BodyParameters
    vertices: FloatArray = field(metadata=shape("V", 3))
    joints: FloatArray = field(metadata=shape(55, 3))
    contact: BoolArray = field(metadata=shape("V"))
    distance: FloatArray = field(metadata=shape("V"))
    failed_checks: tuple[str, ...] = ()
    unknown_checks: tuple[str, ...] = ()
    trust: float | None = None
    trust_pose: float | None = None
    trust_place: float | None = None
    trust_contact: float | None = None
    trust_size: float | None = None
    why: str = ""
    faces: NDArray[np.int32] | None = field(default=None, metadata={"stored": False})
    contact_probability: NDArray[np.float16] | None = field(default=None, metadata=shape("V"))
    contact_partner: NDArray[np.int16] | None = field(default=None, metadata=shape("V"))
    contacts: tuple[BodyContact, ...] = ()
    support: Support | None = None
    world_contact: Mapping[str, float] | None = None
    unseen: tuple[str, ...] = ()
    joint_sigma: FloatArray | None = field(default=None, metadata=shape(55))
    body_source: str = ""
    given_joints: FloatArray | None = field(default=None, metadata=shape(55, 3))
    age: float | None = None
    stature: float | None = None
    stature_sigma: float | None = None
    posture: str | None = None
    posture_probability: float | None = None
    child_probability: float | None = None
    sizes: Mapping[str, float] = field(default_factory=dict)
    measures: Measures = field(default_factory=Measures)

    def joint(self, name: str) -> FloatArray:
        """Return the position (3,) of a joint of :data:`physic_core.body.JOINT_NAMES`, meters, such
        as ``person.joint("left_knee")``.

        Raises:
            InputError: the joint does not exist.
        """
        if name not in JOINT_INDEX:
            raise InputError(f"no joint is named {name!r}: choose one of {', '.join(JOINT_INDEX)}")
        place: FloatArray = self.joints[JOINT_INDEX[name]]
        return place

    @property
    def marks(self) -> dict[str, float | None]:
        """Probabilities that pose, place, contact and size are right, by name."""
        return {name: getattr(self, f"trust_{name}") for name in MARKS}

    @property
    def usable(self) -> tuple[str, ...]:
        """Names of the ``marks`` that are probably right, from
        :data:`physic_core.types.records.USABLE` on.
        """
        return tuple(name for name, probability in self.marks.items() if is_usable(probability))

    @property
    def has_body(self) -> bool:
        """Whether the person has a body, of finite vertices."""
        import numpy as np

        return len(self.vertices) > 0 and bool(np.isfinite(self.vertices).all())

    @property
    def joint_angles(self) -> dict[str, float]:
        """Angles in degrees by the names of the ISB, such as "left_knee_flexion", see
        :func:`physic_core.body.joint_angles.joint_angles`; NaN without a body.
        """
        angles: dict[str, float] = DOORS["joint_angles"]()(self.parameters.body_pose[0])
        return angles

    @property
    def unseen_joints(self) -> tuple[str, ...]:
        """Joints whose angles are mostly a guess, such as "left_knee", since a part beside them is
        ``unseen``.
        """
        joints: tuple[str, ...] = DOORS["joints_of_parts"]()(self.unseen)
        return joints

    @property
    def limb_sigmas(self) -> dict[str, float]:
        """``joint_sigma`` of wrists and ankles by limb, such as "left_arm", meters; NaN where
        unknown.
        """
        sigma = self.joint_sigma
        return {
            limb: math.nan if sigma is None else float(sigma[JOINT_INDEX[joint]])
            for limb, joint in LIMB_ENDS.items()
        }

    @property
    def unsure(self) -> tuple[str, ...]:
        """Arms and legs that the photo shows, such as "left_arm", whose ``limb_sigmas`` exceed
        :data:`UNSURE_M`.
        """
        return tuple(
            limb
            for limb, sigma in self.limb_sigmas.items()
            if sigma > UNSURE_M and not self.hides(limb)
        )

    def hides(self, limb: str) -> bool:
        """Return whether the end of an arm or leg, such as "left_arm", is ``unseen``."""
        side, _, name = limb.partition("_")
        return f"{side}_lower_{name}" in self.unseen

    def mesh(self) -> Any:
        """Return the body as a ``trimesh.Trimesh``, meters, camera frame (x right, y down, z
        forward).

        Its ``vertex_attributes`` are "contact" (V,) bool and "distance" (V,) float32, m, and
        "contact_probability" (V,) and "contact_partner" (V,) if the result has them.

        Raises:
            InputError: the person has no body, or is not part of a ``Reconstruction``.
        """
        import trimesh

        if self.faces is None:
            raise InputError(
                "this person has no faces: take it from the people of a Reconstruction"
            )
        if not self.has_body:
            raise InputError(
                "this person has no body: the body estimator returned no finite values for them"
            )
        names = ("contact", "distance", "contact_probability", "contact_partner")
        attributes_given = {name: getattr(self, name) for name in names}
        attributes = {
            name: values for name, values in attributes_given.items() if values is not None
        }
        return trimesh.Trimesh(
            self.vertices, self.faces, vertex_attributes=attributes, process=False
        )


@dataclass(frozen=True)
class Reconstruction(ShortRepr):
    """People, scene and contacts of one photo, in the metric frame of its camera.

    Attributes:
        image: (H, W, 3) uint8 RGB, upright, as reconstructed.
        intrinsics: of ``image``.
        people: from left to right in the photo, by the centers of their boxes, or in the order of
            the user's choice; empty for a scene alone.
        faces: (F, 3) int32, of every person's mesh.
        body_model: name of the body model of the people's parameters.
        skeleton: of the people's keypoints, or the name of a standard one.
        stages: in order.
        diagnostics: numbers reported by the engine, by stage.
        warnings: messages of failed ``checks`` of the photo, and of those that left a person
            without a position or a body.
        notes: methods that produced the numbers, as sentences ("scale from the soles of 2 people").
        config: the resolved configuration.
        checks: all self-checks of the result: ok, failed or unknown.
        photo: digest of the photo file, or of the pixels of a photo without a file.
        photo_name: name of the photo file, without its folder; empty for a photo without a file.
        unposed: everyone else who was detected, with the reason why they are not in ``people``.
        lens: camera of the photo file, if it has lens distortion, which ``image`` has not;
            ``lens.file_pixels(pixels, intrinsics)`` maps back. None without distortion.
        contact_partners: everything that people touch; ``Person.contact_partner`` has indices into
            it.
        file_size: width and height of the upright photo file, px; None if unknown.
    """

    image: UInt8Array = field(metadata=shape("H", "W", 3))
    intrinsics: Intrinsics
    scene: Scene
    people: tuple[Person, ...]
    faces: NDArray[np.int32] = field(metadata=shape("F", 3))
    body_model: str
    skeleton: Skeleton | str
    stages: tuple[StageRecord, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    config: Mapping[str, Any] = field(default_factory=dict)
    checks: tuple[CheckResult, ...] = ()
    photo: str = ""
    photo_name: str = ""
    lens: Lens | None = None
    unposed: tuple[UnposedPerson, ...] = ()
    contact_partners: tuple[ContactPartner, ...] = ()
    file_size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        people = tuple(replace(p, faces=self.faces) if p.faces is None else p for p in self.people)
        object.__setattr__(self, "people", people)

    @property
    def floor(self) -> Plane | None:
        """The plane ``scene.floor``."""
        return self.scene.floor

    @property
    def world_from_camera(self) -> Float64Array:
        """Rigid transform (4, 4), meters, from camera frame to world frame: x right, y up,
        z backward, the floor at y = 0, its origin below the camera. Exports with y up are in it.

        Without a floor, the origin is the camera, and y is ``scene.up``, or the camera's up axis if
        that is not known either.
        """
        matrix: Float64Array = DOORS["world"]()(self.scene.level)
        return matrix

    def in_world(self, points: FloatArray) -> Float64Array:
        """Return points (..., 3) of the camera's frame in the world frame, meters: the second
        coordinate is the height over the floor.
        """
        matrix = self.world_from_camera
        return points @ matrix[:3, :3].T + matrix[:3, 3]

    @property
    def usable(self) -> dict[str, int]:
        """Number of people for whom each of pose, place, contact and size is usable."""
        return {name: sum(name in person.usable for person in self.people) for name in MARKS}

    @property
    def distance_sigma(self) -> float | None:
        """Standard deviation of the logarithm of all distances in the scene, by the stated errors
        of scale and focal length; None if the scale has none.
        """
        sigma = self.scene.scale_sigma
        if sigma is None or self.scene.measured:
            return sigma
        return math.hypot(sigma, self._focal_sigma)

    @property
    def distance_sigmas(self) -> tuple[float | None, ...]:
        """The same for each person's distance from the camera, by the larger error of scale and
        stature, or that of a measured depth; None where no error is stated.
        """
        if self.scene.measured:
            return tuple(self._sigma_by_measured_depth(person) for person in self.people)
        own = (person.stature_sigma for person in self.people)
        sigmas_of_person = (
            [sigma for sigma in (one, self.scene.scale_sigma) if sigma is not None] for one in own
        )
        return tuple(
            math.hypot(max(sigmas), self._focal_sigma) if sigmas else None
            for sigmas in sigmas_of_person
        )

    def file_pixels(self, pixels: FloatArray) -> FloatArray:
        """Return the pixels (..., 2) of the upright photo file that show the same as pixels of
        ``image``.
        """
        import numpy as np

        if self.lens is not None:
            return self.lens.file_pixels(pixels, self.intrinsics)
        size = self.image.shape[1::-1]
        return (np.asarray(pixels, np.float64) + 0.5) * np.divide(
            self.file_size or size, size
        ) - 0.5

    @property
    def _focal_sigma(self) -> float:
        return 0.0 if self.intrinsics.known else self.intrinsics.focal_sigma or 0.0

    def _sigma_by_measured_depth(self, person: Person) -> float | None:
        """Return the error of a distance by a measured depth; its part across z depends on the
        focal length.
        """
        distance = pelvis_distance_m(person)
        sigma = self.scene.scale_sigma
        if distance is None or sigma is None:
            return sigma
        across = 1 - (float(person.joints[0, 2]) / distance) ** 2
        return math.hypot(sigma, self._focal_sigma * across)

    def __repr__(self) -> str:
        people = len(self.people)
        without = sum(one.is_another_person for one in self.unposed)
        warnings = len(self.warnings)
        sigma = self.scene.scale_sigma
        parts = (
            "1 person" if people == 1 else f"{people} people",
            *([f"{without} without a body"] if without else []),
            f"{self.intrinsics.width} x {self.intrinsics.height}",
            "no floor" if self.scene.floor is None else "floor detected",
            "scale of unknown error" if sigma is None else f"scale ±{100 * sigma:.0f} %",
            "1 warning" if warnings == 1 else f"{warnings or 'no'} warnings",
        )
        return f"Reconstruction({', '.join(parts)})"

    def _repr_html_(self) -> str:
        """Return the preview as an HTML image, which notebooks show; rendering it takes about a
        second.
        """
        import base64

        picture = base64.b64encode(DOORS["preview"]()(self)).decode()
        return f'<img src="data:image/png;base64,{picture}" alt="{self!r}" style="max-width: 100%">'

    def scene_points(self) -> Any:
        """Return the valid points of the scene as a colored ``trimesh.PointCloud``, meters, camera
        frame.
        """
        import trimesh

        valid = self.scene.valid
        return trimesh.PointCloud(self.scene.points[valid], self.scene.colors[valid])

    def summary(self) -> dict[str, float | int | str | None]:
        """Return a flat dictionary, as one row of a table, by the names of
        :data:`physic_core.types.SUMMARY_COLUMNS`; None where not measured.
        """
        row: dict[str, float | int | str | None] = DOORS["photo_row"]()(self)
        return row

    def with_warnings(self, *texts: str) -> Reconstruction:
        """Return the result with further warnings."""
        return replace(self, warnings=(*self.warnings, *texts))

    def save(self, folder: str, save: str = "pictures", *, overwrite: bool = False) -> None:
        """Write ``reconstruction.json``, ``reconstruction.npz``, ``combined.glb`` and
        ``preview.png`` to a folder.

        Args:
            folder: a new or empty one, or that of an earlier result of the same photo without a
                change, which is replaced as a whole.
            save: "pictures"; "numbers" for the first two files alone; "people" without photo and
                scene in the arrays.
            overwrite: whether to replace the result of another photo.

        Raises:
            ConfigError: ``save`` is not valid.
            OutputError: the folder cannot be written, or has a file of the user.
        """
        DOORS["save"]()(self, folder, save, overwrite=overwrite)

    def report(self, path: str, title: str = "") -> None:
        """Write a page with scene, people and contact in 3D and all numbers; it opens in a browser
        without a network.

        Args:
            path: of the HTML file; an earlier page of PhySIC is replaced.
            title: of the page, such as the name of the photo.

        Raises:
            OutputError: the file cannot be written, or is not a page of PhySIC.
            PackageMissingError: metricbody-visual, which makes the page, is not installed.
        """
        DOORS["report"]()(self, path, title)

    def show(self) -> Path:
        """Write the page of :meth:`report` to a temporary folder, and open it in the browser.

        Returns:
            The path of the page, also where no browser is found.

        Raises:
            PackageMissingError: metricbody-visual, which makes the page, is not installed.
        """
        import tempfile
        import webbrowser
        from pathlib import Path

        page = Path(tempfile.mkdtemp(prefix="physic-"), "report.html")
        self.report(str(page), self.photo_name)
        webbrowser.open(page.as_uri())
        return page

    def to_pandas(self) -> Any:
        """Return the rows of ``people.csv`` as a ``pandas.DataFrame``; install pandas yourself.

        Raises:
            PackageMissingError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise PackageMissingError("to_pandas needs pandas: pip install pandas") from error

        return pandas.DataFrame(DOORS["person_table"]()(self))

    def export(self, path: str, format: str | None = None, **options: Any) -> Exported:
        """Write a file of another program's format: a skinned GLB, or a format of an installed
        plugin.

        Args:
            path: of the file, or a folder, which then needs ``format``.
            format: "glb", "amass", ...; None for that of the suffix.
            options: ``person`` (index or indices), ``up`` ("y", "z", "camera"), ``scene``,
                ``body_model`` (SMPL-X file of yours) and ``overwrite``, as in
                :func:`physic_core.export_reconstruction`, and options of the format.

        Returns:
            ``files``, the paths, and ``notes``, sentences about frame, fit errors and what was
            omitted.

        Raises:
            InputError: the format is unknown, the result does not have what it needs, or a library
                is missing.
            OutputError: a file exists already, or cannot be written.
        """
        exported: Exported = DOORS["export"]()(self, path, format, **options)
        return exported

    @classmethod
    def load(cls, folder: str) -> Reconstruction:
        """Read a reconstruction from a folder that :meth:`save` wrote.

        Raises:
            InputError: a file is missing, or of another schema version.
        """
        loaded: Reconstruction = DOORS["load"]()(folder)
        return loaded


def pelvis_distance_m(person: Person) -> float | None:
    """Return the distance of a person's pelvis from the camera, meters; None without a body."""
    pelvis = person.joints[0].tolist() if len(person.joints) else [math.nan]
    return math.hypot(*pelvis) if all(map(math.isfinite, pelvis)) else None


_MAIN_SHARE = 0.5


def main_people(boxes: Sequence[FloatArray] | FloatArray) -> tuple[int, ...]:
    """Return the indices of the main people: those at least half as large in the photo as the
    largest one.

    The size is the longer side of the box: people who lie are as large as people who stand.

    Args:
        boxes: (4,) each, x0 y0 x1 y1, px.
    """
    sizes = [max(float(x1 - x0), float(y1 - y0)) for x0, y0, x1, y1 in boxes]
    return tuple(i for i, size in enumerate(sizes) if size >= _MAIN_SHARE * max(sizes))


def metres_text(metres: float, log_sigma: float | None, digits: int = 2) -> str:
    """Return a length with its standard deviation: "4.20 ± 0.71 m"; without one: "4.20 m".

    Args:
        meters: the length.
        log_sigma: standard deviation of its logarithm, or None.
        digits: after the point; one more where the deviation would be 0.
    """
    sigma = None if log_sigma is None else log_sigma * abs(metres)
    digits += bool(sigma and sigma < 0.5 * 10**-digits)
    spread = "" if sigma is None else f" ± {sigma:.{digits}f}"
    return f"{round(metres, digits) + 0.0:.{digits}f}{spread} m"  # no "-0.00"
