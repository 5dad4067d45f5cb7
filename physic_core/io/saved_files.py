"""Words for the files to write for a photo, such as "full" or "numbers+preview"."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from physic_core.errors import ConfigError

LEVELS = ("full", "exact", "compact", "numbers", "people", "summary")
"""full: JSON, all arrays as computed, preview, all GLB files. exact: JSON, all arrays as computed. compact: JSON,
arrays in their smaller form, preview, ``combined.glb``. numbers: JSON, arrays in their smaller form. people: JSON,
arrays of the people. summary: none."""

EXTRAS = ("preview", "glb", "report")
"""Files that can be added to a level: ``preview.png``, all GLB files, ``report.html``."""


@dataclass(frozen=True)
class Saving:
    """The files to write for a photo; :meth:`parse` parses their word.

    Attributes:
        level: one of LEVELS.
        extras: some of EXTRAS, in this order.
    """

    level: str = "full"
    extras: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str | Saving) -> Saving:
        """Read a level with extras, such as "numbers+preview+report".

        Raises:
            ConfigError: a part is unknown, or the level has no GLB files.
        """
        if isinstance(text, Saving):
            return text
        level, *given = text.split("+")
        if level not in LEVELS:
            raise ConfigError(f"what to save must begin with one of {', '.join(LEVELS)} (got '{text}')")
        if unknown := set(given) - set(EXTRAS):
            raise ConfigError(
                f"only {', '.join(EXTRAS)} can be added to what to save (got {', '.join(sorted(unknown))})"
            )
        if "glb" in given and level in ("people", "summary"):
            raise ConfigError(f"GLB files need the scene: save full, exact, compact or numbers (got '{text}')")
        return cls(level, tuple(extra for extra in EXTRAS if extra in given))

    def __str__(self) -> str:
        return "+".join((self.level, *self.extras))

    def with_report(self) -> Saving:
        """Return the same files and the report."""
        return Saving(self.level, (*self.extras, "report")) if "report" not in self.extras else self

    @property
    def is_exact(self) -> bool:
        """Whether arrays are written as computed, not in their smaller form."""
        return self.level in ("full", "exact")

    @property
    def preview(self) -> bool:
        """Whether ``preview.png`` is written."""
        return self.level in ("full", "compact") or "preview" in self.extras

    @property
    def glb(self) -> Literal["all", "combined", "none"]:
        """Which GLB files are written."""
        if self.level == "full" or "glb" in self.extras:
            return "all"
        return "combined" if self.level == "compact" else "none"

    @property
    def report(self) -> bool:
        """Whether ``report.html`` is written."""
        return "report" in self.extras

    @property
    def main_file(self) -> str:
        """The file of a photo's folder that is written last; "" if there is none."""
        if self.level != "summary":
            return "reconstruction.json"
        return "report.html" if self.report else "preview.png" if self.preview else ""
