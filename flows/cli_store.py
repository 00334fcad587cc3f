"""`--store`: how a command is told where the artifacts are, and the one way it opens them."""

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from storage_schemas.store import Store

# text and no Path, which would take a slash from s3://
Location = Annotated[str | None, Parameter(name="--store", help="Folder of the artifact store, or s3://bucket/prefix.")]


def open_named(store: str | None) -> "Store":
    """The store at this place, else at the configured one. Raises BadInput, NewerFormat, Corrupt."""
    from flows.config import load
    from storage_schemas.object_store import open_store

    return open_store(load(places={"store": store}).store)
