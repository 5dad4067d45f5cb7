"""Dataclasses of a result as JSON records: a key for each field, with the field's name unless ``_KEYS`` has another."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from physic_core.files.strict_json import from_json
from physic_core.types import BodyContact, ContactPartner, Provenance, StageRecord, Support

_Record = TypeVar("_Record")

_KEYS = {
    (ContactPartner, "surface"): "class",
    (ContactPartner, "part"): "person_part",
    (Provenance, "backend"): "name",
    (StageRecord, "provenance"): "backend",
}


def to_record(value: Any) -> Any:
    """Return a dataclass, or a sequence of them, ready for :func:`physic_core.files.strict_json.to_json`.

    The keys of a contact's partner are among those of the contact. Titles of partners and hidden supports are for
    readers.
    """
    if isinstance(value, tuple | list):
        return [to_record(item) for item in value]
    if not is_dataclass(value):
        return value
    record: dict[str, Any] = {}
    for field in fields(value):
        item = getattr(value, field.name)
        if isinstance(value, BodyContact) and isinstance(item, ContactPartner):
            record |= {"partner": item.title, **to_record(item)}
        else:
            record[_key(type(value), field.name)] = to_record(item)
    return record | {"hidden": value.hidden} if isinstance(value, Support) else record


def from_record(kind: type[_Record], record: Mapping[str, Any]) -> _Record:
    """Parse a dataclass of class ``kind``.

    Raises:
        KeyError, TypeError, ValueError: a key is missing, or of the wrong type.
    """
    values: dict[str, Any] = {}
    hints = _hints(kind)  # type: ignore[arg-type]  # mypy takes no type variable for hashable
    for field in fields(kind):  # type: ignore[arg-type]  # a type variable cannot be bound to dataclasses
        hint = hints[field.name]
        if hint is ContactPartner:
            values[field.name] = from_record(ContactPartner, record)
        else:
            values[field.name] = _value(hint, record[_key(kind, field.name)])
    return kind(**values)


def from_records(kind: type[_Record], records: Iterable[Mapping[str, Any]] | None) -> tuple[_Record, ...]:
    """Parse a list of records; None is an empty one."""
    return tuple(from_record(kind, record) for record in records or ())


def _key(kind: type, name: str) -> str:
    return _KEYS.get((kind, name), name)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _value(hint: Any, value: Any) -> Any:
    if value is None:
        return None
    inner = get_args(hint)
    if get_origin(hint) is tuple:
        return tuple(_value(inner[0], item) for item in value)
    kind = next((one for one in inner if one is not type(None)), hint) if type(None) in inner else hint
    if is_dataclass(kind):
        return from_record(kind, value)  # type: ignore[arg-type]
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(value)
    return value if kind is str else from_json(value)
