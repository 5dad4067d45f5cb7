"""Stand-ins for published networks: graphs of the same contract, and networks that know which world
a photo shows.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from physic_core.types import Intrinsics
from physic_onnx.sessions import Port
from physic_testing import check_backend
from physic_testing.worlds import World, world_of

_ELEMENTS = {
    "float32": TensorProto.FLOAT,
    "float16": TensorProto.FLOAT16,
    "float64": TensorProto.DOUBLE,
    "int64": TensorProto.INT64,
    "int32": TensorProto.INT32,
    "uint8": TensorProto.UINT8,
    "bool": TensorProto.BOOL,
}

Ports = Mapping[str, tuple[str, Sequence[int | str] | None]]
"""Name -> type and shape, in the file's order: ``{"image": ("float32", ("batch", 3, "height",
"width"))}``.
"""


def write_graph(
    path,
    inputs,
    outputs,
    nodes,
    constants=None,
    opset=14,
):
    """An ONNX file with these ports whose body is ``nodes`` of ``onnx.helper.make_node``, over
    named ``constants``.
    """

    def value_info(ports):
        return [
            helper.make_tensor_value_info(
                name, _ELEMENTS[dtype], None if shape is None else list(shape)
            )
            for name, (dtype, shape) in ports.items()
        ]

    held = [
        numpy_helper.from_array(np.asarray(value), name)
        for name, value in (constants or {}).items()
    ]
    graph = helper.make_graph(
        list(nodes), "contract", value_info(inputs), value_info(outputs), held
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(model.SerializeToString())
    return path


@pytest.fixture(scope="session")
def graph():
    """:func:`write_graph`."""
    return write_graph


@pytest.fixture(scope="session")
def constant_graph():
    """``constant_graph(path, inputs, name=array, ...)``: an ONNX file that answers these arrays,
    whatever it is fed.
    """

    def write(path, inputs, **outputs):
        held = {f"held_{name}": np.asarray(value, np.float32) for name, value in outputs.items()}
        ports = {name: ("float32", np.shape(value)) for name, value in outputs.items()}
        nodes = [helper.make_node("Identity", [f"held_{name}"], [name]) for name in outputs]
        return write_graph(path, inputs, ports, nodes, held)

    return write


@pytest.fixture(scope="session")
def node():
    """``onnx.helper.make_node(kind, inputs, outputs, **attributes)``."""
    return helper.make_node


@dataclass(frozen=True)
class Shown:
    """What a stand-in knows of the photo that its adapter was given.

    Attributes:
        photo: (H, W, 3) uint8, whole.
        world: the truth; None for a photo that is of no world, or was resampled.
        people: whether the people are in it.
    """

    photo: np.ndarray
    world: World | None
    people: bool

    @property
    def depth(self) -> np.ndarray:
        """(H, W) float64 metres along z, inf in the sky; of a photo of no world a floor before a
        wall.
        """
        if self.world is not None:
            return np.asarray(
                self.world.depth if self.people else self.world.empty_depth, np.float64
            )
        height, width = self.photo.shape[:2]
        down = (np.arange(height) - (height - 1) / 2) / self.camera.fy
        wall_and_floor = np.minimum(6.0, 1.5 / np.maximum(down, 1e-6))
        return np.repeat(wall_and_floor[:, None], width, axis=1)

    @property
    def camera(self) -> Intrinsics:
        """Of the photo; a focal length of the long side where there is no world."""
        if self.world is not None:
            return self.world.intrinsics
        height, width = self.photo.shape[:2]
        return Intrinsics.from_focal(float(max(height, width)), width, height)

    @property
    def points(self) -> np.ndarray:
        """(H, W, 3) float64 metres; inf in the sky."""
        height, width = self.photo.shape[:2]
        v, u = np.mgrid[:height, :width]
        camera = self.camera
        rays = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones((height, width))], -1
        )
        with np.errstate(invalid="ignore"):
            return np.where(
                np.isfinite(self.depth)[..., None], rays * self.depth[..., None], np.inf
            )


def look_at(photo):
    """Find the world that a photo shows, by its label."""
    photo = np.ascontiguousarray(photo)
    world = world_of(photo)
    if world is None:
        return Shown(photo, None, False)
    off = [
        np.abs(photo.astype(int) - picture).mean() for picture in (world.image, world.empty_image)
    ]
    return Shown(photo, world, bool(off[0] < off[1]))


@pytest.fixture(scope="session")
def shown():
    """:func:`look_at`."""
    return look_at


class StandInNetwork:
    """Stands for :class:`physic_onnx.sessions.Network`, and answers what a perfect network would.

    Args:
        inputs: ports, as for :func:`write_graph`.
        outputs: ports.
        answer: given what is shown and what is fed, returns output -> array.

    Attributes:
        runs: how often it was run.
        fed: what it was fed last.
    """

    name = "stand_in.onnx"
    provider = "CPU"
    metadata: Mapping[str, str] = {}
    shares_ranges = False

    def __init__(
        self,
        inputs: Ports,
        outputs: Ports,
        answer: Callable[[Shown, Mapping[str, np.ndarray]], Mapping[str, np.ndarray]],
    ) -> None:
        self.inputs = {
            name: Port(name, dtype, tuple(shape or ())) for name, (dtype, shape) in inputs.items()
        }
        self.outputs = {
            name: Port(name, dtype, tuple(shape or ())) for name, (dtype, shape) in outputs.items()
        }
        self._answer = answer
        self._shown: Shown | None = None
        self.runs = 0
        self.fed: Mapping[str, np.ndarray] = {}

    def show(self, what: Shown) -> None:
        self._shown = what

    def run(self, feed: Mapping[str, np.ndarray], outputs: Sequence[str]) -> list[np.ndarray]:
        assert self._shown is not None, "nothing is shown"
        assert set(feed) == set(self.inputs), f"fed {sorted(feed)}, wants {sorted(self.inputs)}"
        for name, value in feed.items():
            port = self.inputs[name]
            assert np.ndim(value) == len(port.shape), (
                f"{name} has {np.ndim(value)} dimensions, wants {port.shape}"
            )
        self.runs += 1
        self.fed = dict(feed)
        answers = self._answer(self._shown, feed)
        return [np.asarray(answers[name], self.outputs[name].dtype) for name in outputs]


@pytest.fixture(scope="session")
def stand_in_network():
    return StandInNetwork


@pytest.fixture(scope="session")
def stand_in():
    """``stand_in(Adapter, attach)``: the adapter with stand-ins of its networks, so that no files
    are needed.

    ``attach(backend)`` returns what the adapter's ``build`` would, and the networks; before each
    ``infer`` they are given the photo. A network can read the other arguments of that call in
    ``backend.estimates``, and the
    boxes of its rows by ``backend.next_boxes``. For the conformance kit::

        check_backend(stand_in(Adapter, attach)).raise_if_failed()
    """

    def make(kind, attach):
        class StandIn(kind):
            capabilities = frozenset(getattr(kind, "capabilities", ())) | {"exact"}
            _stand_ins: Sequence[StandInNetwork] = ()

            def build(self, device: str) -> Any:
                network, *self._stand_ins = attach(self)
                return network

            def close(self) -> None:
                super().close()
                self._stand_ins = ()

            def missing(self) -> tuple[str, ...]:
                return ()

            def fingerprint(self) -> str:
                return ""

            def infer(self, image: np.ndarray, *estimates: Any) -> Any:
                self.estimates = estimates
                self._row = 0
                if isinstance(image, np.ndarray) and image.ndim == 3:
                    for network in self._stand_ins:
                        network.show(look_at(image))
                return super().infer(image, *estimates)

            def next_boxes(self, count: int) -> np.ndarray:
                """Boxes (at most ``count``, 4) of the people whose crops a network is given
                next.
                """
                boxes: np.ndarray = self.estimates[0].boxes[self._row : self._row + count]
                self._row += len(boxes)
                return boxes

        StandIn.__name__ = StandIn.__qualname__ = f"StandIn{kind.__name__}"
        return StandIn

    return make


@pytest.fixture(scope="session")
def loaded():
    """``loaded(Adapter, path, **options)``: the adapter with this file."""

    def load(kind, path, **options):
        backend = kind(kind.Options(weights=str(path), **options))
        backend.load()
        return backend

    return load


@pytest.fixture(scope="session")
def bound():
    """``bound(Adapter, inputs, outputs, answer, **options)``: the adapter with a stand-in that
    ignores the photo.
    """

    def bind(kind, inputs, outputs, answer, **options):
        network = StandInNetwork(inputs, outputs, answer)
        network.show(Shown(np.zeros((1, 1, 3), np.uint8), None, False))
        backend = kind(kind.Options(**options))
        backend._network = backend.match(network)
        return backend

    return bind


@pytest.fixture(scope="session")
def accuracy_of(stand_in):
    """``accuracy_of(Adapter, inputs, outputs, answer)``: its errors in the kit, all of whose checks
    have to pass.
    """

    def measure(kind, inputs, outputs, answer):
        def attach(backend):
            network = StandInNetwork(inputs, outputs, answer)
            return [backend.match(network), network]

        report = check_backend(stand_in(kind, attach))
        report.raise_if_failed()
        return report.accuracy

    return measure


@pytest.fixture
def exported(tmp_path):
    """``exported(model, answer, inputs, outputs)``: the path of the ONNX file of ``answer(model,
    *inputs)``.

    ``inputs`` are name -> example and names of its free axes, ``outputs`` name -> names of its free
    axes.
    """
    torch = pytest.importorskip("torch")

    def export(
        model,
        answer,
        inputs,
        outputs,
    ):
        class Graph(torch.nn.Module):
            def __init__(self) -> None:
                super().__init__()
                self.model = model

            def forward(self, *values: Any) -> Any:
                return answer(self.model, *values)

        with torch.no_grad(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            torch.onnx.export(
                Graph().eval(),
                tuple(example for example, _ in inputs.values()),
                str(tmp_path / "model.onnx"),
                input_names=list(inputs),
                output_names=list(outputs),
                dynamic_axes={name: free for name, (_, free) in inputs.items()} | dict(outputs),
                opset_version=17,
                dynamo=False,
            )
        return str(tmp_path / "model.onnx")

    return export
