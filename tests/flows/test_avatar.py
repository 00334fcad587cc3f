"""What is exported was made from one another: no artifact of an earlier or later run is among it."""

import re

import numpy as np
import pytest

from flows.avatar import Avatar, export
from flows.endings import Refused
from flows.pipeline import STAGES
from storage_schemas.appearance import Appearance
from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth
from storage_schemas.provenance import Provenance
from storage_schemas.record import Record
from storage_schemas.reference import ArtifactRef
from storage_schemas.registration import Registration
from storage_schemas.skinning import Skinning
from storage_schemas.store import Store
from storage_schemas.tracking import Tracking
from tests.storage_schemas.examples import examples, key_of

OWN = {  # what differs from run to run
    "tracking": "vertices",
    "registration": "translation",
    "skinning": "rest_vertices",
    "cloth": "simulated",
    "appearance": "light",
}


def changed(stage: str, run: int) -> Record:
    """The example of a stage with what this run made of it; all runs share the capture."""
    record = examples()[stage]
    return record.model_copy(update={OWN[stage]: getattr(record, OWN[stage]) + np.float32(run)}) if stage in OWN else record


def submit(store: Store, run: int, until: str = "appearance") -> dict[str, ArtifactRef]:
    """Every stage up to one, as a run with a setting of its own leaves them."""
    made: dict[str, ArtifactRef] = {}
    for stage, declared in STAGES.items():
        inputs = {name: made[schema.schema_name] for name, schema in declared.reads.items()}
        provenance = Provenance(stage=stage, stage_version=1, inputs=inputs)
        record = changed(stage, run)
        made[stage] = store.publish(record, actor="ann", sequence="walk", stage=stage, key=key_of(run, stage), provenance=provenance)
        store.set_latest(made[stage])
        if stage == until:
            break
    return made


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "store")


def avatar(store: Store) -> Avatar:
    return Avatar(store, "ann", "walk")


def test_what_is_opened_belongs_to_the_newest_cloth(store):
    submit(store, 1)
    submit(store, 2, until="tracking")  # another setting, and not as far as the cloth
    opened = avatar(store)
    for schema in (Capture, Tracking, Registration, Skinning, Cloth, Appearance):
        assert opened.open(schema) == changed(schema.schema_name, 1)
    submit(store, 2)
    assert avatar(store).open(Tracking) == changed("tracking", 2)


def test_it_goes_out_as_a_file(store, tmp_path):
    submit(store, 1)
    submit(store, 2, until="tracking")
    (written,) = export(avatar(store), tmp_path / "out", ("npz",))
    assert np.array_equal(np.load(written)["vertices"], changed("tracking", 1).vertices[:, :3])


def test_an_appearance_of_another_surface_is_refused(store):
    submit(store, 1)
    submit(store, 2, until="cloth")
    opened = avatar(store)
    assert opened.open(Tracking) == changed("tracking", 2)
    with pytest.raises(
        Refused, match=r"newest appearance and cloth of ann walk are of different registration, skinning, tracking.*submit ann"
    ):
        opened.open(Appearance)


@pytest.mark.parametrize("gone", ["tracking", "cloth"])
def test_what_it_was_made_from_and_is_gone_is_refused(store, gone):
    store.retire(submit(store, 1)[gone])
    with pytest.raises(Refused, match=rf"the {gone} of ann walk .* is gone or damaged.*submit ann"):
        avatar(store).open(Tracking)


def test_another_content_under_the_same_key_is_refused(store):
    store.retire(submit(store, 1)["tracking"])
    again = changed("tracking", 3)
    store.publish(
        again,
        actor="ann",
        sequence="walk",
        stage="tracking",
        key=key_of(1, "tracking"),
        provenance=Provenance(stage="tracking", stage_version=1),
    )
    with pytest.raises(Refused, match=r"the tracking of ann walk .* is gone or damaged"):
        avatar(store).open(Tracking)


def test_without_a_cloth_there_is_no_avatar(store):
    submit(store, 1, until="skinning")
    with pytest.raises(Refused, match=re.escape("ann walk has no cloth yet: run `physavatar submit ann` first")):
        avatar(store).open(Tracking)


def test_a_cloth_from_before_there_was_a_skinning_is_refused(store):
    made = submit(store, 1)
    inputs = {name: made[name] for name in ("capture", "tracking")}
    old = store.publish(
        examples()["cloth"],
        actor="ann",
        sequence="walk",
        stage="cloth",
        key=key_of(9, "cloth"),
        provenance=Provenance(stage="cloth", stage_version=1, inputs=inputs),
    )
    store.set_latest(old)
    with pytest.raises(Refused, match="was made without a skinning"):
        avatar(store).open(Skinning)
