"""What effects add to the acceleration of cloth: where they act, before it has answered."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from tasks.cloth.start_state import States
from tasks.cloth.windows import Recording, Window
from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library
from tasks.effects.model import Model
from tasks.gap.acceleration import effect_acceleration
from tasks.gap.gathered import Gathered
from tasks.simulator import Cloth, Collider, Settings
from tests.cloth.test_windows import FABRIC, FPS, swung
from tests.simulator.scenes import NO_COLLIDER, sheet

LIBRARY = library()
T = 9


def recorded(model, x, v, collider=None):
    """A recording of cloth at x [V, 3] m that stays there with velocity v [V, 3] m/s, and the states of its one window."""
    still = np.repeat(x[None], T, 0)
    body = np.zeros((T, 0, 3)) if collider is None else np.repeat(collider[None], T, 0)
    motion = Motion(body, still[:, model.subject.cloth.boundary])
    recording = Recording(model.subject.collider, motion, still, np.full((T, len(x)), 1e-3))
    return Gathered((recording,), (States(still, np.repeat(v[None], T, 0), "converged"),), (Window(0, 0, T - 1),))


def free_sheet(collider=NO_COLLIDER):
    x, faces = sheet(7, 7, length=0.4, width=0.4)
    zone = np.full(len(x), "free")
    return Model(Subject(Cloth(x, faces, np.empty(0, np.int32)), FABRIC, collider, zone, FPS), Settings(substeps=4)), x


def test_damping_of_free_flight_is_its_rate_times_the_velocity():
    model, x = free_sheet()
    damping = LIBRARY["fabric_mass_damping"]
    v = np.tile([0.6, 0.0, -0.8], (len(x), 1))
    found = effect_acceleration(model.joined([damping], {}), recorded(model, x, v), {"fabric_mass_damping": -1.7})
    np.testing.assert_allclose(found, 1.7, rtol=1e-3)


def test_what_drives_the_cloth_is_not_accelerated_by_anything():
    model, recording, x, v = swung(T)
    data = Gathered((recording,), (States(x, v, "converged"),), (Window(0, 0, T - 1),))
    slip = LIBRARY["boundary_slip"]
    found = effect_acceleration(model.joined([slip], {}), data, {"boundary_slip.u": 0.01})
    assert not found[model.subject.cloth.boundary].any()
    row = found.reshape(7, 7).mean(1)
    assert row[1] > 1.0 and (np.diff(row[1:]) < 0).all()  # but the rows that hang from it, the nearer the more


def test_the_steps_of_a_late_window_are_driven_as_the_whole_recording_is(monkeypatch):
    model, recording, x, v = swung(T)
    slip = LIBRARY["boundary_slip"]
    slipping, given = model.joined([slip], {slip.name: np.array([0.02, 0.1])}), []

    def run(self, drive, *_, **options):
        given.append(drive.motion.boundary[0])
        yield SimpleNamespace(index=0)

    monkeypatch.setattr(Model, "run_along", run)
    data = Gathered((recording,), (States(x, v, "converged"),), (Window(0, 3, 4),))
    effect_acceleration(slipping, data, {"boundary_slip.u": 0.02})
    assert np.allclose(given, slipping.driven(recording.motion).boundary[[3, 5]], atol=1e-12)


def test_a_body_pushes_where_it_touches():
    """A sheet that lies on a plate half its size: a larger body lifts what lies on it, and in 2 ms hardly anything else."""
    plate, plate_faces = sheet(5, 5, length=0.2, width=0.2)
    plate = plate - plate.mean(0)
    normal = np.cross(plate[plate_faces[0, 1]] - plate[plate_faces[0, 0]], plate[plate_faces[0, 2]] - plate[plate_faces[0, 0]])
    up = normal / np.linalg.norm(normal)
    model, x = free_sheet(Collider(plate_faces))
    x = x - x.mean(0) + 0.5e-3 * up
    model = replace(model, subject=replace(model.subject, cloth=replace(model.subject.cloth, x_rest=x)))
    offset = LIBRARY["body_offset"]
    data = recorded(model, x, np.zeros_like(x), plate)
    found = effect_acceleration(model.joined([offset], {}), data, {"body_offset": 1e-3})
    over = np.abs(x - x.mean(0)).max(1) < 0.1
    assert found[over].min() > 5 * np.median(found[np.abs(x - x.mean(0)).max(1) > 0.17])


def test_frames_without_a_state_are_left_out_and_none_at_all_is_told():
    model, x = free_sheet()
    damping = LIBRARY["fabric_mass_damping"]
    v = np.tile([1.0, 0.0, 0.0], (len(x), 1))
    data = recorded(model, x, v)
    short = replace(data, states=(States(data.states[0].x[:1], data.states[0].v[:1], "stalled"),))
    strengths = {"fabric_mass_damping": 1.0}
    np.testing.assert_allclose(effect_acceleration(model.joined([damping], {}), short, strengths), 1.0, rtol=1e-3)
    nowhere = replace(data, states=(States(data.states[0].x[:0], data.states[0].v[:0], "stalled"),))
    assert np.isnan(effect_acceleration(model.joined([damping], {}), nowhere, strengths)).all()
