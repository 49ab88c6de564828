"""The simulated robot at work: physics, joint control, and a gripper that holds by friction."""

from collections.abc import Callable
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from apf.panda.geometry import from_vector, inverse, to_vector
from apf.panda.grasps import Gripper
from apf.panda.kinematics import REST
from apf.panda.layout import Layout
from apf.panda.scene import ARM, FINGERS, HAND, LEFT, OPEN, RIGHT, TARGET, Scene
from apf.settings import Few, Number, Whole, settings
from apf.towers import BlockSet

ARM_FORCES = [87.0] * 4 + [12.0] * 3
"""The Panda's largest torques [Nm]."""
FINGER_SPEED = 0.08
"""At which the fingers open and close [m/s]."""
FINGERS_STOPPED = 0.002
"""Slower than this [m/s] they hold something, or each other."""


@settings
class Physics:
    """How the simulation is stepped."""

    rate: Annotated[Whole, Field(ge=60, le=10000)] = 240
    """Steps in a second."""
    iterations: Few = 200
    """Of the contact solver in each step; with PyBullet's usual 50 towers creep."""
    friction: Annotated[Number, Field(gt=0, le=10)] = 0.6
    """Coefficient of blocks, table and pedestal."""


@settings
class Arm:
    """How fast the joints move."""

    speed: Annotated[Number, Field(ge=0.01, le=10)] = 1.5
    """[rad/s] of the fastest joint."""
    acceleration: Annotated[Number, Field(ge=0.01, le=100)] = 6.0
    """[rad/s^2] of the fastest joint."""
    careful: Annotated[Number, Field(ge=0.01, le=10)] = 0.6
    """[rad/s] near blocks: approach, lift, lower, retreat."""


class Reality(Scene):
    """A scene with gravity. Time passes only in `step` and in functions that call `step`.

    Args:
        layout: Places on the table.
        physics: Settings of the simulation.
        arm: Speeds of the joints.
        gripper: What the fingers can hold.
        hold: How the hand holds a block: by friction alone, or tied to the hand, too (constraint).
        gui: Show a window?
    """

    movable = True

    def __init__(
        self,
        layout: Layout,
        physics: Physics,
        arm: Arm,
        gripper: Gripper,
        hold: Literal["friction", "constraint"],
        gui: bool = False,
    ) -> None:
        super().__init__(layout, gui)
        self.physics, self.arm, self.gripper, self.hold = physics, arm, gripper, hold
        self.steps = 0
        self.on_step: Callable[[Reality], None] | None = None
        """Called after every step, e.g. to film."""
        self._held: int | None = None
        self._tied: int | None = None

    @property
    def seconds(self) -> float:
        """Simulated time since the scene was built."""
        return self.steps / self.physics.rate

    def build(self, blocks: BlockSet, poses: np.ndarray, q: np.ndarray = REST) -> None:
        """See `Scene.build`. The arm holds q; nothing moves yet.

        Args:
            blocks: The set.
            poses: [B, 4, 4] of the blocks.
            q: [7] joints [rad].
        """
        super().build(blocks, poses, q)
        self.steps, self._held, self._tied = 0, None, None
        client = self.client
        client.setGravity(0, 0, -9.81)
        client.setTimeStep(1 / self.physics.rate)
        client.setPhysicsEngineParameter(numSolverIterations=self.physics.iterations)
        for body in (self.table, self.pedestal, *self.bodies):
            client.changeDynamics(body, -1, lateralFriction=self.physics.friction)
        for finger in FINGERS:
            client.changeDynamics(self.robot, finger, lateralFriction=self.gripper.friction)
        gear = client.createConstraint(
            self.robot, LEFT, self.robot, RIGHT, client.JOINT_GEAR, (1, 0, 0), (0, 0, 0), (0, 0, 0)
        )
        client.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=2 * self.gripper.force)
        self._command(q, np.zeros_like(q))
        self._fingers(FINGER_SPEED)

    def step(self, n: int = 1) -> None:
        """Let n steps of time pass."""
        for _ in range(n):
            self.client.stepSimulation()
            self.steps += 1
            if self.on_step is not None:
                self.on_step(self)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.step(round(seconds * self.physics.rate))

    # -- the arm ------------------------------------------------------------------------------------------------

    def follow(self, path: np.ndarray, speed: float | None = None) -> None:
        """Drive the joints along a path [M, 7], at most at `speed` [rad/s], with a halt at each sharp corner."""
        for piece in smooth_pieces(np.vstack([self.joints(), path])):
            self._drive(piece, speed or self.arm.speed)

    def _drive(self, piece: np.ndarray, speed: float) -> None:
        lengths = np.abs(np.diff(piece, axis=0)).max(1)
        marks = np.concatenate([[0.0], np.cumsum(lengths)])
        if marks[-1] < 1e-6:
            return
        times, positions = trapezoid(marks[-1], speed, self.arm.acceleration, self.physics.rate)
        path = np.stack([np.interp(positions, marks, joint) for joint in piece.T], axis=1)
        velocities = np.gradient(path, times, axis=0) if len(times) > 1 else np.zeros_like(path)
        velocities[-1] = 0.0
        for q, velocity in zip(path, velocities):
            self._command(q, velocity)
            self.step()

    def _command(self, q: np.ndarray, velocity: np.ndarray) -> None:
        self.client.setJointMotorControlArray(
            self.robot,
            ARM,
            self.client.POSITION_CONTROL,
            targetPositions=q.tolist(),
            targetVelocities=velocity.tolist(),
            forces=ARM_FORCES,
            positionGains=[0.4] * len(ARM),
            velocityGains=[1.0] * len(ARM),
        )

    def grasp_target(self) -> np.ndarray:
        """[4, 4] pose of the point between the fingertips."""
        state = self.client.getLinkState(self.robot, TARGET, computeForwardKinematics=True)
        return from_vector((*state[4], *state[5]))

    # -- the gripper --------------------------------------------------------------------------------------------

    def width(self) -> float:
        """Between the fingers [m]."""
        return sum(state[0] for state in self.client.getJointStates(self.robot, FINGERS))

    def grip(self, block: int) -> None:
        """Close the fingers until they stop, and hold on. With hold=constraint the block is tied to the hand too."""
        self._held = block
        self._fingers(-FINGER_SPEED)
        self.wait(0.1)
        for _ in range(self.physics.rate):
            self.step()
            speeds = [abs(state[1]) for state in self.client.getJointStates(self.robot, FINGERS)]
            if max(speeds) < FINGERS_STOPPED:
                break
        self.wait(0.1)
        if self.hold == "constraint" and self._touches(block):
            self._tie(block)

    def release(self) -> None:
        """Open the fingers, first so gently that both let go together: what they press on must not jump."""
        if self._tied is not None:
            self.client.removeConstraint(self._tied)
            self._tied = None
        if self._held is not None:
            self._forget_contacts(self._held)
            self._held = None
            self.wait(0.03)  # contacts are found one by one
        for share in (0.3, 0.1, 0.03):
            self._fingers(-FINGER_SPEED, share)
            self.wait(0.04)
        self._fingers(FINGER_SPEED / 4)
        self.wait(0.05)
        self._fingers(FINGER_SPEED)
        for _ in range(self.physics.rate):
            self.step()
            if self.width() > 2 * OPEN - 0.001:
                break

    def _forget_contacts(self, block: int) -> None:
        """Make the next step find all contacts of a block anew.

        Bullet keeps contact points from step to step, and their normals in the world's axes. Where a block turns with
        the hand that holds it, old normals come to point along the faces, and the fingers drag the block when they
        open. Contacts are dropped when bodies are apart, so the block is taken away and put back; no time passes.
        """
        body = self.bodies[block]
        position, quaternion = self.client.getBasePositionAndOrientation(body)
        linear, angular = self.client.getBaseVelocity(body)
        self.client.resetBasePositionAndOrientation(body, (0, 0, 50 + block), quaternion)
        self.client.performCollisionDetection()
        self.client.resetBasePositionAndOrientation(body, position, quaternion)
        self.client.resetBaseVelocity(body, linear, angular)

    def _fingers(self, speed: float, share: float = 1.0) -> None:
        self.client.setJointMotorControlArray(
            self.robot,
            FINGERS,
            self.client.VELOCITY_CONTROL,
            targetVelocities=[speed, speed],
            forces=[share * self.gripper.force] * 2,
        )

    def _touches(self, block: int) -> bool:
        return all(self.client.getContactPoints(self.robot, self.bodies[block], finger) for finger in FINGERS)

    def _tie(self, block: int) -> None:
        """Fix the block to the hand as it is held. Both frames of a constraint are given at a centre of mass."""
        state = self.client.getLinkState(self.robot, HAND, computeForwardKinematics=True)
        hand = from_vector((*state[0], *state[1]))
        position, quaternion = self.client.getBasePositionAndOrientation(self.bodies[block])
        held = to_vector(inverse(hand) @ from_vector((*position, *quaternion)))
        self._tied = self.client.createConstraint(
            self.robot,
            HAND,
            self.bodies[block],
            -1,
            self.client.JOINT_FIXED,
            (0, 0, 0),
            held[:3].tolist(),
            (0, 0, 0),
            held[3:].tolist(),
            (0, 0, 0, 1),
        )


def smooth_pieces(path: np.ndarray) -> list[np.ndarray]:
    """A path [M, 7] cut where its direction turns by more than 15 degrees."""
    steps = np.diff(path, axis=0)
    keep = np.concatenate([[True], np.abs(steps).max(1) > 1e-9])
    path = path[keep]
    steps = np.diff(path, axis=0)
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    turns = (directions[1:] * directions[:-1]).sum(1) < np.cos(np.deg2rad(15))
    corners = [0, *(np.flatnonzero(turns) + 1).tolist(), len(path) - 1]
    return [path[a : b + 1] for a, b in pairwise(corners) if b > a]


def trapezoid(length: float, speed: float, acceleration: float, rate: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [M] in steps of 1/rate and places [M] along a line, from rest to rest, ending exactly at `length`.

    Args:
        length: Of the line.
        speed: The largest, in units of the line a second.
        acceleration: In units of the line a second squared.
        rate: Steps in a second.
    """
    peak = min(speed, float(np.sqrt(length * acceleration)))
    ramp = peak / acceleration
    total = length / peak + ramp
    n = max(2, int(np.ceil(total * rate)) + 1)
    times = np.arange(n) / rate
    t = np.minimum(times, total)
    left = total - t
    places = np.where(
        t < ramp,
        acceleration * t**2 / 2,
        np.where(left < ramp, length - acceleration * left**2 / 2, peak * (t - ramp / 2)),
    )
    return times, places
