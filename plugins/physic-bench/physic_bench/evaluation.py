"""The methods of an evaluation, and everything that was measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from physic_bench.frame_of_results import into_camera
from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from physic_bench.contract import Frame, Prediction
    from physic_bench.frame_of_results import FrameCheck
    from physic_bench.readers.base import ResultReader

    Record = dict[str, Any]


@dataclass(frozen=True)
class Method:
    """A method whose results are scored; it can be pickled.

    Attributes:
        name: in the tables.
        reader: of its results.
        frame: frame of reference of its files, see :data:`physic_bench.frame_of_results.ALTERNATIVES`.
        failures: frame id -> why there is no result.
    """

    name: str
    reader: ResultReader
    frame: str = "camera"
    failures: Mapping[str, str] = field(default_factory=dict)

    def result(self, frame: Frame) -> Prediction | None:
        """Return the result of a frame, in the camera frame; None if there is none."""
        found = self.reader.result(frame)
        return None if found is None else into_camera(found, frame, self.frame)

    def result_or_none(self, frame: Frame) -> Prediction | None:
        """Return the result of a frame; None too if it cannot be read, which its record has the reason of."""
        try:
            return self.result(frame)
        except PhysicError:
            return None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Everything that was measured.

    Attributes:
        methods: in order.
        frames: that were scored.
        checks: method -> in which frame of reference its results are.
        records: one per annotated person and method.
        notes: sentences that the figures depend on.
        left_out: frame id -> why it is not scored.
    """

    methods: tuple[Method, ...]
    frames: tuple[Frame, ...]
    checks: Mapping[str, FrameCheck]
    records: tuple[Record, ...]
    notes: tuple[str, ...]
    left_out: Mapping[str, str]
