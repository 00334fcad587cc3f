"""The latest pictures of a sequence, as image artifacts small enough to be shown inside the Prefect UI."""

import base64
import io
import re
from pathlib import Path

from PIL import Image
from prefect.artifacts import create_image_artifact, create_markdown_artifact

from flows.service.shown import artifact_name
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store

WIDTH, QUALITY = 480, 70
EMBEDDED = re.compile(r'src="data:image/(?:png|jpeg);base64,([A-Za-z0-9+/=]+)"')


def show_pictures(store: Store, ref: ArtifactRef, recording: Path) -> None:
    """For a report its first picture and its verdict; other stages have none of their own yet."""
    page = store.folder(ref) / "files" / "report.html"
    if ref.stage != "report" or not page.exists():
        return
    html, key = page.read_text(), artifact_name(ref.actor, ref.sequence)
    if (found := EMBEDDED.search(html)) is not None:
        create_image_artifact(thumbnail(base64.b64decode(found[1])), key=f"{key}-picture", description=f"{ref.actor} {ref.sequence}")
    create_markdown_artifact(f"# {ref.actor} {ref.sequence}\n\n`{page}`", key=f"{key}-report")


def thumbnail(image: bytes) -> str:
    """An encoded picture as a data URL of a small JPEG."""
    with Image.open(io.BytesIO(image)) as opened:
        small = opened.convert("RGB")
    small.thumbnail((WIDTH, WIDTH))
    out = io.BytesIO()
    small.save(out, "JPEG", quality=QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(out.getvalue()).decode()
