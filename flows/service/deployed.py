"""The flows that deploy/prefect.yaml names: the avatar's line, one flow per worker pool, and those that keep the service going."""

from functools import partial
from pathlib import Path
from typing import Any

from flows.config import Settings, load
from flows.demo import DEMO, compare_with_truth
from flows.pipeline import AVATAR
from flows.preflight import preflight
from flows.service.actor import actor_flow
from flows.service.campaign import dataset_flow
from flows.service.examination import case_flow, exam_flow
from flows.service.group import group_flow
from flows.service.joining import helper_flow
from flows.service.order import Scores, Service, unscored
from storage_schemas.store import Store


def scored(actor: str, settings: Any, store: Store) -> Scores:
    """The demo actor has a truth to be compared with."""
    return partial(compare_with_truth, Path(settings.data), store) if actor == DEMO else unscored(actor, settings, store)


SERVICE = Service(AVATAR, Settings, load, scored, preflight)
vision = group_flow(SERVICE, "vision")
tracking = group_flow(SERVICE, "tracking")
simulation = group_flow(SERVICE, "simulation")
rendering = group_flow(SERVICE, "rendering")
helper = helper_flow(SERVICE)
actor = actor_flow(SERVICE)
dataset = dataset_flow(SERVICE)
exam = exam_flow()
case = case_flow()
