"""One of the results that are shown side by side: chosen from a source, read again when it changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from physic_core import load_reconstruction
from physic_core.errors import PhysicError
from physic_viewer.drawing import DrawnResult
from physic_viewer.shapes import build_shapes
from physic_viewer.text import escape, result_text

if TYPE_CHECKING:
    import viser

    from physic_viewer.sources import FoundResult, ResultSource

_WAITING = "waiting for a result"


def _set(control: Any, value: object) -> None:
    """Set the value of a control, which viser's annotations have as read-only."""
    control.value = value


class Slot:
    """A place for one result of a source, with its controls.

    Args:
        server: to draw on.
        source: of the results.
        node: name of the slot's node in the scene.
        changed: called after another result was drawn or chosen.
    """

    def __init__(self, server: viser.ViserServer, source: ResultSource, node: str, changed: Callable[[], None]) -> None:
        self.source, self.drawn, self._server, self._node, self._changed = source, None, server, node, changed
        self._found: list[FoundResult] = []
        self._loaded: FoundResult | None = None
        with server.gui.add_folder(source.title):
            self._shown = server.gui.add_checkbox("Shown", True)
            self._choice = server.gui.add_dropdown("Result", [_WAITING], visible=False)
            self._newest = server.gui.add_checkbox("Newest", True, visible=False, hint="Follow a batch that writes it")
            self._text = server.gui.add_markdown(_WAITING)
        self._shown.on_update(lambda _: self._switch())
        self._choice.on_update(lambda event: self._chosen(by_user=event.client is not None))
        self._newest.on_update(lambda _: self.refresh())

    drawn: DrawnResult | None

    @property
    def message(self) -> str:
        """What the panel says about the result, Markdown."""
        return str(self._text.content)

    @property
    def names(self) -> list[str]:
        """Names of all results of the source."""
        return [found.name for found in self._found]

    def refresh(self) -> None:
        """Search the source again, and draw the chosen result if it is new or was written again."""
        self._found = self.source.find()
        many = len(self._found) > 1 or any(found.folder != self.source.folder for found in self._found)
        self._choice.visible = self._newest.visible = many
        if tuple(self._choice.options) != tuple(self.names or [_WAITING]):
            before = self._choice.value
            self._choice.options = self.names or [_WAITING]
            if before in self.names:
                _set(self._choice, before)
        if self._newest.value and self._found:
            _set(self._choice, max(self._found, key=lambda found: found.written).name)
        self._chosen()

    def choose(self, name: str) -> None:
        """Show a result by its name, and no longer the newest one."""
        _set(self._newest, False)
        _set(self._choice, name)
        self._chosen()

    def _chosen(self, by_user: bool = False) -> None:
        if by_user:
            _set(self._newest, False)
        found = next((found for found in self._found if found.name == self._choice.value), None)
        if found is not None and found != self._loaded:
            self._loaded = found
            self._draw(found)
            self._changed()

    def _draw(self, found: FoundResult) -> None:
        try:
            result = load_reconstruction(found.folder)
            shapes = build_shapes(result)
        except PhysicError as error:
            # A result that is being written is complete at the next look.
            self._text.content = f"**cannot be shown**: {escape(str(error))}"
            if self.drawn is not None:
                self.drawn.remove()
                self.drawn = None
            return
        if self.drawn is not None:
            self.drawn.remove()
        label = found.name if found.name == self.source.title else f"{self.source.title}: {found.name}"
        self.drawn = DrawnResult(self._server, self._node, result, shapes, label)
        self.drawn.set_visible(bool(self._shown.value))
        self._text.content = result_text(result)

    def _switch(self) -> None:
        if self.drawn is not None:
            self.drawn.set_visible(bool(self._shown.value))
        self._changed()

    @property
    def is_shown(self) -> bool:
        """Whether the slot shows a result."""
        return self.drawn is not None and bool(self._shown.value)
