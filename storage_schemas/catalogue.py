"""Every schema by its name: what the tests and their archives go through, so that none is forgotten."""

from __future__ import annotations

from storage_schemas.appearance import Appearance
from storage_schemas.body import Body
from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth
from storage_schemas.gap import Gap
from storage_schemas.keypoints import Keypoints
from storage_schemas.record import Record
from storage_schemas.registration import Registration
from storage_schemas.report import Report
from storage_schemas.skinning import Skinning
from storage_schemas.tracking import Tracking

SCHEMAS: dict[str, type[Record]] = {
    schema.schema_name: schema for schema in (Capture, Keypoints, Body, Tracking, Registration, Skinning, Cloth, Appearance, Gap, Report)
}
