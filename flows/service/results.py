"""Result records are JSON, and a record that says otherwise is refused before it is opened.

Prefect reads a record with the serializer that the record itself names, and a serializer can name any Python function: whoever can write
to the result storage could have code run on every worker. Nothing here needs records of others; the store's manifests are plain JSON.
"""

import json
from inspect import signature
from typing import Any

from prefect._internal.result_records import ResultRecord
from prefect.serializers import JSONSerializer


class ForeignRecord(ValueError):
    """A result record that was not written as plain JSON."""


def refuse_foreign_records() -> None:
    """From now on, in this process. Safe to repeat."""
    for name, where in (("deserialize", 0), ("deserialize_from_result_and_metadata", 1)):
        method = getattr(ResultRecord, name).__func__
        if not hasattr(method, "guarded"):
            setattr(ResultRecord, name, classmethod(_guarded(method, where)))


def _guarded(method: Any, where: int) -> Any:
    def checked(cls: type, *data: Any, **named: Any) -> Any:
        bound = signature(method).bind(cls, *data, **named)
        _check(bound.args[1 + where])
        return method(*bound.args, **bound.kwargs)

    guarded: Any = checked
    guarded.guarded = True
    return guarded


def _check(record: bytes) -> None:
    try:
        parsed = json.loads(record)
        metadata = parsed.get("metadata", parsed)
        named = metadata["serializer"]
    except (ValueError, KeyError, AttributeError, TypeError):
        raise ForeignRecord("a result record that does not name its serializer is refused") from None
    if named != JSONSerializer().model_dump(mode="json"):
        raise ForeignRecord(f"a result record with serializer {str(named)[:80]} is refused: this service writes JSON")
