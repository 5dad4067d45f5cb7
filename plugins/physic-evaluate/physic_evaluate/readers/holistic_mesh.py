"""Results of HolisticMesh: SMPLify-X files per picture, and meshes of the scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from physic_evaluate.contract import Prediction
from physic_evaluate.meshes import read_mesh
from physic_evaluate.readers.base import ResultReader, first_file
from physic_evaluate.readers.smplifyx_files import person_of_files

if TYPE_CHECKING:
    from physic_evaluate.contract import Frame

__all__ = ["READER", "HolisticMesh"]

MESHES = ("meshes/{name}/000.ply", "meshes/{name}/000.obj", "{sequence}/meshes/{name}/000.ply", "{name}/human.obj")
PARAMETERS = ("results/{name}/000.pkl", "{sequence}/results/{name}/000.pkl")
SCENES = ("scenes/{name}.ply", "scenes/{name}.obj", "{name}/scene.obj", "{name}/scene.ply")


class HolisticMesh(ResultReader):
    """Reads mesh and parameters of the one person, and a mesh of the scene if there is one."""

    name: ClassVar[str] = "holistic-mesh"
    summary: ClassVar[str] = "HolisticMesh, and other fits in the layout of SMPLify-X and PROX"
    layout: ClassVar[str] = "meshes/FRAME/000.ply|obj, results/FRAME/000.pkl, scenes/FRAME.ply; also below SEQUENCE/"

    def locate(self, frame: Frame) -> Path | None:
        """Return the mesh, or else the parameters of the frame."""
        return first_file(self.folder, frame, *MESHES, *PARAMETERS)

    def read(self, path: Path, frame: Frame) -> Prediction:
        """Read the person and the scene."""
        mesh, parameters = (first_file(self.folder, frame, *patterns) for patterns in (MESHES, PARAMETERS))
        scene = first_file(self.folder, frame, *SCENES)
        person = person_of_files(mesh, parameters, self.bodies)
        return Prediction((person,), scene_points=None if scene is None else read_mesh(scene).vertices)


READER = HolisticMesh
