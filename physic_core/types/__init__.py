"""What passes between backends, the pipeline and the engine: frozen dataclasses of numpy arrays.

One frame everywhere: the OpenCV camera's (x right, y down, z forward), in metres. One pixel convention: integer
coordinates are pixel centres, so the centre of an image is ``((width - 1) / 2, (height - 1) / 2)``. N is people,
J keypoints, V vertices, K shape components, H and W image rows and columns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal

from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    BoolArray = NDArray[np.bool_]
    FloatArray = NDArray[np.floating[Any]]
    IntArray = NDArray[np.integer[Any]]
    UInt8Array = NDArray[np.uint8]

__all__ = [
    "Bodies",
    "BodyParameters",
    "ContactProbability",
    "DepthMap",
    "Diagnostic",
    "Hands",
    "Hints",
    "Intrinsics",
    "Keypoints",
    "Mesh",
    "People",
    "Person",
    "Plane",
    "Pointmap",
    "Provenance",
    "Reconstruction",
    "RestMesh",
    "Scene",
    "StageRecord",
    "Unknown",
]

Unknown = Literal["scale", "scale_shift", "inverse_scale_shift"]
"""What a relative point map leaves open: ``Z = s Z'`` | ``Z = s Z' + t`` | ``1 / Z = s / Z' + t``."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion.

    Attributes:
        fx: focal length along x, px.
        fy: focal length along y, px.
        cx: principal point, px (integer coordinates are pixel centres).
        cy: principal point, px.
        width: image width, px.
        height: image height, px.
        source: where the numbers come from, in words: beginning with "given", "EXIF" or "measured" where they are
            known, with "default" where neither the photo nor its file says anything of them, and else whoever
            estimated them ("vanishing points", a network, ...).
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    source: str = "given"

    @classmethod
    def from_focal(cls, focal_px: float, width: int, height: int, source: str = "given") -> Intrinsics:
        """Square pixels and a centred principal point."""
        return cls(focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, width, height, source)

    @property
    def known(self) -> bool:
        """Whether a user, a file or a sensor vouches for these numbers."""
        return self.source.startswith(("given", "EXIF", "measured"))

    @property
    def guessed(self) -> bool:
        """Whether neither the photo nor its file says anything of these numbers."""
        return self.source.startswith("default")

    @property
    def matrix(self) -> FloatArray:
        """The (3, 3) float64 camera matrix, px."""
        import numpy as np

        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def resized(self, width: int, height: int) -> Intrinsics:
        """The same camera for the image resampled to ``width`` x ``height`` px."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
            width=width,
            height=height,
        )


@dataclass(frozen=True)
class Plane(ShortRepr):
    """An oriented plane: the height of a point X over it is ``normal . X + offset``.

    Attributes:
        normal: (3,) unit vector that points up, out of the floor, on the camera's side.
        offset: height of the camera over the plane, in the units of the points (metres once scaled).
    """

    normal: FloatArray
    offset: float


@dataclass(frozen=True)
class Keypoints(ShortRepr):
    """2D keypoints of N people, row i belonging to person i.

    Attributes:
        points: (N, J, 2) float px.
        confidence: (N, J) float in [0, 1].
        skeleton: name of the joint set: "coco17", "coco23" (with feet), "blazepose33", "halpe26",
            "coco_wholebody133"; see :data:`physic_core.body.landmarks.DETECTED`.
        world: (N, J, 3) metres, or None. Axes of a camera that looks straight at the person (x right, y down, z away),
            origin between the hips: what single-person pose networks call world landmarks.
    """

    points: FloatArray
    confidence: FloatArray
    skeleton: str
    world: FloatArray | None = None


@dataclass(frozen=True)
class People(ShortRepr):
    """What a Segmenter answers. Nobody found is N = 0, never None.

    Attributes:
        masks: (N, H, W) bool, visible pixels of each person; masks of two people do not overlap.
        boxes: (N, 4) float px, x0 y0 x1 y1, half open like a slice: ``mask[y0:y1, x0:x1]`` holds the person.
        scores: (N,) float in [0, 1].
        floor: (H, W) bool, pixels of the ground that people stand on, or None when the backend does not look for it.
        keypoints: what the detector saw of the joints on its way, or None.
    """

    masks: BoolArray
    boxes: FloatArray
    scores: FloatArray
    floor: BoolArray | None = None
    keypoints: Keypoints | None = None

    def __len__(self) -> int:
        return len(self.masks)


@dataclass(frozen=True)
class Pointmap(ShortRepr):
    """A 3D point for every pixel, camera frame, up to what ``unknown`` names.

    Attributes:
        points: (H, W, 3) float32; z > 0 where valid.
        valid: (H, W) bool.
        unknown: what separates it from metres.
        intrinsics: the camera that the points fit, if the backend knows it.
        notes: plain words for the user ("focal length is a default").
    """

    points: FloatArray
    valid: BoolArray
    unknown: Unknown
    intrinsics: Intrinsics | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class DepthMap(ShortRepr):
    """Metric depth.

    Attributes:
        depth: (H, W) float32 metres along z (not along the ray), NaN where unknown.
        intrinsics: the camera that the backend estimated or knows, or None. If its source begins with "measured", it is
            used as it is; otherwise it is averaged with the point map's, and depths are rescaled with the focal length.
        scale_sigma: standard deviation of log(scale) as the backend judges it, or None.
        notes: plain words for the user ("scale from the soles of 2 people").
    """

    depth: FloatArray
    intrinsics: Intrinsics | None = None
    scale_sigma: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class BodyParameters(ShortRepr):
    """SMPL-X-named parameters of N bodies: rotation vectors, radians, SMPL-X joint order, flat hand mean, no hand PCA.

    Attributes:
        global_orient: (N, 3) rotation about the pelvis joint.
        body_pose: (N, 63) joints 1-21.
        left_hand_pose: (N, 45) index, middle, pinky, ring, thumb.
        right_hand_pose: (N, 45).
        jaw_pose: (N, 3).
        leye_pose: (N, 3).
        reye_pose: (N, 3).
        betas: (N, K) shape, unit variance, meaningful for one body model only.
        expression: (N, E), E = 0 where the body has none.
        transl: (N, 3) metres, added after posing.
    """

    global_orient: FloatArray
    body_pose: FloatArray
    left_hand_pose: FloatArray
    right_hand_pose: FloatArray
    jaw_pose: FloatArray
    leye_pose: FloatArray
    reye_pose: FloatArray
    betas: FloatArray
    expression: FloatArray
    transl: FloatArray

    def __len__(self) -> int:
        return len(self.transl)

    def __getitem__(self, rows: slice | BoolArray | IntArray) -> BodyParameters:
        """The people that a slice, a mask (N,) or numbers pick."""
        return BodyParameters(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


@dataclass(frozen=True)
class Mesh(ShortRepr):
    """Surfaces of N bodies in one topology.

    Attributes:
        name: of the topology ("smplx", "smpl", "mhr").
        vertices: (N, V, 3) metres, camera frame.
        faces: (F, 3) int, the same for all.
        rest: (V, 3) metres, a body of this topology in the T-pose (y up, facing +z, its left on +x), of any shape; None
            where it is not known. It tells which point of the surface a vertex is.
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    rest: FloatArray | None = None


@dataclass(frozen=True)
class RestMesh(ShortRepr):
    """One body in the T-pose: y up, facing +z, its left on +x, palms down.

    Attributes:
        topology: name of the mesh ("smpl", "smplx").
        vertices: (V, 3) metres.
        faces: (F, 3) int.
    """

    topology: str
    vertices: FloatArray
    faces: IntArray


@dataclass(frozen=True)
class Bodies(ShortRepr):
    """What a BodyEstimator answers: body i belongs to person i.

    Bodies of another model than the configured one are carried over to it, by their joints, and by their mesh if there
    is one. Rotations count where the model is "embedded", "smplx" or "smpl" (joints 0-21 as SMPL's, hands zero): these
    share the T-pose. Of any other model, whose rotations and shape may be zeros, joints or mesh say everything.

    Attributes:
        parameters: of N bodies, in metres and in the camera frame.
        body_model: name of the body model that the parameters are for ("embedded", "smplx", "smpl", "mhr").
        observed: (N, 55) bool, joints that the photo shows; None when the backend does not say.
        joints: (N, 55, 3) metres, camera frame: where the backend itself puts the joints of SMPL-X, NaN where it does
            not say; None where the parameters alone say it.
        mesh: the surfaces, or None.
    """

    parameters: BodyParameters
    body_model: str
    observed: BoolArray | None = None
    joints: FloatArray | None = None
    mesh: Mesh | None = None


@dataclass(frozen=True)
class Hands(ShortRepr):
    """What a HandEstimator answers.

    Attributes:
        rotvecs: (N, 2, 15, 3) radians, left then right, SMPL-X order, flat hand mean.
        confidence: (N, 2) in [0, 1]; 0 where no hand was found (its rotations are then ignored).
        wrists: (N, 2, 3) radians, rotation of each whole hand from the T-pose to the camera frame (not relative to the
            forearm), left then right; None where the backend does not say. The arm then follows it.
    """

    rotvecs: FloatArray
    confidence: FloatArray
    wrists: FloatArray | None = None


@dataclass(frozen=True)
class ContactProbability(ShortRepr):
    """What a ContactPrior answers.

    Attributes:
        probability: (N, V) in [0, 1], how likely each vertex touches the scene.
        topology: name of the mesh that V belongs to.
        rest: that mesh in the T-pose, where it may not be the bodies' own: the probabilities are then carried over.
    """

    probability: FloatArray
    topology: str
    rest: RestMesh | None = None


@dataclass(frozen=True)
class Hints(ShortRepr):
    """What is already known when a backend is asked; a backend that needs none ignores them.

    Attributes:
        intrinsics: camera, when the user, the file or an earlier backend gave it.
        people: of the original photo.
        keypoints: of the original photo.
        hole: (H, W) bool, pixels of the given image that an inpainter made up.
        scene: relative point map of the inpainted photo.
        original: relative point map of the original photo, aligned to ``scene`` outside the people.
        floor: floor plane in the units of ``scene``.
        bodies: in metres, not yet placed in the scene, of the configured model; with ``joints`` where that is a file of
            the user's, which no backend can load.
    """

    intrinsics: Intrinsics | None = None
    people: People | None = None
    keypoints: Keypoints | None = None
    hole: BoolArray | None = None
    scene: Pointmap | None = None
    original: Pointmap | None = None
    floor: Plane | None = None
    bodies: Bodies | None = None


@dataclass(frozen=True)
class Provenance:
    """Which backend answered.

    Attributes:
        interface: "metric_depth", ...
        backend: its name.
        plugin: import name of the plugin.
        distribution: installed distribution.
        version: of the distribution.
        options: resolved options.
        weights_license: in words.
    """

    interface: str
    backend: str
    plugin: str
    distribution: str
    version: str
    options: Mapping[str, Any]
    weights_license: str


@dataclass(frozen=True)
class StageRecord:
    """One stage of a run.

    Attributes:
        name: as the progress bar shows it.
        seconds: time of the work itself.
        load_seconds: time to load weights, apart.
        provenance: the backend, or None for a stage of the engine.
        cached: whether the answer was kept from an earlier run, and the backend neither loaded nor asked.
        failed: whether the backend failed, and the run went on without its answer.
    """

    name: str
    seconds: float
    load_seconds: float = 0.0
    provenance: Provenance | None = None
    cached: bool = False
    failed: bool = False


@dataclass(frozen=True)
class Diagnostic:
    """A self-check of a result: one measured number and its limit. :mod:`physic_core.pipeline.checks` lists all.

    Attributes:
        name: what was measured; stable, so that results can be filtered by it.
        value: the number, or None where there was nothing to measure, and then ``ok`` is True.
        threshold: what ``value`` was held against.
        unit: of both.
        ok: whether nothing speaks against the result here.
        message: in plain words what it means, and where it does not hold, what to do.
        person: whom it is about, counted as in ``Reconstruction.people``; None where it is about the whole photo.
    """

    name: str
    value: float | None
    threshold: float
    unit: str
    ok: bool
    message: str
    person: int | None = None


@dataclass(frozen=True)
class Scene(ShortRepr):
    """The scene without its people, metres, camera frame.

    Attributes:
        points: (H, W, 3) float32.
        normals: (H, W, 3) float32, unit, facing the camera; zero where unreliable.
        colors: (H, W, 3) uint8 RGB of the inpainted photo.
        valid: (H, W) bool.
        floor: plane, or None where none was found.
        floor_points: (M, 3) float32 sampled on the plane.
        scale: the factor that the joint optimisation applied to the scene (already in the points).
        scale_sigma: standard deviation of log(scale) that the metric depth stated, or None.
    """

    points: FloatArray
    normals: FloatArray
    colors: UInt8Array
    valid: BoolArray
    floor: Plane | None
    floor_points: FloatArray
    scale: float = 1.0
    scale_sigma: float | None = None


@dataclass(frozen=True)
class Person(ShortRepr):
    """One reconstructed person, metres, camera frame.

    Of a person for whom a backend gave no body, parameters, vertices and joints are NaN, and nothing is in contact.

    Attributes:
        box: (4,) px, x0 y0 x1 y1.
        score: in [0, 1].
        mask: (H, W) bool.
        keypoints: (J, 2) px.
        keypoint_confidence: (J,).
        parameters: a batch of one.
        vertices: (V, 3) float32.
        joints: (55, 3) float32.
        contact: (V,) bool.
        distance: (V,) float32, signed distance to the scene or the floor: negative inside, inf where nothing is near.
        failed_checks: names of the ``Reconstruction.checks`` about this person that do not hold.
    """

    box: FloatArray
    score: float
    mask: BoolArray
    keypoints: FloatArray
    keypoint_confidence: FloatArray
    parameters: BodyParameters
    vertices: FloatArray
    joints: FloatArray
    contact: BoolArray
    distance: FloatArray
    failed_checks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reconstruction(ShortRepr):
    """People, scene and contact of one photo: one metric camera frame.

    Attributes:
        image: (H, W, 3) uint8 RGB, upright, as reconstructed.
        intrinsics: of ``image``.
        scene: the scene.
        people: as found, best score first.
        faces: (F, 3) int32, of every person's mesh.
        body_model: name of the body model of the people's parameters.
        skeleton: name of the people's keypoints' joint set.
        stages: in order.
        diagnostics: numbers that the engine reports, by stage.
        warnings: what to doubt, in plain words: the messages of the ``checks`` that do not hold for the whole photo,
            or that cost a person their place or their body.
        notes: how the numbers came about, in plain words ("scale from the soles of 2 people").
        config: the resolved configuration.
        checks: what was measured to tell whether the result can be trusted, whether it holds or not.
        photo: digests of the photo file, where there was one, and of its pixels, a space between them; tells the photo
            from others.
    """

    image: UInt8Array
    intrinsics: Intrinsics
    scene: Scene
    people: tuple[Person, ...]
    faces: NDArray[np.int32]
    body_model: str
    skeleton: str
    stages: tuple[StageRecord, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    config: Mapping[str, Any] = field(default_factory=dict)
    checks: tuple[Diagnostic, ...] = ()
    photo: str = ""

    def __repr__(self) -> str:
        people, warnings, sigma = len(self.people), len(self.warnings), self.scene.scale_sigma
        refused = any(check.name == "floor" and not check.ok for check in self.checks)
        parts = (
            "1 person" if people == 1 else f"{people} people",
            f"{self.intrinsics.width} x {self.intrinsics.height}",
            "no floor" if self.scene.floor is None else "floor assumed" if refused else "floor found",
            "scale of unknown error" if sigma is None else f"scale ±{100 * sigma:.0f} %",
            "1 warning" if warnings == 1 else f"{warnings or 'no'} warnings",
        )
        return f"Reconstruction({', '.join(parts)})"

    def save(self, folder: str, *, preview: bool = True, overwrite: bool = False) -> None:
        """Write ``reconstruction.json``, ``.npz``, the GLB files and ``preview.png`` into ``folder``.

        Args:
            folder: made where it is missing. An earlier result of the same photo in it is replaced.
            preview: whether to make ``preview.png``.
            overwrite: whether to replace the result of another photo, and files of a result that were changed since.
                Files that no run wrote are never replaced.

        Raises:
            OutputError: the folder cannot be written, or something of the user's would be lost.
        """
        from physic_core import save_reconstruction

        save_reconstruction(self, folder, preview=preview, overwrite=overwrite)

    @classmethod
    def load(cls, folder: str) -> Reconstruction:
        """Read back what :meth:`save` wrote.

        Raises:
            InputError: a file is missing, or of another schema version.
        """
        from physic_core import load_reconstruction

        return load_reconstruction(folder)
