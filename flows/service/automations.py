"""What the server does by itself: declares runs without heartbeat crashed, and tells somebody when an actor failed.

The first must exist before any worker starts: it arms on a heartbeat that comes *after* its creation, and a run that died earlier stays
Running for good (the sweeper then finds it).
"""

from datetime import timedelta
from uuid import UUID

from prefect.blocks.notifications import AppriseNotificationBlock
from prefect.client.orchestration import PrefectClient
from prefect.client.schemas.objects import StateType
from prefect.events.actions import ActionTypes, ChangeFlowRunState, SendNotification
from prefect.events.schemas.automations import AutomationCore, EventTrigger, Posture
from pydantic import SecretStr

HEARTBEAT_S = 30  # the shortest Prefect allows
SILENCE_S = 3 * HEARTBEAT_S
ZOMBIES, FAILURES = "physavatar: runs without heartbeat are crashed", "physavatar: tell of failed runs"
ENDINGS = {f"prefect.flow-run.{ending}" for ending in ("Completed", "Failed", "Crashed", "Cancelled", "TimedOut")}


def zombies() -> AutomationCore:
    """No heartbeat and no ending within three heartbeats: crashed."""
    crash: ActionTypes = ChangeFlowRunState(
        state=StateType.CRASHED, name=None, message=f"no heartbeat for {SILENCE_S} s: its process or machine is gone", force=False
    )
    return AutomationCore(
        name=ZOMBIES,
        trigger=EventTrigger(
            after={"prefect.flow-run.heartbeat"},
            expect={"prefect.flow-run.heartbeat"} | ENDINGS,
            match={"prefect.resource.id": ["prefect.flow-run.*"]},
            for_each={"prefect.resource.id"},
            posture=Posture.Proactive,
            threshold=1,
            within=timedelta(seconds=SILENCE_S),
        ),
        actions=[crash],
    )


def failures(notification_block: UUID) -> AutomationCore:
    """A failed run of an actor or a dataset is told to whoever the block reaches (mail, chat, webhook: any Apprise URL)."""
    notice: ActionTypes = SendNotification(
        block_document_id=notification_block,
        subject="physavatar: {{ flow_run.name }} {{ flow_run.state.name }}",
        body="{{ flow_run.state.message }}\n{{ flow_run|ui_url }}",
    )
    return AutomationCore(
        name=FAILURES,
        trigger=EventTrigger(
            expect={"prefect.flow-run.Failed", "prefect.flow-run.TimedOut"},
            match={"prefect.resource.id": ["prefect.flow-run.*"]},
            match_related={"prefect.resource.id": ["prefect.tag.orchestration"]},
            for_each={"prefect.resource.id"},
            posture=Posture.Reactive,
            threshold=1,
        ),
        actions=[notice],
    )


async def arm(client: PrefectClient, notify: SecretStr | None = None) -> None:
    """Create the automations or bring them up to date. `notify` is an Apprise URL; it holds a credential and is kept as a secret block."""
    wanted = [zombies()]
    if notify is not None:
        block = await AppriseNotificationBlock(url=notify).save("physavatar-failures", overwrite=True)
        wanted.append(failures(block))
    for automation in wanted:
        known = await client.read_automations_by_name(automation.name)
        if known:
            await client.update_automation(known[0].id, automation)
        else:
            await client.create_automation(automation)


async def armed(client: PrefectClient) -> bool:
    """Whether zombies would be noticed."""
    return any(automation.enabled for automation in await client.read_automations_by_name(ZOMBIES))
