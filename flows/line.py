"""A production line: which stages there are and in which order, whatever running a stage means to the caller."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from storage_schemas.reference import ArtifactRef
from tasks.stage import Stage


class Run(Protocol):
    """Brings one stage about and returns the reference of its artifact, or None while that cannot be known yet."""

    def __call__(self, stage: Stage, **inputs: ArtifactRef | None) -> ArtifactRef | None:
        """The artifact of `stage` from these inputs."""
        ...


@dataclass(frozen=True)
class Line:
    """Stages in their order. The stage named `closing`, if any, comes last and takes whatever was reached."""

    stages: Mapping[str, Stage]
    order: Callable[[Run], None]
    closing: str | None = None

    def walk(
        self, until: str, bring: Callable[[Stage, dict[str, ArtifactRef | None], dict[str, ArtifactRef]], ArtifactRef | None]
    ) -> dict[str, ArtifactRef]:
        """Go along the line up to `until`; `bring(stage, inputs, done)` returns the stage's artifact, or None where it cannot be had yet."""
        done: dict[str, ArtifactRef] = {}

        def run(stage: Stage, **inputs: ArtifactRef | None) -> ArtifactRef | None:
            ref = bring(stage, inputs, done)
            if ref is not None:
                done[stage.name] = ref
            if stage.name == until != self.closing:
                raise _Reached
            return ref

        with suppress(_Reached):
            self.order(run)
        names = list(self.stages)
        if self.closing is not None and until != names[0]:
            reached = names[: names.index(until) + 1]
            run(self.stages[self.closing], **{name: done.get(name) for name in reached if name != self.closing})
        return done


class _Reached(Exception):
    """The last stage asked for has run."""


def present(inputs: Mapping[str, ArtifactRef | None]) -> dict[str, ArtifactRef] | None:
    """The inputs of a stage, once all of them are there."""
    found = {name: ref for name, ref in inputs.items() if ref is not None}
    return found if len(found) == len(inputs) else None
