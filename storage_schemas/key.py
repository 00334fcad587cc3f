"""The key of an artifact: SHA-256 of the canonical JSON of everything that decides its content.

Canonical JSON: keys sorted, no spaces, ASCII; tuples are lists; numpy scalars are numbers; a float with an integral
value is that integer, so 1 and 1.0 give one key. Booleans stay booleans. NaN and infinity have no JSON and are refused,
as is everything else that JSON cannot say (paths, sets, arrays): such a value has no spelling all machines share.

The container image is not part of the key: a rebuilt image with the same science finds what the old one made. The versions of
the packages in it stand in the provenance.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from storage_schemas.faults import BadRecord, Fault

PLAIN = (str, int, bool)  # most of what there is, and a plan over thousands of sequences asks for all of it
EXACT_INTEGER = 2**53  # above this a float no longer names one integer


def plain_json(value: Any, where: str = "value") -> Any:
    """`value` in None, bool, int, float, str, list and dict; raises BadRecord that names the spot inside `value`."""
    if value is None or type(value) in PLAIN:
        return value
    match value:
        case np.generic():
            return plain_json(value.item(), where)
        case bool() | int() | str():  # of a class of their own
            return value
        case float() if math.isfinite(value):
            return value
        case float():
            raise BadRecord(Fault(where, f"{value} has no JSON", "give a finite number, or None where there is none"))
        case list() | tuple():
            return [plain_json(item, f"{where}[{i}]") for i, item in enumerate(value)]
        case Mapping():
            return {_text(name, where): plain_json(item, f"{where}.{name}") for name, item in value.items()}
    raise BadRecord(Fault(where, f"a {type(value).__name__} has no JSON", "give numbers, strings, lists or dicts with string keys"))


def canonical_json(value: Any) -> str:
    """One spelling per value, the same in every process and on every machine."""
    return json.dumps(_integral(plain_json(value)), sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def artifact_key(
    *,
    stage: str,
    stage_version: int,
    schema_version: int,
    parameters: Mapping[str, Any],
    inputs: Mapping[str, str],
    weights: Mapping[str, str],
) -> str:
    """SHA-256 in hex. `inputs` and `weights` map a name to the digest of an artifact or of a file of model weights."""
    decides = {
        "stage": stage,
        "stage_version": stage_version,
        "schema_version": schema_version,
        "parameters": parameters,
        "inputs": inputs,
        "weights": weights,
    }
    return hashlib.sha256(canonical_json(decides).encode()).hexdigest()


def _text(name: Any, where: str) -> str:
    if isinstance(name, str):
        return name
    raise BadRecord(Fault(where, f"the key {name!r} is not a string", "use strings as keys: JSON would turn 1 into '1' silently"))


def _integral(value: Any) -> Any:
    if isinstance(value, float):
        return int(value) if value.is_integer() and abs(value) < EXACT_INTEGER else value
    if isinstance(value, list):
        return [_integral(item) for item in value]
    if isinstance(value, dict):
        return {name: _integral(item) for name, item in value.items()}
    return value
