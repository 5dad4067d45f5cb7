"""The live view: a viser server with several results, switches, and clicks that measure and select."""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from physic_viewer.drawing import PARTS, SKINS
from physic_viewer.own_page import local_address, start_server
from physic_viewer.report.people import people_records
from physic_viewer.slot import Slot
from physic_viewer.text import legend_html, person_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_viewer.drawing import DrawnResult
    from physic_viewer.sources import ResultSource

    Array = NDArray[np.float64]

_SIDE_BY_SIDE, _ONE_PLACE = "side by side", "in one place"
_GAP_M = 0.6
_TURN, _RISE = np.deg2rad(35.0), np.deg2rad(20.0)  # of the first view, from that of the photo
_FIELD_OF_VIEW = np.deg2rad(45.0)  # of its height
_ASPECT = 1.2  # width by height of a window, whose panel covers a part
_ADVICE = "Click on a person for their numbers."


class Viewer:
    """A running server; call :meth:`refresh` to look for new results, and :meth:`stop` at the end.

    Args:
        sources: folders that were named, one slot each.
        host: address to listen on.
        port: to listen on; the next free one if it is taken.
        names: further names under which browsers reach the server.

    Raises:
        BackendError: the server would answer pages of other sites.
    """

    def __init__(
        self, sources: Sequence[ResultSource], host: str = "127.0.0.1", port: int = 8080, names: Sequence[str] = ()
    ) -> None:
        self.server = start_server(host, port, frozenset(name.lower() for name in ("localhost", host, *names)))
        self._lock = threading.RLock()
        self._marks: list[Array] = []
        self.server.scene.set_up_direction("+y")
        gui = self.server.gui
        gui.configure_theme(show_share_button=False, show_logo=False)
        gui.main_panel.dock_right()
        with gui.add_folder("Show"):
            self.switches = {name: gui.add_checkbox(name.capitalize(), shown) for name, shown in PARTS.items()}
            self.skin = gui.add_dropdown("Colours", SKINS)
        self.legend = gui.add_html("")
        self.arrange = gui.add_dropdown("Arrange", [_SIDE_BY_SIDE, _ONE_PLACE], visible=len(sources) > 1)
        self.measuring = gui.add_checkbox("Measure", False)
        self.text = gui.add_markdown(_ADVICE)
        self.slots = [Slot(self.server, source, f"/{index}", self._place) for index, source in enumerate(sources)]
        for switch in self.switches.values():
            switch.on_update(lambda _: self._show())
        self.skin.on_update(lambda _: self._show())
        self.arrange.on_update(lambda _: self._place())
        self.measuring.on_update(lambda _: self._start_measuring())
        self.server.scene.on_click()(lambda event: self.click(event.ray_origin, event.ray_direction))
        self.refresh()
        self._look()

    @property
    def address(self) -> str:
        """Address of the page."""
        host = local_address(self.server)
        return f"http://{f'[{host}]' if ':' in host else host}:{self.server.get_port()}"

    def refresh(self) -> None:
        """Look for new and changed results."""
        with self._lock:
            for slot in self.slots:
                slot.refresh()

    def stop(self) -> None:
        """Stop the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    def click(self, origin: Sequence[float], direction: Sequence[float]) -> None:
        """Handle a click, as a ray: select a person, or mark a point."""
        with self._lock:
            hits = []
            for slot in self.slots:
                if slot.drawn is not None and slot.is_shown:
                    found = slot.drawn.hit(np.array(origin, np.float64), np.array(direction, np.float64))
                    if found is not None:
                        hits.append((float(np.linalg.norm(found[0] - np.array(origin))), slot.drawn, *found))
            if not hits:
                return
            _, drawn, point, person = min(hits, key=lambda hit: hit[0])
            if self.measuring.value:
                self._mark(point)
            elif person is not None:
                self.text.content = _numbers(drawn, person)

    def _start_measuring(self) -> None:
        with self._lock:
            self._clear_marks()
            self.text.content = "Click on two points." if self.measuring.value else _ADVICE

    def _clear_marks(self) -> None:
        self._marks.clear()
        self.server.scene.remove_by_name("/measure")

    def _mark(self, point: Array) -> None:
        if len(self._marks) == 2:
            self._clear_marks()
        self._marks.append(point)
        scene, number = self.server.scene, len(self._marks)
        scene.add_icosphere(f"/measure/{number}", radius=0.02, color=(255, 47, 125), position=tuple(point))
        self.text.content = "Click on the second point."
        if number == 2:
            first, second = self._marks
            apart, upwards = float(np.linalg.norm(first - second)), abs(float(first[1] - second[1]))
            lines = np.stack([first, second])[None].astype(np.float32)
            scene.add_line_segments("/measure/line", lines, (255, 47, 125), thickness=3, thickness_units="screen")
            scene.add_label("/measure/length", f"{apart:.2f} m", position=tuple((first + second) / 2))
            self.text.content = f"**{apart:.2f} m** apart, of which {upwards:.2f} m upwards."

    def _show(self) -> None:
        on = {name: bool(switch.value) for name, switch in self.switches.items()}
        for slot in self.slots:
            if slot.drawn is not None:
                slot.drawn.wear(self.skin.value)
                for name, shown in on.items():
                    slot.drawn.show(name, shown)
        shown_results = [slot.drawn.result for slot in self.slots if slot.drawn is not None and slot.is_shown]
        self.legend.content = legend_html(self.skin.value, shown_results) if on["people"] else ""

    def _place(self) -> None:
        """Put the results side by side from left to right, or all in one place."""
        with self._lock:
            self._clear_marks()
            right = 0.0
            for slot in self.slots:
                if slot.drawn is None or not slot.is_shown:
                    continue
                shapes, offset = slot.drawn.shapes, np.zeros(3)
                if self.arrange.value == _SIDE_BY_SIDE:
                    offset[0] = right - shapes.low[0]
                    right += float(shapes.high[0] - shapes.low[0]) + _GAP_M
                slot.drawn.move(offset)
            self._show()

    def _look(self) -> None:
        """Choose the first view: people and scene from the side of the photo's camera, and from above."""
        drawn = [slot.drawn for slot in self.slots if slot.drawn is not None]
        if not drawn:
            return
        points = np.concatenate([one.shapes.corners() + one.offset for one in drawn])
        camera = self.server.initial_camera
        camera.fov = _FIELD_OF_VIEW
        direction = np.array([np.sin(_TURN) * np.cos(_RISE), np.sin(_RISE), np.cos(_TURN) * np.cos(_RISE)])
        across = np.cross([0.0, 1.0, 0.0], direction) / np.cos(_RISE)
        center, tall = (points.min(0) + points.max(0)) / 2, np.tan(camera.fov / 2)
        sizes = np.abs((points - center) @ np.stack([across, np.cross(direction, across)], 1)) / [_ASPECT * tall, tall]
        distance = float((sizes.max(1) + (points - center) @ direction).max())
        camera.position, camera.look_at = tuple(center + distance * direction), tuple(center)


def _numbers(drawn: DrawnResult, person: int) -> str:
    return person_text(person, people_records(drawn.result)[person], drawn.result)
