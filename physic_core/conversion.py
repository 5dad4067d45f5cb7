"""Bodies of one body model as bodies of another, and contact on one mesh as contact on another, by
the installed plugin that converts them (hook ``physic_body_converters``).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.discovery.plugins import absence_message, find_items, import_and_call
from physic_core.errors import BodyModelError, ConfigError, PackageMissingError, PluginError

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_core.body.model import BodyModel
    from physic_core.types import (
        Bodies,
        ContactProbability,
        Float64Array,
        FloatArray,
        Mesh,
        RestMesh,
    )

    VertexTransfer = Callable[[FloatArray], Float64Array]

_ROLE = "converter of bodies"
_DISTRIBUTION = "metricbody-embedded"


@dataclass(frozen=True)
class ConvertedBodies:
    """Bodies after conversion to another model, with the residuals of the fit.

    Attributes:
        bodies: of the new model, without joints and mesh; all NaN for people with too few known
            joints.
        joints_m: (N,) mean distance of the known body joints, metres; it includes the difference of
            joint definitions.
        surface_m: (N,) mean distance of the surfaces, metres, or None without a mesh.
    """

    bodies: Bodies
    joints_m: Float64Array
    surface_m: Float64Array | None

    def note(self, before: str) -> str:
        """Return a note for the user: both body models and the mean residuals."""
        parts = []
        for name, apart in (("surface", self.surface_m), ("joints", self.joints_m)):
            distances = apart[np.isfinite(apart)] if apart is not None else np.zeros(0)
            if len(distances):
                parts.append(f"{name} within {1000 * float(distances.mean()):.0f} mm")
        residuals = f", {' and '.join(parts)} on average" if parts else ""
        return f"bodies converted from '{before}' to '{self.bodies.body_model}'{residuals}"


class BodyConverter(ABC):
    """What the target of a hook ``physic_body_converters`` returns when it is called."""

    @abstractmethod
    def convert(self, bodies: Bodies, model: BodyModel) -> ConvertedBodies:
        """Convert bodies for which :func:`can_convert` holds to another model on the CPU."""

    @abstractmethod
    def vertex_transfer(self, rest: RestMesh, model: BodyModel) -> VertexTransfer:
        """Return what carries values from the vertices of a mesh to those of a body model."""

    @abstractmethod
    def convert_contact(self, contact: ContactProbability, model: BodyModel) -> ContactProbability:
        """Transfer contact with a rest mesh to the vertices of a body model."""


def can_convert(bodies: Bodies, model: BodyModel) -> bool:
    """Return whether bodies have the joints or the mesh that a conversion to ``model`` needs."""
    has_shape = bodies.joints is not None or mesh_to_fit(bodies, model) is not None
    return has_shape or bodies.body_model in (model.name, "embedded")


def convert_bodies(bodies: Bodies, model: BodyModel) -> ConvertedBodies:
    """Convert bodies to another body model, and return the residuals of the fit.

    Args:
        bodies: of N people; NaN for people without an estimate.
        model: a body model on the CPU.

    Raises:
        BodyModelError: the bodies have neither joints nor a mesh with a known correspondence.
        PackageMissingError: no installed plugin converts bodies.
        ConfigError: several plugins do.
        PluginError: the plugin cannot be imported.
    """
    if bodies.body_model == model.name:
        return ConvertedBodies(bodies, np.zeros(len(bodies.parameters)), None)
    if not can_convert(bodies, model):
        raise BodyModelError(
            f"bodies for the body model '{bodies.body_model}' cannot be converted to "
            f"'{model.name}': give the joints of SMPL-X (Bodies.joints), or a mesh with its T-pose "
            "(Bodies.mesh)"
        )
    return _converter().convert(bodies, model)


def convert_contact(contact: ContactProbability, model: BodyModel) -> ContactProbability:
    """Transfer contact probabilities to the vertices of a body model; 0 in its cavities.

    Raises:
        BodyModelError: the rest mesh is missing, or is not a body in a T-pose.

    Further errors are those of :func:`convert_bodies`.
    """
    if contact.topology == model.topology:
        return contact
    if contact.rest is None:
        raise BodyModelError(
            f"contact on the mesh '{contact.topology}' cannot be converted to '{model.topology}': "
            "give the mesh in the T-pose (ContactProbability.rest)"
        )
    return _converter().convert_contact(contact, model)


def vertex_transfer(rest: RestMesh, model: BodyModel) -> VertexTransfer:
    """Return a function that carries values (..., V, C) of the vertices of a body's mesh to those
    of a body model.

    Raises:
        BodyModelError: the mesh is not a body in a T-pose.

    Further errors are those of :func:`convert_bodies`.
    """
    return _converter().vertex_transfer(rest, model)


def mesh_to_fit(bodies: Bodies, model: BodyModel) -> Mesh | None:
    """Return the mesh of bodies if its correspondence to the model's surface can be found."""
    mesh = bodies.mesh
    if mesh is None or (mesh.rest is None and not has_topology(mesh, model)):
        return None
    return mesh


def has_topology(mesh: Mesh, model: BodyModel) -> bool:
    """Return whether a mesh has the model's topology."""
    named = mesh.name in (model.topology, model.name)
    return named and mesh.vertices.shape[1] == model.num_vertices


def _converter() -> BodyConverter:
    plugins = find_items("physic_body_converters")
    if not plugins:
        raise PackageMissingError(
            f"bodies of other models are converted by {absence_message(_DISTRIBUTION)}"
        )
    if len(plugins) > 1:
        names = " and ".join(plugin.distribution for plugin in plugins)
        raise ConfigError(f"bodies of other models are converted by {names}: uninstall one of them")
    converter: Any = import_and_call(plugins[0], _ROLE)
    if not isinstance(converter, BodyConverter):
        raise PluginError(
            f"{plugins[0].title(_ROLE)} should return a BodyConverter, got "
            f"{str(converter)[:60]!r} ({type(converter).__name__})"
        )
    return converter
