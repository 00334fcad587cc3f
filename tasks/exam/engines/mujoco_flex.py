"""MuJoCo moves the cloth: a two-dimensional flex beside capsules. Runs alone, where MuJoCo is installed; knows nothing of the project.

    python mujoco_flex.py JOB.npz OUT.npz [BESIDE.npz]

JOB (V vertices, B of them driven, K capsules on bones, N ticks of `tick` s, arrays without pickles):

    rest [V, 3] m without stress, faces [F, 3], mass [V] kg, stretch E·t N/m, bending B N·m, poisson, start [V, 3] m
    driven [B], places [N+1, B, 3] m; a, b [K, 3] m, radius [K] m, bone [K]; turns [N+1, bones, 3, 3], shifts [N+1, bones, 3] m
    friction, gravity [3] m/s², damping 1/s, settling s, every (ticks per frame), tick s
    normal_drag, tangential_drag C_d [1], linear_drag N s/m³, wind [3] m/s, wind_drag C_d [1], gusts m/s, pressure Pa

OUT: x [T, V, 3] m at every frame; step s; sunk m, the deepest that a body was entered; with BESIDE also change [V] m/s², the root mean
square over frames of the difference of accelerations between the laws of JOB and of BESIDE at the same places and speeds.

The cloth is MuJoCo's: Saint Venant-Kirchhoff membrane and hinges on linear triangles, soft contacts of its convex solver with elliptic
friction cones, symplectic Euler in steps far below the cloth's fastest period (no numerical damping, no implicit solve). MuJoCo has no air
for a flex: forces of the air act on vertices, from here. It allows no flex on bodies that are moved by hand, so driven vertices and bones
are heavy bodies whose place and speed are set before every step.
"""

import sys
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

AIR = 1.2  # kg/m³
HEAVY, BONE = 1.0, 1e3  # kg: what is driven hardly moves within a step, whatever pulls at it
RADIUS = 0.5e-3  # m: half the cloth as its contacts see it
SOFT = 1e-3  # s: how fast a contact gives way and comes back
SHARE = 0.4  # of the longest stable step
LONGEST = 2.5e-4  # s
BRAKE = 10.0  # 1/s while it settles
LOST = [int(mujoco.mjtWarning.__members__[f"mjWARN_BAD{what}"]) for what in ("QPOS", "QVEL", "QACC")]
AIRED = 1e-3  # s between two looks at the air: drag changes over tens of milliseconds


class World:
    """A job as a MuJoCo model, its state, and what drives it."""

    def __init__(self, job: Mapping[str, Any], step: float | None = None) -> None:
        self.job = {k: np.asarray(v) for k, v in job.items()}
        self.bones = self.job["turns"].shape[1]
        self.model = mujoco.MjModel.from_xml_string(_xml(self.job, self.bones))
        self.data = mujoco.MjData(self.model)
        self.vertices = 3 * len(self.job["rest"])  # degrees of freedom of the cloth; those of the bones come after
        self.damp(float(self.job["damping"]))
        self.driven = (3 * self.job["driven"][:, None] + np.arange(3)).ravel()
        self.place(self.job["start"], np.zeros_like(self.job["start"]), 0.0)
        per_tick = int(np.ceil(float(self.job["tick"]) / (step or self.stable_step())))
        self.model.opt.timestep = float(self.job["tick"]) / per_tick
        self.per_tick = per_tick

    @property
    def x(self) -> np.ndarray:
        """Places of the vertices [V, 3] m."""
        return self.job["rest"] + self.data.qpos[: self.vertices].reshape(-1, 3)

    @property
    def v(self) -> np.ndarray:
        """Velocities of the vertices [V, 3] m/s."""
        return self.data.qvel[: self.vertices].reshape(-1, 3)

    def place(self, x: np.ndarray, v: np.ndarray, tick: float) -> None:
        """Put the cloth at x with velocity v, and what is driven where it is at `tick` (with a fraction)."""
        self.data.qpos[: self.vertices] = (x - self.job["rest"]).ravel()
        self.data.qvel[: self.vertices] = v.ravel()
        self.drive(tick, moving=True)

    def drive(self, tick: float, *, moving: bool) -> None:
        """Set place and speed of everything driven at `tick`; speed is that of the way to the next one, or nil."""
        k = min(int(tick + 1e-9), len(self.job["places"]) - 2)
        share, rate = tick - k, float(moving) / float(self.job["tick"])
        p, q = self.job["places"][k], self.job["places"][k + 1]
        self.data.qpos[self.driven] = (p + share * (q - p) - self.job["rest"][self.job["driven"]]).ravel()
        self.data.qvel[self.driven] = (rate * (q - p)).ravel()
        for bone in range(self.bones):
            R, S = self.job["turns"][k, bone], self.job["turns"][k + 1, bone]
            turn = _axis_angle(R.T @ S)  # in the bone's own frame, as MuJoCo has the spin of a free body
            at = self.vertices + 7 * bone
            shift, next_shift = self.job["shifts"][k, bone], self.job["shifts"][k + 1, bone]
            self.data.qpos[at : at + 3] = shift + share * (next_shift - shift)
            self.data.qpos[at + 3 : at + 7] = _quaternion(R @ _rotation(share * turn))
            dof = self.vertices + 6 * bone
            self.data.qvel[dof : dof + 3] = rate * (next_shift - shift)
            self.data.qvel[dof + 3 : dof + 6] = rate * turn

    def settle(self) -> None:
        """Let the cloth come to rest at the first tick, under heavy damping, with everything held."""
        self.damp(BRAKE)
        for _ in range(int(float(self.job["settling"]) / float(self.job["tick"]))):
            self._tick(0.0, moving=False)
        self.damp(float(self.job["damping"]))
        self.data.qvel[:] = 0
        self.data.time = 0.0

    def damp(self, rate: float) -> None:
        """Damping of all motion of the cloth, `rate` [1/s] times its mass; MuJoCo's compiler refuses it on a flex, its integrator does not."""
        self.model.dof_damping[: self.vertices] = rate * np.repeat(self.job["mass"], 3)

    def advance(self, tick: int) -> None:
        """From one tick to the next."""
        self._tick(float(tick), moving=True)

    def _tick(self, tick: float, *, moving: bool) -> None:
        look = max(1, int(AIRED / self.model.opt.timestep))
        for step in range(self.per_tick):
            now = tick + (step / self.per_tick if moving else 0.0)
            self.drive(now, moving=moving)
            if step % look == 0:
                self.blow(now * float(self.job["tick"]))
            mujoco.mj_step(self.model, self.data)
        if not np.isfinite(self.data.qpos).all() or self.data.warning.number[LOST].any():
            raise ArithmeticError(f"MuJoCo lost the cloth at {self.data.time:.3f} s")

    def blow(self, t: float) -> None:
        """Forces of the air on the vertices, from their normals, areas and velocities."""
        job, x, v = self.job, self.x, self.v
        if not self.aired:
            return
        twice = np.cross(x[job["faces"][:, 1]] - x[job["faces"][:, 0]], x[job["faces"][:, 2]] - x[job["faces"][:, 0]])
        third = np.repeat(twice / 6, 3, axis=0)
        normal = np.stack([np.bincount(job["faces"].ravel(), third[:, c], minlength=len(x)) for c in range(3)], 1)
        area = np.bincount(job["faces"].ravel(), np.linalg.norm(third, axis=1), minlength=len(x))
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        self.data.qfrc_applied[: self.vertices] = (area[:, None] * _air(job, x, v, normal, t)).ravel()

    @property
    def aired(self) -> bool:
        """Whether the air does anything."""
        return any(np.any(self.job[name]) for name in ("normal_drag", "tangential_drag", "linear_drag", "wind", "gusts", "pressure"))

    def acceleration(self, x: np.ndarray, v: np.ndarray, tick: float) -> np.ndarray:
        """Accelerations [V, 3] m/s² that the laws of this world give the cloth at x with velocity v."""
        self.place(x, v, tick)
        self.blow(tick * float(self.job["tick"]))
        mujoco.mj_forward(self.model, self.data)
        return self.data.qacc[: self.vertices].reshape(-1, 3).copy()

    def stable_step(self) -> float:
        """A share of 2/ω of the stiffest mode, found by power iteration on the elastic forces; s."""
        flags, self.model.opt.disableflags = self.model.opt.disableflags, int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        start, ε = self.data.qpos[: self.vertices].copy(), 1e-7
        free = np.ones(self.vertices, bool)
        free[self.driven] = False
        u = np.random.default_rng(0).normal(size=self.vertices) * free
        at_rest = self._elastic(start)
        mass = np.repeat(self.job["mass"], 3)
        for _ in range(40):
            u /= np.abs(u).max()
            u = -(self._elastic(start + ε * u) - at_rest) / (ε * mass) * free
        self.data.qpos[: self.vertices] = start
        self.model.opt.disableflags = flags
        if not np.isfinite(u).all():
            raise ArithmeticError("MuJoCo cannot place the cloth")
        return min(LONGEST, SHARE * 2 / np.sqrt(np.abs(u).max()))

    def _elastic(self, q: np.ndarray) -> np.ndarray:
        self.data.qpos[: self.vertices] = q
        mujoco.mj_forward(self.model, self.data)
        return self.data.qfrc_passive[: self.vertices].copy()


def simulate(job: Mapping[str, Any], beside: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """What the module's head promises. Raises ArithmeticError where MuJoCo loses the cloth."""
    world = World(job)
    other = None if beside is None else World(beside, world.model.opt.timestep)
    world.settle()
    every, last = int(world.job["every"]), len(world.job["places"]) - 1
    frames, squares, sunk = [], np.zeros(len(world.job["rest"])), 0.0
    for tick in range(last + 1):
        if tick % every == 0:
            frames.append(world.x.copy())
            sunk = max(sunk, -min([c.dist for c in world.data.contact], default=0.0))
            if other is not None and tick < last:
                x, v = world.x.copy(), world.v.copy()
                here = world.acceleration(x, v, tick)
                squares += np.sum((here - other.acceleration(x, v, tick)) ** 2, 1)
        if tick < last:
            world.advance(tick)
    out = {"x": np.stack(frames), "step": world.model.opt.timestep, "sunk": sunk}
    return out if other is None else out | {"change": np.sqrt(squares / len(frames))}


def _air(job: Mapping[str, np.ndarray], x: np.ndarray, v: np.ndarray, n: np.ndarray, t: float) -> np.ndarray:
    """Force per area [V, 3] N/m²; n [V, 3] unit normals."""
    u = np.sum(v * n, 1, keepdims=True)
    along = v - u * n
    p = -0.5 * AIR * job["normal_drag"] * np.abs(u) * u * n - job["linear_drag"] * u * n + job["pressure"] * n
    p = p - 0.5 * AIR * job["tangential_drag"] * np.linalg.norm(along, axis=1, keepdims=True) * along
    blown = job["wind"] + _gust(float(job["gusts"]), x, t)
    w = u - np.sum(blown * n, 1, keepdims=True)  # what blows adds to what still air does, which is the base's
    return p - 0.5 * AIR * job["wind_drag"] * (np.abs(w) * w - np.abs(u) * u) * n


def _gust(speed: float, x: np.ndarray, t: float) -> np.ndarray:
    """Puffs [V, 3] m/s that travel along x + z."""
    phase = 2 * np.pi * (1.4 * t - (x[:, 0] + x[:, 2]))
    return speed * np.maximum(np.sin(phase), 0)[:, None] ** 2 * np.cos(2 * np.pi * 0.7 * t) * np.array([0.7, 0, 0.7])


def _xml(job: Mapping[str, np.ndarray], bones: int) -> str:
    """The model: one body with three slides per vertex, one free body per bone with its capsules, one flex."""
    driven = set(job["driven"].tolist())
    slides = "".join(f"<joint type='slide' axis='{axis}'/>" for axis in ("1 0 0", "0 1 0", "0 0 1"))
    nodes = "".join(
        f"<body name='v{i}' pos='{_text(p)}' gravcomp='{int(i in driven)}'><inertial pos='0 0 0' mass='{HEAVY if i in driven else m:.9g}' "
        f"diaginertia='1e-9 1e-9 1e-9'/>{slides}</body>"
        for i, (p, m) in enumerate(zip(job["rest"], job["mass"], strict=True))
    )
    limbs = "".join(
        f"<body gravcomp='1'><freejoint/><inertial pos='0 0 0' mass='{BONE}' diaginertia='{BONE} {BONE} {BONE}'/>"
        + "".join(_capsule(job, k) for k in np.flatnonzero(job["bone"] == bone))
        + "</body>"
        for bone in range(bones)
    )
    stretch, bending, ν = float(job["stretch"]), float(job["bending"]), float(job["poisson"])
    thickness = np.sqrt(12 * (1 - ν**2) * bending / stretch)  # E·t and E·t³/12(1 − ν²) as asked for
    return (
        f"<mujoco><option integrator='Euler' solver='Newton' cone='elliptic' gravity='{_text(job['gravity'])}'><flag autoreset='disable'/></option><size memory='400M'/>"
        f"<worldbody>{nodes}{limbs}</worldbody><deformable><flex name='cloth' dim='2' radius='{RADIUS}' "
        f"body='{' '.join(f'v{i}' for i in range(len(job['rest'])))}' element='{' '.join(map(str, job['faces'].ravel()))}'>"
        f"<elasticity young='{stretch / thickness:.9g}' poisson='{ν}' thickness='{thickness:.9g}' elastic2d='both'/>"
        f"<contact selfcollide='none' contype='0' conaffinity='1' condim='3' friction='{float(job['friction']):.9g} 0 0' solref='{SOFT} 1'/>"
        "</flex></deformable></mujoco>"
    )


def _capsule(job: Mapping[str, np.ndarray], k: int) -> str:
    a, b, r = job["a"][k], job["b"][k], float(job["radius"][k])
    shape = (
        f"type='sphere' pos='{_text(a)}' size='{r:.9g}'"
        if np.allclose(a, b)
        else f"type='capsule' fromto='{_text(a)} {_text(b)}' size='{r:.9g}'"
    )
    return f"<geom {shape} contype='1' conaffinity='0' condim='3' friction='{float(job['friction']):.9g} 0 0' solref='{SOFT} 1'/>"


def _text(values: np.ndarray) -> str:
    return " ".join(f"{v:.9g}" for v in values)


def _rotation(r: np.ndarray) -> np.ndarray:
    """Rotation matrix of an axis times an angle."""
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, _of_axis_angle(r))
    return out.reshape(3, 3)


def _of_axis_angle(r: np.ndarray) -> np.ndarray:
    angle, out = float(np.linalg.norm(r)), np.empty(4)
    mujoco.mju_axisAngle2Quat(out, r / angle if angle > 1e-12 else np.array([1.0, 0, 0]), angle)
    return out


def _quaternion(R: np.ndarray) -> np.ndarray:
    out = np.empty(4)
    mujoco.mju_mat2Quat(out, R.ravel())
    return out


def _axis_angle(R: np.ndarray) -> np.ndarray:
    out = np.empty(3)
    mujoco.mju_quat2Vel(out, _quaternion(R), 1.0)
    return out


if __name__ == "__main__":
    files = [dict(np.load(name, allow_pickle=False)) for name in (sys.argv[1], *sys.argv[3:])]
    try:
        np.savez(sys.argv[2], **simulate(*files))
    except ArithmeticError as lost:
        sys.stderr.write(f"{lost}\n")
        sys.exit(3)  # what the caller knows it by
