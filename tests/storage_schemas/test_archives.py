"""Every store ever released still opens, and the schemas of today are those that were released.

`tests/archives/v1`, `v2`, … are stores, never changed once released. When a schema gets a new version, write the next:

    python -m tests.storage_schemas.test_archives tests/archives/v2
"""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from storage_schemas.catalogue import SCHEMAS
from storage_schemas.key import artifact_key
from storage_schemas.provenance import Provenance
from storage_schemas.store import Store
from tests.storage_schemas.examples import examples

ARCHIVES = Path(__file__).parents[1] / "archives"
LARGEST = 50_000  # bytes per artifact: archives are kept for ever


def write_archive(root: Path) -> None:
    """A new archive with one artifact of every schema."""
    store = Store(root)
    for name, record in examples().items():
        key = artifact_key(stage=name, stage_version=1, schema_version=record.schema_version, parameters={}, inputs={}, weights={})
        made = Provenance(stage=name, stage_version=1, host="archive")
        store.set_latest(store.publish(record, actor="archive", sequence="example", stage=name, key=key, provenance=made))
        shutil.rmtree(root / "archive" / "example" / name / ".lease")


def archived() -> list:
    return [
        pytest.param(folder, entry, id=f"{folder.name}-{entry.schema_name}")
        for folder in sorted(ARCHIVES.glob("v*"))
        for entry in Store(folder).list()
    ]


@pytest.mark.parametrize(("folder", "entry"), archived())
def test_every_released_artifact_opens(folder, entry):
    store, schema = Store(folder), SCHEMAS[entry.schema_name]
    ref = store.latest("archive", "example", entry.address.stage)
    record = store.open(ref, schema)
    assert isinstance(record, schema)
    assert store.verify(ref) == []
    assert entry.bytes < LARGEST
    if entry.schema_version == schema.schema_version:
        assert record == examples()[entry.schema_name]


@pytest.mark.parametrize("schema", sorted(SCHEMAS))
def test_the_newest_archive_of_a_schema_is_of_its_present_version(schema):
    """A changed schema needs a new version and a new archive; a changed field without one fails above."""
    versions = [parameter.values[1].schema_version for parameter in archived() if parameter.values[1].schema_name == schema]
    assert versions[-1:] == [SCHEMAS[schema].schema_version]


def test_provenance_with_fields_that_nothing_filled_is_read_and_written_without_them():
    store = Store(ARCHIVES / "v1")
    ref = store.latest("archive", "example", "keypoints")
    written = json.loads((store.folder(ref) / "provenance.json").read_text())
    assert {"image_digest", "attempts"} <= written.keys()
    assert store.provenance(ref).model_dump(mode="json").keys() == written.keys() - {"image_digest", "attempts"}
    with pytest.raises(ValidationError, match="mood"):
        Provenance(stage="a", stage_version=1, mood="good")


def test_the_archives_were_made_of_noise_not_of_zeros():
    """Control: an archive of zeros would open even if its chunks were lost."""
    store = Store(ARCHIVES / "v1")
    keypoints = store.open(store.latest("archive", "example", "keypoints"), SCHEMAS["keypoints"])
    assert np.unique(keypoints.keypoints).size > 1000


if __name__ == "__main__":
    write_archive(Path(sys.argv[1]))
