"""Run the backends on one photo, in the order of the paper.

Each step calls one backend or the engine, and gets what earlier steps have found. Bodies come
before metric depth, so that a classical depth backend can estimate its scale from the size of
people. OpenCV camera frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.masks import dilate
from physic_core.errors import NoPersonError
from physic_core.interfaces import (
    BodyEstimatorRequest,
    ContactPriorRequest,
    HandEstimatorRequest,
    InpainterRequest,
    KeypointDetectorRequest,
    MetricDepthRequest,
    PersonObserverRequest,
    RelativePointmapRequest,
    SegmenterRequest,
)
from physic_core.interfaces.backend import Result
from physic_core.interfaces.bodies import valid_body_rows
from physic_core.pipeline.backend_results import (
    bodies_for_backends,
    convert_to_configured,
    discard_invalid_bodies,
    discard_invalid_hands,
    discard_invalid_keypoints,
    doubt_of_contact,
    expand_contact,
    real_people,
    replace_hands,
    transfer_contact,
)
from physic_core.pipeline.given.people import (
    ignored_people,
    known_people,
    select_chosen,
    who_got_which,
)
from physic_core.types import (
    Bodies,
    ContactProbability,
    DepthMap,
    Hints,
    Intrinsics,
    Keypoints,
    Observations,
    People,
    Pointmap,
)
from physic_core.types.arrays import select_people
from physic_core.types.results import KNOWN_UP_SIGMA_DEG

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.configuration.resolve import ResolvedPipeline
    from physic_core.engine.ground.floor import FloorCandidate, FloorEvidence
    from physic_core.engine.ground.floor_and_scale import Ground
    from physic_core.engine.photo import PhotoContent
    from physic_core.engine.settings import EngineSettings
    from physic_core.engine.state import Estimates
    from physic_core.interfaces import Request
    from physic_core.pipeline.given.photo import PreparedPhoto
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_core.types import BoolArray, FloatArray, PeoplePrompt, UInt8Array
    from physic_core.types.known_sizes import KnownPeople


_POINT_AT_PEOPLE = "if the photo shows one, point at them with --person x,y or --box x0,y0,x1,y1"


@dataclass(frozen=True)
class Step:
    """One step on the way from a photo to its estimates.

    Attributes:
        name: of its stage.
        interface: whose backend it calls; "" for a step of the engine.
        fill: finds values for the attributes of :class:`Findings` that its docstring names.
    """

    name: str
    interface: str
    fill: Callable[[Findings, Step], None]


class Findings:
    """What is known of one photo so far.

    Attributes:
        given: the photo, and what the user knows of it.
        plan: the backends and settings of the run.
        stages: calls the backends and records the run.
        image: (H, W, 3) uint8 RGB, the photo.
        missing: interface -> (N,) bool, people without valid values from its backend.
        hints: for the next backend.
        known: what the user knows of the N people.
        changed: (N, J) keypoints that the user changed, or None.
        contradicted: (N, J) how far mask and detector contradict them, px, or None.
        camera: of scene and people.
        own: metric depth that comes with a scale of its own, without the hole; None without one.
        measured: the depth of the whole photo if it was measured, or None.
        photo: what the photo shows, before bodies are estimated.
        ground: of the people with bodies.
        embodied: (N,) bool, people with finite bodies. Backends that need bodies get only these.
        others: as of :class:`Estimates`.
    """

    people: People
    known: KnownPeople
    keypoints: Keypoints
    changed: BoolArray | None = None
    contradicted: FloatArray | None = None
    hole: BoolArray
    inpainted: UInt8Array
    hints: Hints
    scene: Pointmap
    camera: Intrinsics
    own: DepthMap | None = None
    measured: DepthMap | None = None
    original: Pointmap
    observations: Observations
    photo: PhotoContent
    evidence: FloorEvidence
    floors: tuple[FloorCandidate, ...]
    bodies: Bodies
    embodied: BoolArray
    contact: ContactProbability
    ground: Ground
    depth: DepthMap

    def __init__(
        self,
        given: PreparedPhoto,
        plan: ResolvedPipeline,
        load_model: Callable[[], BodyModel],
        stages: StageRunner,
    ) -> None:
        self.given = given
        self.plan = plan
        self.stages = stages
        self.image = given.photo.image
        self.missing: dict[str, BoolArray] = {}
        self._load_model = load_model

    @property
    def model(self) -> BodyModel:
        """The body model of the results."""
        return self._load_model()

    def call(self, step: Step, request: Request[Result], *, last: bool = True) -> Result:
        """Call the backend of a step; ``last`` if it is not called again."""
        return self.stages.call_backend(
            step.name, self.plan.backends[step.interface], request, last=last
        )

    def call_optional(
        self, step: Step, request: Request[Result], *, otherwise: str
    ) -> Result | None:
        """Call the backend of a step; None and a warning, what the run does ``otherwise``, if it
        fails.
        """
        return self.stages.call_optional_backend(
            step.name, self.plan.backends[step.interface], request, otherwise=otherwise
        )

    def wants(self, step: Step) -> bool:
        """Return whether there are people, and a backend for a step on them."""
        return step.interface in self.plan.backends and len(self.people) > 0

    def select(self, people: People, real: BoolArray, reason: str) -> People:
        """Return some (N,) bool of the people, with a note why each other one is left out."""
        for i in np.flatnonzero(~real):
            x0, y0, x1, y1 = people.boxes[i].round().astype(int).tolist()
            self.stages.note(f"left out the person in the box {x0},{y0},{x1},{y1} px: {reason}")
        self.missing.update({name: missing[real] for name, missing in self.missing.items()})
        return select_people(people, real)

    def estimates(self) -> Estimates:
        """Return what all steps have found."""
        from physic_core.engine.state import Estimates

        keypoints = self.given.keypoints
        ground = self.ground.expanded(self.embodied)
        if self.own is not None:  # the metres of a depth that did not vote stay
            ground = replace(ground, by_people=ground.by_people and ground.depth is not None)
        if self.depth.scale_sigma is not None or self.own is not None:
            ground = replace(ground, guess="")
        return Estimates(
            image=self.image,
            camera_given=self.given.photo.intrinsics is not None,
            photo=self.photo,
            inpainted=self.inpainted,
            ground=ground,
            bodies=self.bodies,
            contact=self.contact,
            depth=self.depth,
            depth_by=self.plan.backends["metric_depth"].title,
            missing_results=tuple(
                tuple(name for name, who in self.missing.items() if who[i])
                for i in range(len(self.people))
            ),
            known=self.given.known,
            given_keypoints=self.changed,
            contradicted_px=self.contradicted,
            file_px=1.0 if keypoints is None else keypoints.file_px,
        )


def _people(found: Findings, step: Step) -> None:
    """Fill people and known."""
    prompt = found.given.people
    ignored = None
    if prompt is not None and prompt.ignored:
        ignored = prompt
        prompt = None
    people = _segmented(found, step, prompt, required=found.plan.photo.require_people)
    if ignored is not None:
        people = _without(found, people, ignored)
    real = real_people(people, prompt)
    found.people = found.select(
        people, real, "its joints lie on another person, who seems the same"
    )
    sizes = found.given.known
    if prompt is None:
        found.known = known_people(sizes, found.people)
        found.stages.note(*who_got_which(sizes, found.known, found.people))
        return
    found.known = select_people(known_people(sizes, people, chosen=True), real)
    if not real.all():
        # The others have their pixels back only in a segmentation without the false persons.
        found.people = _segmented(found, step, prompt.select(real), required=True)


def _segmented(
    found: Findings, step: Step, prompt: PeoplePrompt | None, *, required: bool
) -> People:
    """Segment the people in the photo, or those whom the user chose."""
    segmenter = found.plan.backends[step.interface]
    takes_prompt = getattr(segmenter.backend, "takes_prompt", False)
    request = SegmenterRequest(found.image, prompt=prompt if takes_prompt else None)
    people = found.call(step, request)
    found.stages.note(*people.notes)
    if prompt is not None and not takes_prompt:
        people = select_chosen(people, prompt)
    if people.keypoints is not None:
        own, found.missing[step.interface] = discard_invalid_keypoints(people.keypoints)
        people = replace(people, keypoints=own)
    if not len(people):
        cure = (
            _POINT_AT_PEOPLE
            if takes_prompt
            else "if the photo shows a person, use another segmenter"
        )
        if required:
            raise _nobody(found.image, segmenter.title, cure)
        found.stages.note(
            f"no person was found: the result is only the scene, and its scale is not "
            f"confirmed; {cure}"
        )
    return people


def _without(found: Findings, people: People, ignored: PeoplePrompt) -> People:
    """Return the people whom the user does not ignore; others' pixels show no scene."""
    out = ignored_people(people, ignored)
    masks: BoolArray = np.logical_or.reduce(people.masks[out])
    if people.unposed_mask is not None:
        masks |= people.unposed_mask
    return replace(found.select(people, ~out, "it is ignored"), unposed_mask=masks)


def _keypoints(found: Findings, step: Step) -> None:
    """Fill keypoints, changed and contradicted."""
    detected = Keypoints(np.zeros((0, 17, 2), np.float32), np.zeros((0, 17), np.float32), "coco17")
    if found.wants(step):
        detected, found.missing[step.interface] = discard_invalid_keypoints(
            found.call(step, KeypointDetectorRequest(found.image, found.people))
        )
    found.keypoints = detected
    if found.given.keypoints is not None:
        from physic_core.pipeline.given.keypoints import contradicted_keypoints, corrected_keypoints

        keypoints, changed, notes = corrected_keypoints(
            detected, found.given.keypoints, found.people
        )
        found.contradicted = contradicted_keypoints(detected, keypoints, changed, found.people)
        found.keypoints = keypoints
        found.changed = changed
        found.stages.note(*notes)


def _inpainted(found: Findings, step: Step) -> None:
    """Fill hole and inpainted."""
    people = found.people
    hole = np.logical_or.reduce(people.masks)
    if people.unposed_mask is not None:
        hole |= people.unposed_mask
    longest = max(found.image.shape[:2])
    found.hole = hole = dilate(hole, max(4.0, found.plan.photo.mask_growth * longest))
    found.inpainted = (
        found.call(step, InpainterRequest(found.image, hole)) if hole.any() else found.image
    )


def _scene(found: Findings, step: Step) -> None:
    """Fill scene, of the inpainted photo, and camera."""
    from physic_core.engine.up import with_up_of_file

    camera = found.given.photo.intrinsics
    hints = Hints(camera, found.people, found.keypoints, found.hole, photo=found.image)
    scene = _pointmap(found, step, found.inpainted, hints)
    found.scene, doubt = with_up_of_file(scene, found.given.photo.up)
    found.stages.warn(*filter(None, (doubt,)))
    found.camera = camera or found.scene.intrinsics or _camera_of(found.scene)
    found.hints = replace(hints, intrinsics=found.camera, hole=None, photo=None)


def _pointmap(found: Findings, step: Step, image: UInt8Array, hints: Hints) -> Pointmap:
    """Estimate a relative point map of the inpainted or the original photo."""
    last = image is found.image
    pointmap = found.call(step, RelativePointmapRequest(image, hints), last=last)
    found.stages.note(*pointmap.notes)
    found.stages.warn(*pointmap.warnings)
    return pointmap


def _depth_of_photo(found: Findings, step: Step) -> None:
    """Fill own by a backend that sees the photo; with a measured depth also measured, and its shape
    into the scene.
    """
    if found.plan.backends[step.interface].backend.sees == "photo":
        from physic_core.engine.sizes.evidence import is_measured
        from physic_core.pipeline.given.depth import scene_of_depth, without_hole

        whole = found.call(step, MetricDepthRequest(found.image))
        found.own = without_hole(whole, found.hole)
        if found.own is not None and is_measured(found.own):
            found.measured = whole
            found.scene, note = scene_of_depth(found.scene, found.own, found.hole, found.camera)
            found.stages.note(note)


def _original(found: Findings, step: Step) -> None:
    """Fill original, of the photo, whose shape is the people's; the scene gets a usual unit."""
    found.hints = replace(found.hints, scene=found.scene)
    found.original = found.scene
    if found.hole.any():
        found.original = _pointmap(found, step, found.image, found.hints)
    if found.own is not None and found.measured is not None:
        from physic_core.engine.scene.measured_shape import in_usual_unit
        from physic_core.pipeline.given.depth import photo_of_depth

        if found.hole.any():
            found.original = photo_of_depth(
                found.original,
                found.scene,
                found.measured,
                found.own,
                found.people.masks,
                found.camera,
            )
        found.scene = in_usual_unit(found.scene)


def _observations(found: Findings, step: Step) -> None:
    """Fill observations; unknown without a backend, and if it fails."""
    from physic_core.engine.ground.posture import weigh_posture

    unknown = Observations.unknown(len(found.people))
    request = PersonObserverRequest(found.image, found.people, found.keypoints)
    otherwise = "what people do is told by their joints alone"
    seen = found.call_optional(step, request, otherwise=otherwise) if found.wants(step) else None
    found.observations = unknown if seen is None else weigh_posture(seen, found.keypoints)


def _floors(found: Findings, _: Step) -> None:
    """Fill photo, evidence and floors."""
    from physic_core.engine.ground.floor import best_index, chosen_floor
    from physic_core.engine.ground.floor_and_scale import floor_evidence, scene_floor_candidates
    from physic_core.engine.photo import PhotoContent
    from physic_core.engine.up import surest_up
    from physic_core.geometry.tensors import tensor

    engine = found.plan.engine
    hole = tensor(found.hole)
    scene = found.scene
    found.photo = photo = PhotoContent(
        people=found.people,
        keypoints=found.keypoints,
        observations=found.observations,
        known=found.known,
        camera=found.camera,
        hole=hole,
        scene_map=scene,
        photo_map=found.original,
        aligned_map=_aligned(found.original, scene, hole, engine) if found.hole.any() else scene,
    )
    found.evidence = floor_evidence(photo)
    searched = engine.scene.floor != "off"
    found.floors = scene_floor_candidates(photo.scene, found.evidence, searched=searched)
    floor = chosen_floor(found.floors, best_index(found.floors), found.evidence).plane
    up = surest_up(floor, found.evidence.up, photo.slope)
    found.hints = replace(
        found.hints,
        floor=None if floor is None else floor.to_plane(),
        original=photo.aligned_map,
        observations=found.observations,
        up=up.direction.numpy() if floor is not None or up.sigma < KNOWN_UP_SIGMA_DEG else None,
    )


def _bodies(found: Findings, step: Step) -> None:
    """Fill bodies, of the configured body model and with the hands of the estimator, and embodied;
    bodies of people without finite results are NaN.
    """
    if not found.wants(step):
        found.embodied = np.zeros(0, bool)
        found.bodies = _no_bodies(found.model)
        return
    request = BodyEstimatorRequest(
        found.image, found.people, found.camera, found.keypoints, found.hints
    )
    bodies, missing = discard_invalid_bodies(found.call(step, request))
    if bodies.body_model != found.model.name:
        who = found.plan.backends[step.interface].title
        bodies = convert_to_configured(bodies, found.model, who, found.stages)
        missing |= ~valid_body_rows(bodies)
    found.missing[step.interface] = missing
    found.bodies = bodies
    found.embodied = ~missing


def _hands(found: Findings, step: Step) -> None:
    """Give the bodies estimated finger rotations, known statures and children's sizes."""
    from physic_core.engine.sizes.stature import bodies_of_stature, resize_children

    bodies = found.bodies
    if found.wants(step):
        request = HandEstimatorRequest(found.image, found.people, found.keypoints)
        otherwise = "fingers keep the pose from the body_estimator"
        hands = found.call_optional(step, request, otherwise=otherwise)
        found.missing[step.interface] = np.ones(len(found.people), bool)
        if hands is not None:
            hands, found.missing[step.interface] = discard_invalid_hands(hands)
            bodies = replace_hands(bodies, hands, found.model)
    if found.known.stature is not None:
        bodies = bodies_of_stature(bodies, found.model, found.known.stature)
    found.bodies, notes = resize_children(
        bodies, found.model, found.known, found.observations.child
    )
    found.stages.note(*notes)


def _contact(found: Findings, step: Step) -> None:
    """Fill contact, of all N people; 0 without a backend or a body."""
    model = found.model
    embodied = found.embodied
    people = select_people(found.people, embodied)
    bodies = bodies_for_backends(select_people(found.bodies, embodied), model)
    found.hints = replace(
        found.hints,
        people=people,
        keypoints=select_people(found.keypoints, embodied),
        observations=select_people(found.observations, embodied),
        hole=found.hole,
        bodies=bodies,
    )
    shape = len(embodied), model.num_vertices
    found.contact = ContactProbability(np.zeros(shape, np.float32), model.topology)
    if not found.wants(step):
        return
    prior = found.plan.backends[step.interface].title
    request = ContactPriorRequest(
        found.image, people, bodies, topology=model.topology, vertices=model.num_vertices
    )
    otherwise = "contact is computed from distances only"
    contact = found.call_optional(step, request, otherwise=otherwise)
    if contact is not None and contact.topology != model.topology:
        contact = transfer_contact(contact, model, prior, found.stages)
    if contact is None:
        found.missing[step.interface] = np.ones(len(embodied), bool)
        return
    if doubt := doubt_of_contact(contact, bodies):
        found.stages.warn(f"{prior}: {doubt}")
    found.contact, found.missing[step.interface] = expand_contact(contact, embodied)


def _depth_of_own_scale(found: Findings, step: Step) -> None:
    """Fill own by a backend that does not scale its depth by the hints, unless it needs people and
    gets none.
    """
    reads = found.plan.backends[step.interface].backend.reads or ()
    if found.own is None and "scale" not in reads:
        with suppress(NoPersonError):
            found.own = found.call(step, MetricDepthRequest(found.inpainted, found.hints))


def _floor_and_scale(found: Findings, _: Step) -> None:
    """Fill ground."""
    from physic_core.engine.ground.floor_and_scale import asked_up, find_ground
    from physic_core.engine.up import slope_warnings

    photo = select_people(found.photo, found.embodied)
    bodies = select_people(found.bodies, found.embodied)
    evidence = found.evidence
    witness = found.own if found.plan.engine.scene.rescales_depth else None
    found.ground = find_ground(photo, bodies, found.model, found.floors, evidence, witness)
    plane = found.ground.search.plane
    found.stages.warn(
        *asked_up(found.photo)[1], *slope_warnings(plane, evidence.up, evidence.slope)
    )


def _depth_of_scale(found: Findings, step: Step) -> None:
    """Fill depth, of the inpainted photo: own, or at the scale that was found.

    If the backend needs people and gets none, it is the depth of the scene.
    """
    from physic_core.engine.sizes.scale_vote import scaled_depth

    scale = found.ground.scale
    depth = found.ground.depth or found.own
    reads = found.plan.backends[step.interface].backend.reads or ()
    if depth is None and "scale" in reads:
        hints = replace(found.hints, floor=found.ground.plane, scale=scale)
        with suppress(NoPersonError):
            depth = found.call(step, MetricDepthRequest(found.inpainted, hints))
    if depth is None:
        assert found.hints.scene is not None
        depth = scaled_depth(found.hints.scene, scale, found.camera)
    found.depth = depth
    found.stages.note(*depth.notes)


def _nobody(image: UInt8Array, segmenter: str, cure: str) -> NoPersonError:
    height, width = image.shape[:2]
    return NoPersonError(
        f"no person was found in the photo of {width} x {height} px by {segmenter}: {cure}; "
        f"without require_people, "
        "the result is the scene alone"
    )


def _no_bodies(model: BodyModel) -> Bodies:
    """Return zero bodies of a body model."""
    from physic_core.body.bones import parameters_from_rotations

    rotations, betas, transl = model.zero_pose(0)
    expression = betas.new_zeros(0, model.num_expression)
    return Bodies(parameters_from_rotations(rotations, betas, expression, transl), model.name)


def _camera_of(pointmap: Pointmap) -> Intrinsics:
    from physic_core.engine.photo import PixelPoints
    from physic_core.geometry.pointmap import intrinsics_from_pointmap

    height, width = pointmap.valid.shape
    found = PixelPoints.of(pointmap)
    fx, fy, cx, cy = intrinsics_from_pointmap(found.points, found.valid)
    return Intrinsics(fx, fy, cx, cy, width, height, "point map")


def _aligned(
    original: Pointmap, scene: Pointmap, hole: Tensor, settings: EngineSettings
) -> Pointmap:
    """Return the point map of a photo with its people, aligned to the scene outside the hole."""
    from physic_core.engine.photo import PixelPoints
    from physic_core.engine.placement.solve import align_photo_points_to_scene
    from physic_core.geometry.alignment import apply_alignment

    photo, behind = map(PixelPoints.of, (original, scene))
    alignment = align_photo_points_to_scene(
        photo, hole, behind.points, behind.valid, settings.placement
    )
    aligned = apply_alignment(photo.points, alignment).numpy()
    return replace(original, points=aligned, unknown=scene.unknown)


STEPS = (
    Step("people", "segmenter", _people),
    Step("keypoints", "keypoint_detector", _keypoints),
    Step("inpainting", "inpainter", _inpainted),
    Step("scene point map", "relative_pointmap", _scene),
    Step("metric depth", "metric_depth", _depth_of_photo),
    Step("photo point map", "relative_pointmap", _original),
    Step("observations", "person_observer", _observations),
    Step("floor candidates", "", _floors),
    Step("bodies", "body_estimator", _bodies),
    Step("hands", "hand_estimator", _hands),
    Step("contact prior", "contact_prior", _contact),
    Step("metric depth", "metric_depth", _depth_of_own_scale),
    Step("floor and scale", "", _floor_and_scale),
    Step("metric depth", "metric_depth", _depth_of_scale),
)
"""The steps in the order in which they run; of those with one name, one calls the backend."""


def stages_before_the_engine(interfaces: Iterable[str]) -> int:
    """Return the number of stages of the steps, with backends for these interfaces."""
    return len({step.name for step in STEPS if step.interface in ("", *interfaces)})


def run_backends(
    given: PreparedPhoto,
    plan: ResolvedPipeline,
    load_model: Callable[[], BodyModel],
    stages: StageRunner,
) -> Estimates:
    """Run all backends on a photo.

    Args:
        given: the photo, and what the user knows of it.
        plan: the backends and settings of the run.
        load_model: returns the body model that all bodies are converted to; not called before the
            bodies are estimated.
        stages: calls the backends and records the run.

    Raises:
        ConfigError: a measured depth is a disparity.
        InputError: the number of known statures differs from that of the people, or given keypoints
            are of no person or joint.
        NoPersonError: a prompt selects no person, or people are required and the segmenter found
            none.
        BackendError: a required backend failed.
        BackendOutputError: a required backend returned an invalid result.
    """
    found = Findings(given, plan, load_model, stages)
    for step in STEPS:
        with nullcontext() if step.interface else stages.time_engine(step.name):
            step.fill(found, step)
    return found.estimates()
