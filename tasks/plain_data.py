"""Results of computations as bytes that cannot do anything: arrays in NPZ without pickles, everything else as JSON.

Read back by the type that is expected, never by a name in the file: numbers, text, None, arrays, tuples, lists, dictionaries with text
keys, and dataclasses of these. And a digest of whatever a computation is given, equal wherever it is given the same.
"""

import hashlib
import io
import json
import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints
from zipfile import BadZipFile

import numpy as np

TREE = "tree"


def as_bytes(value: Any) -> bytes:
    """The value as NPZ. Raises TypeError for what plain data cannot say."""
    arrays: list[np.ndarray] = []
    tree = json.dumps(_said(value, arrays))
    out = io.BytesIO()
    np.savez(out, **{TREE: np.frombuffer(tree.encode(), np.uint8)}, **{str(i): a for i, a in enumerate(arrays)})
    return out.getvalue()


def from_bytes(kind: Any, content: bytes) -> Any:
    """The value of type `kind` again. Raises ValueError for bytes that are not such a value."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as kept:
            arrays = dict(kept)
        return _heard(kind, json.loads(arrays.pop(TREE).tobytes()), arrays)
    except (BadZipFile, EOFError, LookupError, StopIteration, TypeError, ValueError, OSError) as damaged:
        raise ValueError(f"no plain data: {type(damaged).__name__}: {damaged}") from damaged


def digest(value: Any) -> str:
    """SHA-256 of a value by its content: the data above, functions and classes by name, other objects by their attributes."""
    seen = hashlib.sha256()
    _digested(value, seen)
    return seen.hexdigest()


def _said(value: Any, arrays: list[np.ndarray]) -> Any:
    match value:
        case None | bool() | str():
            return value
        case np.generic():
            return value.item()
        case int() | float():
            return value
        case np.ndarray() if value.dtype != object:
            arrays.append(value)
            return {"array": str(len(arrays) - 1)}
        case tuple() | list():
            return {"items": [_said(v, arrays) for v in value]}
        case dict() if all(isinstance(k, str) for k in value):
            return {"map": {k: _said(v, arrays) for k, v in value.items()}}
    if is_dataclass(value) and not isinstance(value, type):
        return {"fields": {f.name: _said(getattr(value, f.name), arrays) for f in fields(value)}}
    raise TypeError(f"plain data has no word for {type(value).__name__}")


def _heard(kind: Any, node: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if not isinstance(node, dict):
        return node
    if "array" in node:
        return arrays[node["array"]]
    kind = _concrete(kind, node)
    if "fields" in node:
        hints = get_type_hints(kind)
        return kind(**{name: _heard(hints[name], v, arrays) for name, v in node["fields"].items()})
    if "map" in node:
        inner = (get_args(kind) or (str, Any))[1]
        return {name: _heard(inner, v, arrays) for name, v in node["map"].items()}
    inner, items = get_args(kind), node["items"]
    each = [inner[0]] * len(items) if len(inner) != len(items) or inner[-1] is Ellipsis else inner
    return (get_origin(kind) or kind)(_heard(k, v, arrays) for k, v in zip(each, items, strict=True))


def _concrete(kind: Any, node: dict[str, Any]) -> Any:
    """The member of a union that the node can be."""
    if get_origin(kind) not in (Union, types.UnionType):
        return kind
    wanted = is_dataclass if "fields" in node else (lambda k: (get_origin(k) or k) is dict) if "map" in node else _is_row
    return next(k for k in get_args(kind) if wanted(k))


def _is_row(kind: Any) -> bool:
    return (get_origin(kind) or kind) in (tuple, list)


def _digested(value: Any, seen: Any) -> None:
    seen.update(f"{type(value).__module__}.{type(value).__qualname__}(".encode())  # two plug-ins may give their classes one name
    match value:
        case np.ndarray() if value.dtype != object:
            seen.update(f"{value.dtype.str}{value.shape}".encode())
            seen.update(np.ascontiguousarray(value).tobytes())
        case None | bool() | int() | float() | str() | bytes() | np.generic() | Path():
            seen.update(repr(value).encode())
        case tuple() | list():
            _all_digested(value, seen)
        case set() | frozenset():
            seen.update("".join(sorted(map(digest, value))).encode())
        case Mapping():
            _all_digested([part for item in value.items() for part in item], seen)
        case partial():
            _all_digested([value.func, value.args, value.keywords], seen)
        case type() | types.FunctionType() | types.BuiltinFunctionType():
            seen.update(f"{value.__module__}.{value.__qualname__}".encode())
        case types.MethodType():
            _all_digested([value.__func__, value.__self__], seen)
        case _ if is_dataclass(value):
            _all_digested([getattr(value, f.name) for f in fields(value)], seen)
        case _:
            _digested(vars(value) if hasattr(value, "__dict__") else repr(value), seen)
    seen.update(b")")


def _all_digested(values: Any, seen: Any) -> None:
    for value in values:
        _digested(value, seen)
