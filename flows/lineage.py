"""Which artifacts of a sequence belong together: its newest cloth, what that was made from, and the appearance of the same surface.

`latest` of each stage would not do: a later run with another setting that went less far leaves a surface that the cloth is not of.
"""

from functools import cached_property

from flows.endings import Refused
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store


class Lineage:
    """Looked up as it is asked for, and once: what another run publishes meanwhile does not get in."""

    def __init__(self, store: Store, actor: str, sequence: str) -> None:
        self.store, self.actor, self.sequence = store, actor, sequence

    def artifact(self, stage: str) -> ArtifactRef:
        """That of this stage. Raises Refused where there is none, where it is gone, or where it does not belong to the cloth."""
        known = self._of_appearance if stage == "appearance" else self._of_cloth
        if stage not in known:
            raise Refused(f"the newest cloth of {self._whose} was made without a {stage}: {self._remedy}")
        return self._found(known[stage])

    @cached_property
    def _of_cloth(self) -> dict[str, ArtifactRef]:
        return self._with_inputs("cloth")

    @cached_property
    def _of_appearance(self) -> dict[str, ArtifactRef]:
        own, cloth = self._with_inputs("appearance"), self._of_cloth
        if other := [stage for stage in sorted(own.keys() & cloth.keys()) if own[stage].digest != cloth[stage].digest]:
            raise Refused(f"the newest appearance and cloth of {self._whose} are of different {', '.join(other)}: {self._remedy}")
        return own

    def _with_inputs(self, stage: str) -> dict[str, ArtifactRef]:
        """Stage → artifact: the newest of this stage and its inputs, which have names of their own there."""
        newest = self.store.latest(self.actor, self.sequence, stage)
        if newest is None:
            raise Refused(f"{self._whose} has no {stage} yet: {self._remedy}")
        return {ref.stage: ref for ref in (newest, *self.store.provenance(self._found(newest)).inputs.values())}

    def _found(self, ref: ArtifactRef) -> ArtifactRef:
        there = self.store.find(ref.actor, ref.sequence, ref.stage, ref.key)
        if there is None or there.digest != ref.digest:
            raise Refused(f"the {ref.stage} of {self._whose} that was used is gone or damaged (key {ref.key[:12]}): {self._remedy}")
        return ref

    @property
    def _whose(self) -> str:
        return f"{self.actor} {self.sequence}"

    @property
    def _remedy(self) -> str:
        return f"run `physavatar submit {self.actor}` first"
