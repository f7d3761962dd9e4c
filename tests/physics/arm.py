"""An arm with physics: MuJoCo on foretrace's own URDF, behind a servo of a stated filter.

Servo, per joint: a target takes effect a controller's cycle after it came; then a reference filter of second order,
w = 2 zeta / delay, exact for targets that go straight within a cycle: with 32 ms at 500 Hz as late as foretrace's own
arm (34 ms); then computed torque with a *nominal* model (pen of 0.3 kg) and a critically damped PD of 20 Hz, half of the
nominal friction compensated, torques clipped to the URDF's limits. The plant adds Coulomb and viscous friction,
reflected rotor inertia, and whatever the case changes. Contacts are springs and dampers of our own at a point, with
Coulomb friction: their stiffness is exactly what is stated, which MuJoCo's soft contacts are not. The tip of a spring
pen is a spring in series.
"""

from dataclasses import dataclass, field

import mujoco
import numpy as np

STEP_S = 0.001
PEN_M = 0.15
COULOMB_NM = np.array([8.0, 8.0, 6.0, 2.0, 2.0, 1.5])
VISCOUS_NMS = np.array([10.0, 10.0, 8.0, 1.5, 1.5, 1.0])
ROTOR_KGM2 = 0.1
BANDWIDTH = 2 * np.pi * 20.0
STRIBECK_RADPS = 0.01
TIP_FRICTION = 0.25


@dataclass
class Wall:
    """A half-space in the plane's frame [m]: `normal` points to where the arm may be, `point` sticks out from tool0."""

    normal: tuple
    at_m: float
    stiffness: float  # N/m
    point_m: tuple = (0.0, 0.0, PEN_M)
    name: str = "paper"


@dataclass
class Push:
    """A force on the tip in the plane's frame [N]."""

    at_s: float
    seconds: float
    force_n: tuple


@dataclass
class Case:
    """What differs from the nominal arm."""

    name: str
    preset: str = "ur5e"
    delay_s: float = 0.032
    zeta: float = 1.0
    cycle_s: float = 0.002
    payload_kg: float = 0.0
    friction: float = 1.0
    torque: float = 1.0
    slow: dict = field(default_factory=dict)  # joint: share of its speed limit
    walls: list = field(default_factory=list)
    pushes: list = field(default_factory=list)
    press_m: float = 0.0  # plane.press_m, with the workspace half a millimetre deeper
    settings: list = field(default_factory=list)  # --set of foretrace


@dataclass
class Plane:
    """The writing plane of a preset: base frame -> plane frame."""

    origin: np.ndarray
    rows: np.ndarray

    def to(self, point):
        return self.rows @ (point - self.origin)


def model(urdf, pen_kg, extra_kg, friction):
    """The URDF as a MuJoCo model with a pen, rotors and friction; without MuJoCo's contacts."""
    spec = mujoco.MjSpec.from_string(urdf)
    spec.compiler.fusestatic = False
    spec.compiler.discardvisual = True
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for joint, coulomb, viscous in zip(spec.joints, COULOMB_NM * friction, VISCOUS_NMS * friction):
        joint.armature = ROTOR_KGM2
        joint.frictionloss = coulomb
        joint.damping[0] = viscous
    tool = spec.body("tool0")
    for mass, at in ((pen_kg, 0.07), (extra_kg, 0.05)):
        if mass > 0:
            load = tool.add_body(pos=[0, 0, at])
            load.mass, load.inertia, load.explicitinertial = mass, [1e-3 * mass] * 3, True
    return spec.compile()


class Arm:
    """One arm, stepped by ticks; `log` has a row a tick."""

    def __init__(self, case, urdf, efforts, speeds, plane, home, period_s):
        self.case, self.plane, self.period_s = case, plane, period_s
        self.plant = model(urdf, 0.3, case.payload_kg, case.friction)
        self.nominal = model(urdf, 0.3, 0.0, 0.0)
        self.real, self.believed = mujoco.MjData(self.plant), mujoco.MjData(self.nominal)
        self.tool = self.plant.body("tool0").id
        self.torque_limit = efforts * case.torque
        self.q = np.array(home)
        self.real.qpos[:] = self.q
        self.reference, self.reference_qd = self.q.copy(), np.zeros(6)
        self.newest = self.target = self.target_before = self.q.copy()
        self.ceiling = speeds * np.array([case.slow.get(joint, np.inf) for joint in range(6)])
        self.integral = np.zeros(6)
        self.ticks, self.t_s = 0, 0.0
        self.every = max(1, round(case.cycle_s / period_s))
        self.group_delay_s = case.delay_s + self.every * period_s
        self.log = []
        mujoco.mj_forward(self.plant, self.real)

    def step(self, q, _qd, enabled):
        """Moves through one tick with the joints [rad] for its end; not enabled: holds the last target."""
        if self.ticks % self.every == 0:
            self.target_before, self.target = self.target, self.newest
            self.newest = np.array(q) if enabled else self.newest
            self.into = 0.0
        self.ticks += 1
        force, saturated, torque, forces = np.zeros(3), 0, np.zeros(6), {}
        count = round(self.period_s / STEP_S)
        for _ in range(count):
            reference_qdd = self.filter()
            torque, clipped = self.servo(reference_qdd)
            saturated |= clipped
            self.real.qfrc_applied[:] = torque
            self.touch(forces)
            mujoco.mj_step(self.plant, self.real)
            self.t_s += STEP_S
        self.q, qd = self.real.qpos.copy(), self.real.qvel.copy()
        mujoco.mj_kinematics(self.plant, self.real)
        tip = self.plane.to(self.point((0, 0, PEN_M)))
        self.log.append((self.t_s, *tip, forces.get("paper", 0.0), forces.get("wall", 0.0), saturated))
        return self.q, qd, torque

    def filter(self):
        """One step of the reference filter; returns its acceleration [rad/s^2]."""
        span = self.every * self.period_s
        slope = (self.target - self.target_before) / span
        start = self.target_before + slope * self.into
        self.into = min(self.into + STEP_S, span)
        if self.case.delay_s <= 0:
            before = self.reference_qd
            self.reference, self.reference_qd = start + slope * STEP_S, slope
            return (slope - before) / STEP_S
        zeta, w, dt = self.case.zeta, 2 * self.case.zeta / self.case.delay_s, STEP_S
        lag = self.case.delay_s * slope
        e, ed = self.reference - (start - lag), self.reference_qd - slope
        if zeta < 1:
            wd, decay = w * np.sqrt(1 - zeta**2), np.exp(-zeta * w * dt)
            c, s = decay * np.cos(wd * dt), decay * np.sin(wd * dt) / wd
        else:
            decay = np.exp(-w * dt)
            c, s = decay, decay * dt
        e, ed = e * c + (ed + zeta * w * e) * s, ed * c - (w * w * e + zeta * w * ed) * s
        before = self.reference_qd
        qd = slope + ed
        slowed = np.abs(qd) > self.ceiling
        limited = np.clip(qd, -self.ceiling, self.ceiling)
        position = start + slope * dt - lag + e
        self.reference = np.where(slowed, self.reference + limited * dt, position)
        self.reference_qd = limited
        return (limited - before) / dt

    def servo(self, reference_qdd):
        """Joint torques [Nm], and whether one is at its limit."""
        q, qd = self.real.qpos, self.real.qvel
        error, error_rate = self.reference - q, self.reference_qd - qd
        self.integral = np.clip(self.integral + 2.0 * error * STEP_S, -0.02, 0.02)
        wanted = reference_qdd + BANDWIDTH**2 * (error + self.integral) + 2 * BANDWIDTH * error_rate
        self.believed.qpos[:], self.believed.qvel[:] = q, qd
        mujoco.mj_fwdPosition(self.nominal, self.believed)
        mujoco.mj_fwdVelocity(self.nominal, self.believed)
        inertia = np.zeros((6, 6))
        mujoco.mj_fullM(self.nominal, self.believed, inertia)
        friction = COULOMB_NM * np.tanh(self.reference_qd / STRIBECK_RADPS) + VISCOUS_NMS * self.reference_qd
        torque = inertia @ wanted + self.believed.qfrc_bias + 0.5 * friction
        limited = np.clip(torque, -self.torque_limit, self.torque_limit)
        return limited, int(np.any(limited != torque))

    def point(self, offset_m):
        """A point that is fixed to tool0 [m], base frame."""
        return self.real.xpos[self.tool] + self.real.xmat[self.tool].reshape(3, 3) @ np.array(offset_m)

    def touch(self, forces):
        """Contacts and pushes, onto the joints; the largest normal force of each in `forces` [N]."""
        velocity, jacobian = np.zeros(3), np.zeros((3, 6))
        for wall in self.case.walls:
            at = self.point(wall.point_m)
            depth = wall.at_m - np.dot(wall.normal, self.plane.to(at))
            if depth <= 0:
                continue
            mujoco.mj_jac(self.plant, self.real, jacobian, None, at, self.tool)
            velocity = self.plane.rows @ (jacobian @ self.real.qvel)
            normal = np.array(wall.normal)
            inwards = -np.dot(normal, velocity)
            # Damped as 0.2 of critical with 3 kg, and never sticky.
            damping = 0.4 * np.sqrt(wall.stiffness * 3.0)
            push = max(0.0, wall.stiffness * depth + damping * inwards)
            slide = velocity + inwards * normal
            drag = -TIP_FRICTION * push * slide / max(np.linalg.norm(slide), 1e-3)
            self.real.qfrc_applied[:] += jacobian.T @ (self.plane.rows.T @ (push * normal + drag))
            forces[wall.name] = max(forces.get(wall.name, 0.0), push)
        for push in self.case.pushes:
            if push.at_s <= self.t_s < push.at_s + push.seconds:
                at = self.point((0, 0, PEN_M))
                mujoco.mj_jac(self.plant, self.real, jacobian, None, at, self.tool)
                self.real.qfrc_applied[:] += jacobian.T @ (self.plane.rows.T @ np.array(push.force_n))
