"""`--store`, `--set`, `--json`: what several commands are told alike, and the one way they open the store."""

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from storage_schemas.store import Store

# text and no Path, which would take a slash from s3://
Location = Annotated[str | None, Parameter(name="--store", help="Folder of the artifact store, or s3://bucket/prefix.")]
Set = Annotated[tuple[str, ...], Parameter(name="--set", negative="", help="stage.parameter=value, any number of times.")]
Json = Annotated[bool, Parameter(name="--json", negative="", help="Machine-readable JSON on stdout.")]


def open_named(store: str | None) -> "Store":
    """The store at this place, else at the configured one. Raises BadInput, NewerFormat, Corrupt."""
    from flows.config import load
    from storage_schemas.object_store import open_store

    return open_store(load(places={"store": store}).store)
