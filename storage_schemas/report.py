"""Report: one page that a person reads, and its figures as JSON.

`files` MUST hold `report.html`; the page refers to the other files by their bare names.
"""

from __future__ import annotations

from storage_schemas.faults import Fault
from storage_schemas.fields import JsonDict, stored_files
from storage_schemas.record import Record

PAGE = "report.html"


class Report(Record, name="report", version=1):
    """The page and what it rests on."""

    files: dict[str, bytes] = stored_files()
    summary: JsonDict

    def faults(self) -> list[Fault]:
        """The page itself."""
        return [] if PAGE in self.files else [self.fault("files", f"has no {PAGE}", "write the page under that name")]
