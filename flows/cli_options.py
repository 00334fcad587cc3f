"""`--store`, `--set`, `--json`: what several commands are told alike, and the one way they open a store to look into it."""

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from storage_schemas.store import Store

# text and no Path, which would take a slash from s3://
Location = Annotated[str | None, Parameter(name="--store", help="Folder of the artifact store, or s3://bucket/prefix.")]
Set = Annotated[tuple[str, ...], Parameter(name="--set", negative="", help="stage.parameter=value, any number of times.")]
Json = Annotated[bool, Parameter(name="--json", negative="", help="Machine-readable JSON on stdout.")]


def open_named(store: str | None) -> "Store":
    """The store that there is at this place, else at the configured one; makes none. Raises BadInput, StoreFault."""
    from flows.config import load
    from storage_schemas.object_store import open_store
    from tasks.geometry.faults import Fault, refuse

    opened = open_store(load(places={"store": store}).store, founds=False)
    remedy = "Name another place with --store or PHYSAVATAR_STORE; `physavatar submit` makes one."
    refuse([] if opened.is_founded() else [Fault(opened.location, "there is no store", remedy)])
    return opened
