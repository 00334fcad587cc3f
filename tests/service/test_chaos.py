"""The short form of the chaos run: everything completes or fails with a reason, and the store is clean."""

import pytest

from tests.service.chaos import Chaos, endure, small_disk
from tests.service.place import service

SEQUENCES, KILLS = 8, 6


@pytest.mark.slow
def test_kills_a_frozen_worker_and_a_full_disk_lose_nothing(tmp_path):
    with small_disk(tmp_path / "store", 64) as mounted, service(tmp_path) as supervisor:
        name = supervisor.database

        def chaos(database):
            return Chaos(supervisor, tmp_path / "store", database, KILLS, 1, int(mounted))

        outcome = endure(tmp_path, supervisor, sequences=SEQUENCES, chaos=chaos, database=name)
    assert sum(outcome.kills.values()) >= KILLS // 2
    assert outcome.lost == []
    assert outcome.faults == [] and outcome.duplicates == 0
    assert outcome.stuck == []
