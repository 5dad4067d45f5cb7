"""Bodies: parameters of the people and their camera, as the npz that ``physic run --bodies``
reads.
"""

from __future__ import annotations

import io

import numpy as np

from physic_core import ExportedFiles, ExportRequest, write_bodies
from physic_core.types import BodyParameters


def export_bodies(request: ExportRequest) -> ExportedFiles:
    """Return one file with all people: SMPL-X names, metres, in the frame of the camera."""
    people = [vars(person.parameters) for _, person in request.chosen()]
    stacked = {name: np.concatenate([one[name] for one in people]) for name in people[0]}
    stream = io.BytesIO()
    result = request.result
    write_bodies(stream, BodyParameters(**stacked), result.body_model, result.intrinsics)
    return ExportedFiles({f"{request.stem}{request.suffix}": stream.getvalue()})
