"""What computations leave behind: read back as it was, by the type that is expected, and nothing else."""

import pickle
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from tasks.cloth.adam_fd import Score
from tasks.cloth.shooting import Evidence
from tasks.cloth.windows import Normals, Prediction, Window
from tasks.plain_data import as_bytes, digest, from_bytes


@dataclass(frozen=True)
class Inner:
    values: NDArray[np.float64]
    name: str = "ω"


@dataclass(frozen=True)
class Outer:
    inner: Inner | None
    pair: tuple[int, float] = (1, np.inf)
    many: tuple[Inner, ...] = ()
    table: dict[str, Inner] = field(default_factory=dict)


def evidence() -> Evidence:
    rng = np.random.default_rng(0)
    found = Prediction(Window(0, 3, 4), rng.normal(size=(5, 7, 3)), {"log_membrane": rng.normal(size=(4, 7, 3))}, "converged", 31)
    return Evidence(found, Normals(("log_membrane",), rng.normal(size=(1, 1)), np.array([np.nan]), 2.5, 84), None, found.x[1:])


def same(a: object, b: object) -> bool:
    return digest(a) == digest(b)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (float, 0.1 + 0.2),
        (Score, Score(1e-6, np.inf, 96, 12.5, "Newton stalled")),
        (Evidence, evidence()),
        (NDArray[np.float64] | None, None),
        (NDArray[np.float64] | None, np.linspace(0, 1, 6).reshape(2, 3)),
        (Outer, Outer(Inner(np.arange(3.0)), many=(Inner(np.zeros(0)),), table={"a": Inner(np.ones((2, 2)), "b")})),
        (tuple[NDArray[np.float64], str], (np.array([np.pi]), "τ")),
    ],
    ids=["number", "score", "evidence", "none", "array", "nested", "pair"],
)
def test_what_is_written_is_read_back(kind, value):
    assert same(from_bytes(kind, as_bytes(value)), value)


def test_a_function_is_no_plain_data():
    with pytest.raises(TypeError, match="no word for function"):
        as_bytes(Outer(inner=evidence))


@pytest.mark.parametrize(
    "damage", [lambda b: b"", lambda b: b[: len(b) // 2], lambda b: pickle.dumps([1])], ids=["empty", "half", "pickle"]
)
def test_damage_is_a_value_error(damage):
    with pytest.raises(ValueError, match="no plain data"):
        from_bytes(Evidence, damage(as_bytes(evidence())))


@pytest.mark.parametrize(("kind", "value"), [(Evidence, ("job", evidence())), (Inner | None, {"values": 1.0})])
def test_what_another_version_left_is_a_value_error(kind, value):
    with pytest.raises(ValueError, match="no plain data"):
        from_bytes(kind, as_bytes(value))


def test_an_array_of_objects_is_never_unpickled(tmp_path):
    file = tmp_path / "a.npz"
    np.savez(file, tree=np.frombuffer(b'{"array": "0"}', np.uint8), **{"0": np.array([{}], dtype=object)}, allow_pickle=True)
    with pytest.raises(ValueError, match="allow_pickle"):
        from_bytes(NDArray[np.float64], file.read_bytes())


def test_a_digest_is_of_content_not_of_objects():
    x = np.arange(6.0).reshape(2, 3)
    assert same(Outer(Inner(x)), Outer(Inner(x.T.copy().T)))
    assert same({1, 2, 3}, {3, 2, 1})
    assert same(partial(evidence, 1), partial(evidence, 1))


@pytest.mark.parametrize(
    "other",
    [
        lambda o: replace(o, pair=(1, 2.0)),
        lambda o: replace(o, inner=replace(o.inner, values=o.inner.values.reshape(3, 2))),
        lambda o: replace(o, inner=replace(o.inner, values=np.nextafter(o.inner.values, 9))),
        lambda o: replace(o, inner=replace(o.inner, name="")),
        lambda o: replace(o, inner=None),
        lambda o: replace(o, many=(o.inner,)),
    ],
    ids=["number", "shape", "last bit", "text", "none", "longer"],
)
def test_any_difference_is_another_digest(other):
    one = Outer(Inner(np.arange(6.0).reshape(2, 3)))
    assert not same(one, other(one))


def test_classes_of_one_name_from_two_files_are_not_the_same():
    here, there = (type("Magnet", (), {"__module__": name}) for name in ("effect_here", "effect_there"))
    assert same(here(), here())
    assert not same(here(), there())
