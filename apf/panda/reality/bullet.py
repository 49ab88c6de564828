"""A robot at work in PyBullet: physics, joint control, and a gripper that holds by friction."""

from typing import Annotated

import numpy as np
from pydantic import Field

from apf.panda.geometry import from_vector, inverse, to_vector
from apf.panda.reality.base import Physics, Reality, Rig
from apf.panda.reality.simulated import ARM_FORCES, Simulated
from apf.panda.scene import ARM, FINGERS, HAND, LEFT, RIGHT, TARGET, Scene
from apf.settings import Few, Number, Whole, settings
from apf.towers import BlockSet

AT_REST = 1e-4
"""Blocks whose motion stays below this for two seconds sleep until something comes near them.

The motion is the sum of the squares of all velocities [m/s, rad/s]. What begins to fall soon moves faster.
"""


@settings
class Bullet(Physics):
    """PyBullet."""

    rate: Annotated[Whole, Field(ge=60, le=10000)] = 240
    """Steps in a second."""
    iterations: Few = 200
    """Of the contact solver in each step; with PyBullet's usual 50 towers creep."""
    friction: Annotated[Number, Field(gt=0, le=10)] = 0.6
    """Coefficient of blocks, table and pedestal."""

    def reality(self, rig: Rig) -> Reality:
        """See `Physics.reality`."""
        return BulletReality(self, rig)


class _Bodies(Scene):
    """A scene whose blocks have mass."""

    movable = True


class BulletReality(Simulated):
    """A robot and its table in PyBullet, behind `apf.panda.hardware.Hardware`.

    Args:
        physics: Settings of the simulation.
        rig: Robot, table and cameras.
    """

    def __init__(self, physics: Bullet, rig: Rig) -> None:
        super().__init__(rig.arm, rig.photographer, physics.rate)
        self.physics, self.gripper, self.hold = physics, rig.gripper, rig.hold
        self.scene = _Bodies(rig.layout, rig.wrist, rig.gui)
        self.client = self.scene.client
        self._tied: int | None = None

    def close(self) -> None:
        """Give the clients back."""
        self.scene.close()
        self.photographer.close()

    def put(self, index: int, where: np.ndarray) -> None:
        """A block at a pose [4, 4] of its centre of geometry, at rest."""
        self.scene.put(index, where)
        for body in self.scene.bodies:  # a sleeping block would not notice that its support was taken away
            self.client.changeDynamics(body, -1, activationState=self.client.ACTIVATION_STATE_WAKE_UP)

    def pose_of(self, index: int) -> np.ndarray:
        """[4, 4] of a block's centre of geometry."""
        return self.scene.pose_of(index)

    def grasp_target(self) -> np.ndarray:
        """[4, 4] true pose of the point between the fingertips."""
        state = self.client.getLinkState(self.scene.robot, TARGET, computeForwardKinematics=True)
        return from_vector((*state[4], *state[5]))

    # -- the physics --------------------------------------------------------------------------------------------

    def _begin(self, blocks: BlockSet, friction: np.ndarray, poses: np.ndarray, q: np.ndarray) -> None:
        """See `Simulated`.

        Args:
            blocks: The set as it really is.
            friction: [B] factors of the friction of the blocks.
            poses: [B, 4, 4] of the blocks.
            q: [7] true joints [rad].
        """
        client, scene = self.client, self.scene
        scene.build(blocks, poses, q)
        self._tied = None
        client.setGravity(0, 0, -9.81)
        client.setTimeStep(1 / self.rate)
        client.setPhysicsEngineParameter(numSolverIterations=self.physics.iterations)
        for body in (scene.table, scene.pedestal):
            client.changeDynamics(body, -1, lateralFriction=self.physics.friction)
        for body, factor in zip(scene.bodies, friction):
            client.changeDynamics(
                body,
                -1,
                lateralFriction=float(self.physics.friction * factor),
                # what sleeps costs the solver nothing, and does not creep
                activationState=client.ACTIVATION_STATE_ENABLE_SLEEPING,
                sleepThreshold=AT_REST,
            )
        for finger in FINGERS:
            client.changeDynamics(scene.robot, finger, lateralFriction=self.gripper.friction)
        gear = client.createConstraint(
            scene.robot, LEFT, scene.robot, RIGHT, client.JOINT_GEAR, (1, 0, 0), (0, 0, 0), (0, 0, 0)
        )
        client.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=2 * self.gripper.force)

    def _step(self) -> None:
        self.client.stepSimulation()

    def _joints(self) -> np.ndarray:
        return self.scene.joints()

    def _command(self, q: np.ndarray, velocity: np.ndarray) -> None:
        self.client.setJointMotorControlArray(
            self.scene.robot,
            ARM,
            self.client.POSITION_CONTROL,
            targetPositions=q.tolist(),
            targetVelocities=velocity.tolist(),
            forces=ARM_FORCES,
            positionGains=[0.4] * len(ARM),
            velocityGains=[1.0] * len(ARM),
        )

    def _finger_places(self) -> tuple[float, float]:
        left, right = self.client.getJointStates(self.scene.robot, FINGERS)
        return left[0], right[0]

    def _finger_speed(self) -> float:
        return max(abs(state[1]) for state in self.client.getJointStates(self.scene.robot, FINGERS))

    def _fingers(self, speed: float, share: float = 1.0) -> None:
        self.client.setJointMotorControlArray(
            self.scene.robot,
            FINGERS,
            self.client.VELOCITY_CONTROL,
            targetVelocities=[speed, speed],
            forces=[share * self.gripper.force] * 2,
        )

    def _between_fingers(self) -> int | None:
        robot, touching = self.scene.robot, self.client.getContactPoints
        bodies = enumerate(self.scene.bodies)
        return next((i for i, body in bodies if all(touching(robot, body, finger) for finger in FINGERS)), None)

    def _shift(self, block: int, shift: np.ndarray) -> None:
        body = self.scene.bodies[block]
        (x, y, z), quaternion = self.client.getBasePositionAndOrientation(body)
        velocities = self.client.getBaseVelocity(body)
        self.client.resetBasePositionAndOrientation(body, (x + shift[0], y + shift[1], z), quaternion)
        self.client.resetBaseVelocity(body, *velocities)

    def _on_grip(self, block: int | None) -> None:
        """With hold=constraint, fix the block to the hand as it is held.

        Both frames of a constraint are given at a centre of mass.
        """
        if self.hold != "constraint" or block is None:
            return
        robot, body = self.scene.robot, self.scene.bodies[block]
        state = self.client.getLinkState(robot, HAND, computeForwardKinematics=True)
        hand = from_vector((*state[0], *state[1]))
        position, quaternion = self.client.getBasePositionAndOrientation(body)
        held = to_vector(inverse(hand) @ from_vector((*position, *quaternion)))
        self._tied = self.client.createConstraint(
            robot,
            HAND,
            body,
            -1,
            self.client.JOINT_FIXED,
            (0, 0, 0),
            held[:3].tolist(),
            (0, 0, 0),
            held[3:].tolist(),
            (0, 0, 0, 1),
        )

    def _on_release(self, block: int | None) -> None:
        """Untie the block, and make the next steps find all its contacts anew.

        Bullet keeps contact points from step to step, and their normals in the world's axes. Where a block turns with
        the hand that holds it, old normals come to point along the faces, and the fingers drag the block when they
        open. Contacts are dropped when bodies are apart, so the block is taken away and put back; no time passes.
        """
        if self._tied is not None:
            self.client.removeConstraint(self._tied)
            self._tied = None
        if block is None:
            return
        body = self.scene.bodies[block]
        position, quaternion = self.client.getBasePositionAndOrientation(body)
        linear, angular = self.client.getBaseVelocity(body)
        self.client.resetBasePositionAndOrientation(body, (0, 0, 50 + block), quaternion)
        self.client.performCollisionDetection()
        self.client.resetBasePositionAndOrientation(body, position, quaternion)
        self.client.resetBaseVelocity(body, linear, angular)
        self.wait(0.03)  # contacts are found one by one
