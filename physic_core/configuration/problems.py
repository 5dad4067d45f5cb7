"""Problems of a configuration file; :mod:`problem_text` formats them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """One invalid setting of a configuration.

    Attributes:
        path: dotted path in the file: "metric_depth.options.scale".
        message: the error, the given value, and the remedy.
        of_plugin: whether the author of a plugin must correct it.
    """

    path: str
    message: str
    of_plugin: bool = False


@dataclass(frozen=True)
class ProblemReport:
    """Problems found by one check of a configuration.

    Attributes:
        problems: all of them.
        footer: last line of the error message; may be empty.
        cause: exception that caused one of the problems, if any.
    """

    problems: tuple[Problem, ...] = ()
    footer: str = ""
    cause: BaseException | None = None
