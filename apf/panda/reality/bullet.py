"""A robot at work in PyBullet: physics, joint control, and a gripper that holds by friction."""

from collections.abc import Callable, Collection
from typing import Literal

import numpy as np

from apf.panda.flaws import Drawn
from apf.panda.geometry import from_vector, inverse, to_vector
from apf.panda.grasps import Gripper
from apf.panda.hardware import Image
from apf.panda.kinematics import REST
from apf.panda.layout import Layout
from apf.panda.reality.base import Bullet
from apf.panda.reality.photographer import Photographer, State
from apf.panda.reality.profile import motion_along
from apf.panda.scene import ARM, FINGERS, HAND, LEFT, OPEN, RIGHT, TARGET, Scene
from apf.panda.settings import Arm
from apf.panda.vision.cameras import WristCamera
from apf.towers import BlockSet

ARM_FORCES = [87.0] * 4 + [12.0] * 3
"""The Panda's largest torques [Nm]."""
FINGER_SPEED = 0.08
"""At which the fingers open and close [m/s]."""
FINGERS_STOPPED = 0.002
"""Slower than this [m/s] they hold something, or each other."""


class BulletReality(Scene):
    """A scene with gravity, behind `apf.panda.hardware.Hardware`. Time passes only in `step` and what calls it.

    Joints are said and taken as the robot measures them; `drawn.zeros` are between these and the true ones.

    Args:
        layout: Places on the table.
        physics: Settings of the simulation.
        arm: Speeds of the joints.
        gripper: What the fingers can hold.
        hold: How the hand holds a block: by friction alone, or tied to the hand, too (constraint).
        photographer: Takes the images; it knows the flaws of this robot.
        wrist: The camera on the hand.
        gui: Show a window?
    """

    movable = True

    def __init__(
        self,
        layout: Layout,
        physics: Bullet,
        arm: Arm,
        gripper: Gripper,
        hold: Literal["friction", "constraint"],
        photographer: Photographer,
        wrist: WristCamera,
        gui: bool = False,
    ) -> None:
        super().__init__(layout, wrist, gui)
        self.physics, self.arm, self.gripper, self.hold = physics, arm, gripper, hold
        self.photographer = photographer
        self.steps = 0
        self.on_step: Callable[[BulletReality], None] | None = None
        """Called after every step, e.g. to film."""
        self._held: int | None = None
        self._tied: int | None = None

    @property
    def drawn(self) -> Drawn:
        """The flaws of this robot."""
        return self.photographer.drawn

    @property
    def rate(self) -> int:
        """Steps in a second."""
        return self.physics.rate

    def close(self) -> None:
        """Give the clients back."""
        super().close()
        self.photographer.close()

    def begin(self, blocks: BlockSet, poses: np.ndarray, rng: np.random.Generator) -> None:
        """Begin anew: the arm at rest, its gripper open, and each block at its pose; nothing moves yet.

        Args:
            blocks: The set, as its file says.
            poses: [B, 4, 4] of the blocks.
            rng: The source of the noise of images, and of how blocks jump when they are let go.
        """
        self.rng, self.known = rng, blocks
        self.build(self.drawn.blocks(blocks), poses, REST + self.drawn.zeros)
        self.steps, self._held, self._tied = 0, None, None
        client = self.client
        client.setGravity(0, 0, -9.81)
        client.setTimeStep(1 / self.physics.rate)
        client.setPhysicsEngineParameter(numSolverIterations=self.physics.iterations)
        for body in (self.table, self.pedestal):
            client.changeDynamics(body, -1, lateralFriction=self.physics.friction)
        for body, factor in zip(self.bodies, self.drawn.friction(blocks)):
            client.changeDynamics(body, -1, lateralFriction=float(self.physics.friction * factor))
        for finger in FINGERS:
            client.changeDynamics(self.robot, finger, lateralFriction=self.gripper.friction)
        gear = client.createConstraint(
            self.robot, LEFT, self.robot, RIGHT, client.JOINT_GEAR, (1, 0, 0), (0, 0, 0), (0, 0, 0)
        )
        client.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=2 * self.gripper.force)
        self._command(REST, np.zeros_like(REST))
        self._fingers(FINGER_SPEED)

    def step(self, n: int = 1) -> None:
        """Let n steps of time pass."""
        for _ in range(n):
            self.client.stepSimulation()
            self.steps += 1
            if self.on_step is not None:
                self.on_step(self)

    def state(self) -> State:
        """How things really are."""
        fingers = tuple(position for position, *_ in self.client.getJointStates(self.robot, FINGERS))
        return State(self.poses(), super().joints(), fingers, self.grasp_target())

    # -- clock and cameras --------------------------------------------------------------------------------------

    def seconds(self) -> float:
        """Simulated time since the scene was built."""
        return self.steps / self.physics.rate

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.step(round(seconds * self.physics.rate))

    def images(self, names: Collection[str]) -> dict[str, Image]:
        """See `Hardware.images`."""
        return self.photographer.images(names, self.known, self.state(), self.rng)

    # -- the arm ------------------------------------------------------------------------------------------------

    def joints(self) -> np.ndarray:
        """[7] of the arm, as it measures them [rad]."""
        return super().joints() - self.drawn.zeros

    def follow(self, path: np.ndarray, speed: float) -> None:
        """See `Hardware.follow`."""
        whole = np.vstack([self.joints(), path])
        for joints, velocities in motion_along(whole, speed, self.arm.acceleration, self.physics.rate):
            for q, velocity in zip(joints, velocities):
                self._command(q, velocity)
                self.step()

    def _command(self, q: np.ndarray, velocity: np.ndarray) -> None:
        self.client.setJointMotorControlArray(
            self.robot,
            ARM,
            self.client.POSITION_CONTROL,
            targetPositions=(q + self.drawn.zeros).tolist(),
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

    def grip(self) -> None:
        """Close the fingers until they stop, and hold on. With hold=constraint a block between them is tied, too."""
        self._fingers(-FINGER_SPEED)
        self.wait(0.1)
        for _ in range(self.physics.rate):
            self.step()
            speeds = [abs(state[1]) for state in self.client.getJointStates(self.robot, FINGERS)]
            if max(speeds) < FINGERS_STOPPED:
                break
        self.wait(0.1)
        self._held = next((i for i, body in enumerate(self.bodies) if self._touches(body)), None)
        if self.hold == "constraint" and self._held is not None:
            self._tie(self._held)

    def release(self) -> None:
        """Open the fingers, first so gently that both let go together: what they press on must not jump."""
        if self._tied is not None:
            self.client.removeConstraint(self._tied)
            self._tied = None
        held, self._held = self._held, None
        if held is not None:
            self._forget_contacts(held)
            self.wait(0.03)  # contacts are found one by one
        for share in (0.3, 0.1, 0.03):
            self._fingers(-FINGER_SPEED, share)
            self.wait(0.04)
        self._fingers(FINGER_SPEED / 4)
        self.wait(0.05)
        if held is not None:
            self._slide(held)
        self._fingers(FINGER_SPEED)
        for _ in range(self.physics.rate):
            self.step()
            if self.width() > 2 * OPEN - 0.001:
                break

    def _slide(self, block: int) -> None:
        """Move a block that was let go by what this robot's flaws say."""
        assert self.blocks is not None
        where = self.pose_of(block)
        com = where[:3, :3] @ self.blocks.com[block]
        shift = self.drawn.on_release(com, self.grasp_target()[:3, 1], self.rng)
        if not shift.any():
            return
        body = self.bodies[block]
        position, quaternion = self.client.getBasePositionAndOrientation(body)
        velocities = self.client.getBaseVelocity(body)
        shifted = (position[0] + shift[0], position[1] + shift[1], position[2])
        self.client.resetBasePositionAndOrientation(body, shifted, quaternion)
        self.client.resetBaseVelocity(body, *velocities)

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

    def _touches(self, body: int) -> bool:
        return all(self.client.getContactPoints(self.robot, body, finger) for finger in FINGERS)

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
