"""A robot at work in MuJoCo: physics, joint control, and a gripper that holds by friction."""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from apf.errors import InputError
from apf.panda.geometry import from_vector, inverse, pose, to_vector
from apf.panda.reality.base import Physics, Reality, Rig
from apf.panda.reality.simulated import ARM_FORCES, Simulated
from apf.panda.scene import OPEN
from apf.settings import Few, Number, Whole, settings
from apf.towers import BlockSet

try:
    import mujoco

    from apf.panda.reality.mujoco_model import (
        ARM_JOINTS,
        DAMPING,
        FINGER_BODIES,
        FINGER_JOINTS,
        HAND,
        STIFFNESS,
        TARGET,
        Contacts,
        block_name,
        spec_of,
    )
except ImportError as error:
    raise ImportError(f"this physics needs {error.name}: pip install 'apf[mujoco]'") from None

ARM, FINGERS = slice(0, 7), slice(7, 9)
"""Of the actuators; of places and velocities, too: the robot is the first body."""
ARRIVED = 0.002
"""A motion has ended when no joint turns faster than this [rad/s],"""
ARRIVING = 0.2
"""and after this time at the latest [s]."""


@settings
class Mujoco(Physics):
    """MuJoCo: its contacts are a little soft, and nothing that stands creeps. Needs `pip install "apf[mujoco]"`."""

    rate: Annotated[Whole, Field(ge=100, le=10000)] = 800
    """Steps in a second."""
    iterations: Few = 100
    """Of the contact solver in each step, at most."""
    friction: Annotated[Number, Field(gt=0, le=10)] = 0.6
    """Coefficient of blocks, table and pedestal; a contact has the product of both bodies' coefficients."""
    contact: Annotated[Number, Field(ge=0.001, le=1)] = 0.003
    """Time in which two bodies that overlap are pushed apart [s]; at least two steps."""
    grip: Annotated[Number, Field(ge=1, le=1000)] = 10.0
    """How much stiffer friction is than the contact itself: with 1, what is held slowly slips."""

    @model_validator(mode="after")
    def _two_steps(self) -> "Mujoco":
        if self.contact < 2 / self.rate:
            raise ValueError(f"contact={self.contact:g} is less than two steps of 1/{self.rate} s")
        return self

    def reality(self, rig: Rig) -> Reality:
        """See `Physics.reality`."""
        return MujocoReality(self, rig)


class MujocoReality(Simulated):
    """A robot and its table in MuJoCo, behind `apf.panda.hardware.Hardware`.

    Args:
        physics: Settings of the simulation.
        rig: Robot, table and cameras.
    """

    def __init__(self, physics: Mujoco, rig: Rig) -> None:
        if rig.gui:
            raise InputError("gui=true: MuJoCo's reality has no window; choose world/reality=bullet")
        super().__init__(rig.arm, rig.photographer, physics.rate)
        self.layout, self.wrist = rig.layout, rig.wrist
        self.physics, self.gripper, self.hold = physics, rig.gripper, rig.hold

    def close(self) -> None:
        """Give everything back."""
        self.photographer.close()

    def put(self, index: int, where: np.ndarray) -> None:
        """A block at a pose [4, 4] of its centre of geometry, at rest."""
        x, y, z, qx, qy, qz, qw = to_vector(where)
        joint = self.data.joint(block_name(index))
        joint.qpos[:] = (x, y, z, qw, qx, qy, qz)
        joint.qvel[:] = 0.0

    def pose_of(self, index: int) -> np.ndarray:
        """[4, 4] of a block's centre of geometry."""
        x, y, z, qw, qx, qy, qz = self.data.joint(block_name(index)).qpos
        return from_vector((x, y, z, qx, qy, qz, qw))

    def follow(self, path: np.ndarray, speed: float) -> None:
        """See `Hardware.follow`. The motors are springs: the arm comes to rest a moment after its last command."""
        super().follow(path, speed)
        for _ in range(round(ARRIVING * self.rate)):
            if np.abs(self.data.qvel[ARM]).max() < ARRIVED:
                break
            self.step()

    def grasp_target(self) -> np.ndarray:
        """[4, 4] true pose of the point between the fingertips."""
        return self._frame(TARGET)

    # -- the physics --------------------------------------------------------------------------------------------

    def _begin(self, blocks: BlockSet, friction: np.ndarray, poses: np.ndarray, q: np.ndarray) -> None:
        """See `Simulated`.

        Args:
            blocks: The set as it really is.
            friction: [B] factors of the friction of the blocks.
            poses: [B, 4, 4] of the blocks.
            q: [7] true joints [rad].
        """
        physics = self.physics
        surfaces = Contacts(
            blocks=physics.friction * friction,
            others=physics.friction,
            fingers=self.gripper.friction,
            settling=physics.contact,
            stopping=2 / physics.rate,
        )
        spec = spec_of(self.layout, self.wrist, blocks, surfaces, ARM_FORCES)
        option = spec.option
        option.timestep, option.iterations = 1 / physics.rate, physics.iterations
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, physics.grip
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        assert [self.model.joint(name).qposadr[0] for name in (*ARM_JOINTS, *FINGER_JOINTS)] == list(range(9))
        self.data.qpos[ARM], self.data.qpos[FINGERS] = q, OPEN
        for index, where in enumerate(poses):
            self.put(index, where)
        self._blocks_of = {self.model.geom(block_name(i)).id: i for i in range(len(blocks))}
        fingers = [self.model.body(name).id for name in FINGER_BODIES]
        self._finger_of = {g: f for g, body in enumerate(self.model.geom_bodyid) for f in fingers if body == f}

    def _step(self) -> None:
        mujoco.mj_step(self.model, self.data)

    def _joints(self) -> np.ndarray:
        return self.data.qpos[ARM].copy()

    def _command(self, q: np.ndarray, velocity: np.ndarray) -> None:
        self.data.ctrl[ARM] = q + velocity * np.divide(DAMPING, STIFFNESS)

    def _finger_places(self) -> tuple[float, float]:
        left, right = self.data.qpos[FINGERS].tolist()
        return left, right

    def _finger_speed(self) -> float:
        return float(np.abs(self.data.qvel[FINGERS]).max())

    def _fingers(self, speed: float, share: float = 1.0) -> None:
        self.data.ctrl[FINGERS] = speed
        self.model.actuator_forcerange[FINGERS] = np.array([-1.0, 1.0]) * share * self.gripper.force

    def _between_fingers(self) -> int | None:
        touching: dict[int, set[int]] = {}
        for pair in self.data.contact.geom.tolist():
            for one, other in (pair, pair[::-1]):
                if one in self._blocks_of and other in self._finger_of:
                    touching.setdefault(self._blocks_of[one], set()).add(self._finger_of[other])
        return next((block for block in sorted(touching) if len(touching[block]) == 2), None)

    def _shift(self, block: int, shift: np.ndarray) -> None:
        self.data.joint(block_name(block)).qpos[:2] += shift

    def _on_grip(self, block: int | None) -> None:
        """With hold=constraint, fix the block to the hand as it is held."""
        if self.hold == "constraint" and block is not None:
            x, y, z, qx, qy, qz, qw = to_vector(inverse(self._frame(HAND)) @ self.pose_of(block))
            weld = self._weld(block)
            self.model.eq_data[weld, :10] = (0, 0, 0, x, y, z, qw, qx, qy, qz)
            self.data.eq_active[weld] = 1

    def _on_release(self, block: int | None) -> None:
        if self.hold == "constraint" and block is not None:
            self.data.eq_active[self._weld(block)] = 0

    def _weld(self, block: int) -> int:
        return self.model.neq - len(self.real) + block

    def _frame(self, body: str) -> np.ndarray:
        """[4, 4] of a body, where the joints are now."""
        mujoco.mj_kinematics(self.model, self.data)
        frame = self.data.body(body)
        return pose(frame.xpos, frame.xmat.reshape(3, 3))
