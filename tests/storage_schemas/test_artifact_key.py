"""One value, one key, in every process; another value, another key."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage_schemas.faults import BadRecord
from storage_schemas.key import artifact_key, canonical_json

SCALARS = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8)
VALUES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3), max_leaves=8
)


def key(**parameters) -> str:
    return artifact_key(stage="body", stage_version=1, schema_version=1, parameters=parameters, inputs={"capture": "a"}, weights={})


@given(VALUES)
def test_spelling_does_not_depend_on_order_or_on_tuple_or_list(value):
    def otherwise(x):
        if isinstance(x, dict):
            return {name: otherwise(item) for name, item in reversed(x.items())}
        return tuple(map(otherwise, x)) if isinstance(x, list) else x

    assert canonical_json(value) == canonical_json(otherwise(value))


@given(VALUES)
def test_canonical_json_is_json_and_a_fixed_point(value):
    written = canonical_json(value)
    assert canonical_json(json.loads(written)) == written


@given(st.integers(-(2**53) + 1, 2**53 - 1))
def test_an_integer_and_the_float_of_the_same_value_are_one(number):
    assert canonical_json(number) == canonical_json(float(number)) == canonical_json(np.float64(number)) == str(number)


def test_numpy_scalars_are_numbers_and_a_boolean_is_not_one():
    assert key(step=np.float64(0.5), count=np.int32(3)) == key(count=3.0, step=0.5)
    assert key(flag=True) != key(flag=1)


def test_a_number_of_a_class_of_its_own_is_that_number():
    class Metres(float):
        pass

    assert key(step=Metres(1.0)) == key(step=1)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (float("nan"), r"value\.step\[1\]: nan has no JSON"),
        (float("inf"), "inf has no JSON"),
        (b"x", "a bytes has no JSON"),
        ({1: 2}, "the key 1 is not a string"),
        (np.zeros(2), "a ndarray has no JSON"),
    ],
)
def test_what_json_cannot_say_is_refused_with_its_place(value, says):
    with pytest.raises(BadRecord, match=says):
        canonical_json({"step": [0, value]})


def test_every_ingredient_decides():
    ingredients = {
        "stage": "s",
        "stage_version": 1,
        "schema_version": 1,
        "parameters": {"a": 1},
        "inputs": {"x": "1"},
        "weights": {"w": "1"},
    }
    changed = [
        {"stage": "t"},
        {"stage_version": 2},
        {"schema_version": 2},
        {"parameters": {"a": 2}},
        {"inputs": {"y": "1"}},
        {"weights": {"w": "2"}},
    ]
    assert len({artifact_key(**ingredients), *(artifact_key(**(ingredients | change)) for change in changed)}) == 7


@pytest.mark.parametrize("hash_seed", ["0", "1", "4711"])
def test_the_key_is_the_same_in_another_process(hash_seed):
    parameters = {"b": [1, 2.5], "a": {"ä": None, "x": 1e-300}}
    program = (
        "import json, sys; from storage_schemas.key import artifact_key as k; print(k(stage='body', stage_version=1, schema_version=1, "
        "parameters=json.loads(sys.argv[1]), inputs={'capture': 'a'}, weights={}))"
    )
    other = subprocess.run(
        [sys.executable, "-c", program, json.dumps(dict(reversed(parameters.items())))],
        env=os.environ | {"PYTHONHASHSEED": hash_seed},
        capture_output=True,
        text=True,
        check=True,
    )
    assert other.stdout.strip() == key(**parameters)
