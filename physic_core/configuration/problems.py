"""Problems of a configuration, and one exception that lists all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, NamedTuple

from physic_core.discovery.error_text import did_you_mean
from physic_core.errors import ConfigError
from physic_core.files.text import quoted

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


class Problem(NamedTuple):
    """One invalid setting: its dotted path, such as "metric_depth.options.scale", and what is wrong
    with it.
    """

    path: str
    message: str


def config_error(problems: Iterable[Problem], source: Callable[[str], str]) -> ConfigError:
    """Return one exception with a line for each problem: "my.toml: photo.max_side: should be ...

    (got 3)".

    Args:
        problems: at least one.
        source: maps a dotted path to the file or flag that set its value.
    """
    return ConfigError(
        "\n".join(f"{source(path)}: {path}: {message}" for path, message in dict.fromkeys(problems))
    )


def problems_from_pydantic(
    error: ValidationError, model: type[BaseModel], path: str = "", kind: str = "key"
) -> list[Problem]:
    """Convert a validation error of pydantic to problems with the same messages.

    Args:
        error: the exception.
        model: the validated model; an unknown key is compared with its fields.
        path: dotted path of the validated table.
        kind: word for an unknown key, "key" or "option".
    """
    problems = []
    for problem in error.errors(include_url=False):
        loc = [str(part) for part in problem["loc"]]
        if problem["type"] == "extra_forbidden":
            allowed = _keys(model, loc[:-1])
            inner = [
                f"{table}.{loc[-1]}"
                for table in allowed
                if loc[-1] in _keys(model, [*loc[:-1], table])
            ]
            hint = (
                did_you_mean(loc[-1], allowed)
                or (f". Did you mean '{inner[0]}'?" if inner else "")
                or (f": choose one of {', '.join(allowed)}" if allowed else "")
            )
            message = f"unknown {kind}{hint}"
        elif problem["type"] == "missing":
            message = "is missing"
        elif problem["type"] in ("model_type", "dict_type"):
            keys = [".".join(filter(None, [path, *loc, key])) for key in _keys(model, loc)]
            example = f", such as {keys[0]}" if keys else ""
            message = f"is a table: set a key of it{example} (got {quoted(problem['input'])})"
        elif problem["type"] == "tuple_type":
            message = f"should be a list, such as [1.7, 1.8] (got {quoted(problem['input'])})"
        else:
            message = (
                problem["msg"]
                .removeprefix("Value error, ")
                .removeprefix("Input ")
                .removeprefix("String ")
            )
            message += (
                "" if problem["type"] == "value_error" else f" (got {quoted(problem['input'])})"
            )
        problems.append(Problem(".".join(filter(None, [path, *loc])), message))
    return problems


def _keys(model: type[BaseModel], loc: list[str]) -> list[str]:
    """Return the keys of the table at ``loc`` in a model, or none if there is no table."""
    fields = model.model_fields
    for part in loc:
        fields = getattr(fields[part].annotation if part in fields else None, "model_fields", {})
    return list(fields)
