"""What travels between the flows of the service: small JSON, from which each worker makes the request again."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from flows.dataset import Sequence
from flows.line import Line
from flows.request import Request
from flows.service.settings import placed
from storage_schemas.object_store import open_store
from storage_schemas.reference import ArtifactRef, validate_name
from storage_schemas.store import Store

Scores = Callable[[dict[str, ArtifactRef]], dict[str, Any] | None]


def unchecked(settings: Any, until: str) -> None:
    """Nothing can be found wrong before work starts."""


def unscored(actor: str, settings: Any, store: Store) -> Scores:
    """No truth, no scores."""
    return lambda artifacts: None


@dataclass(frozen=True)
class Service:
    """A line, its settings and where they are read, who compares an actor with a truth, and what raises BadInput before any work;
    deployed as one set of flows (`deployed.py`).
    """

    line: Line
    settings: type[BaseModel]
    load: Callable[[], Any]
    scores: Callable[[str, Any, Store], Scores] = unscored
    check: Callable[[Any, str], None] = unchecked

    def open(self, actor: str, sequence: str, until: str, settings: dict[str, Any]) -> tuple[Request, Store]:
        """The request and its store, from the JSON of a flow run. Raises BadName for a name that could leave its folder."""
        validate_name(actor, "actor")
        validate_name(sequence, "sequence")
        parsed: Any = self.settings.model_validate(settings)
        store = open_store(parsed.store)
        return Request(actor, sequence, parsed, self.line, until, self.scores(actor, parsed, store)), store

    def request(self, at: Sequence, settings: Any, store: Store) -> Request:
        """The request for one recording of a dataset."""
        own = settings.capture.model_copy(update={"recording": at.recording})
        parsed = placed(settings.model_copy(update={"capture": own}), store)
        return Request(at.actor, at.sequence, parsed, self.line, settings.dataset.until, self.scores(at.actor, parsed, store))
