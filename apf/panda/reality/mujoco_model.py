"""The bodies of MuJoCo's reality: table, pedestal, arm and blocks, and which of them can touch."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from xml.etree import ElementTree

import mujoco
import numpy as np

from apf.panda.layout import Layout
from apf.panda.model import urdf
from apf.panda.scene import TABLE_THICKNESS
from apf.panda.vision.cameras import WristCamera
from apf.towers import BlockSet

ARM_JOINTS = [f"panda_joint{i}" for i in range(1, 8)]
FINGER_JOINTS = ["panda_finger_joint1", "panda_finger_joint2"]
FINGER_BODIES = ["panda_leftfinger", "panda_rightfinger"]
BASE, HAND, TARGET = "panda_link0", "panda_hand", "panda_grasptarget"

STIFFNESS = [8000.0] * 4 + [4000.0] * 3
"""Torque of a motor for an error of its joint [Nm/rad],"""
DAMPING = [400.0] * 4 + [120.0] * 3
"""and of its velocity [Nm s/rad]."""
ROTOR = 0.1
"""Inertia that a motor adds to its joint [kg m^2]."""
FINGER_DAMPING = 1000.0
"""Force of a finger's motor for an error of the finger's velocity [N s/m]."""
FINGER_ROTOR = 1.0
"""Mass that a motor adds to its finger [kg]."""
HARDNESS = (0.95, 0.99, 0.001, 0.5, 2.0)
"""MuJoCo's solimp of contacts,"""
TIED = (0.999, 0.9999, 0.001, 0.5, 2.0)
"""and of a block that is tied to the hand."""


def block_name(index: int) -> str:
    """Of the body and joint of a block."""
    return f"block_{index}"


@dataclass(frozen=True, eq=False)
class Contacts:
    """How bodies touch. A contact has the product of both bodies' coefficients of friction.

    blocks: [B] coefficients of the blocks. others: Of table, pedestal and arm. fingers: Of the fingers' pads. settling:
    Time in which two bodies that overlap are pushed apart [s]. stopping: Time in which friction stops what slides [s];
    what is held by a hand that turns slips in proportion to it.
    """

    blocks: np.ndarray
    others: float
    fingers: float
    settling: float
    stopping: float


def spec_of(
    layout: Layout, wrist: WristCamera, blocks: BlockSet, contacts: Contacts, forces: Sequence[float]
) -> mujoco.MjSpec:
    """All bodies. Actuators: the seven motors of the arm, then those of the fingers. Equalities: fingers, then blocks.

    Args:
        layout: Places on the table.
        wrist: The camera on the hand.
        blocks: The set as it really is.
        contacts: How bodies touch.
        forces: [7] largest torques of the arm's motors [Nm].
    """
    spec = _robot(wrist)
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0
    _add_motors(spec, forces)
    shapes = _arm_shapes(spec)
    arm = {name: contacts.fingers if body in FINGER_BODIES else contacts.others for name, body in shapes.items()}
    ground = dict.fromkeys(_add_ground(spec, layout), contacts.others)
    cuboids = {_add_block(spec, blocks, i, contacts): float(contacts.blocks[i]) for i in range(len(blocks))}
    touching = [*product(cuboids.items(), (arm | ground).items()), *combinations(cuboids.items(), 2)]
    for (one, rough), (other, smooth) in [*touching, *product(arm.items(), ground.items())]:
        _add_pair(spec, one, other, rough * smooth, contacts)
    return spec


def _robot(wrist: WristCamera) -> mujoco.MjSpec:
    """The arm of the URDF, without what is only drawn. All its frames stay, and its fingers move together."""
    root = ElementTree.parse(urdf(wrist)).getroot()
    for link in root.iter("link"):
        for part in link.findall("visual"):
            link.remove(part)
    options = {"strippath": "false", "fusestatic": "false", "balanceinertia": "true"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", options)
    return mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))


def _add_motors(spec: mujoco.MjSpec, forces: Sequence[float]) -> None:
    """The arm's: PD control of place and velocity, for one number, place + velocity * damping / stiffness."""
    for name, stiffness, damping, force in zip(ARM_JOINTS, STIFFNESS, DAMPING, forces):
        spec.joint(name).armature = ROTOR
        _add_motor(spec, name, stiffness, (-stiffness, -damping), force)
    for name in FINGER_JOINTS:
        spec.joint(name).armature = FINGER_ROTOR
        _add_motor(spec, name, FINGER_DAMPING, (0.0, -FINGER_DAMPING), 1.0)


def _add_motor(spec: mujoco.MjSpec, joint: str, gain: float, bias: tuple[float, float], force: float) -> None:
    spec.add_actuator(
        name=joint,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        gainprm=[gain] + [0.0] * 9,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        biasprm=[0.0, *bias] + [0.0] * 7,
        forcelimited=True,
        forcerange=[-force, force],
    )


def _arm_shapes(spec: mujoco.MjSpec) -> dict[str, str]:
    """Names of the arm's shapes, but of its base, which no block reaches, and of the bodies that they belong to.

    None touches anything by itself.
    """
    found = {}
    for number, geom in enumerate(spec.geoms):
        geom.contype = geom.conaffinity = 0
        if geom.parent.name != BASE:
            geom.name = f"arm_{number}"
            found[geom.name] = geom.parent.name
    return found


def _add_ground(spec: mujoco.MjSpec, layout: Layout) -> tuple[str, str]:
    (x0, x1), (y0, y1) = layout.table_x, layout.table_y
    width, depth, height = layout.pedestal_size
    table = ((x1 - x0, y1 - y0, TABLE_THICKNESS), ((x0 + x1) / 2, (y0 + y1) / 2, -TABLE_THICKNESS / 2))
    pedestal = ((width, depth, height), (*layout.pedestal, height / 2))
    for name, (size, place) in {"table": table, "pedestal": pedestal}.items():
        _add_box(spec.worldbody, name, np.array(size), place)
    return "table", "pedestal"


def _add_block(spec: mujoco.MjSpec, blocks: BlockSet, index: int, contacts: Contacts) -> str:
    """A block whose frame is at its centre of geometry; the name of its shape."""
    name, mass, dims = block_name(index), float(blocks.mass[index]), blocks.dims[index]
    body = spec.worldbody.add_body(name=name)
    body.add_freejoint(name=name)
    body.explicitinertial = True
    body.mass, body.ipos = mass, blocks.com[index]
    body.inertia = mass / 12 * (dims @ dims - dims**2)
    _add_box(body, name, dims, (0.0, 0.0, 0.0))
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=HAND,
        name2=name,
        active=False,
        solref=[contacts.stopping, 1.0],
        solimp=TIED,
    )
    return name


def _add_box(body: mujoco.MjsBody, name: str, size: np.ndarray, place: tuple[float, ...]) -> None:
    box = mujoco.mjtGeom.mjGEOM_BOX
    body.add_geom(name=name, type=box, size=size / 2, pos=place, contype=0, conaffinity=0)


def _add_pair(spec: mujoco.MjSpec, one: str, other: str, friction: float, contacts: Contacts) -> None:
    """Two shapes that can touch. MuJoCo would take the larger coefficient of friction; here it is their product."""
    spec.add_pair(
        geomname1=one,
        geomname2=other,
        condim=3,
        friction=[friction, friction, 0.005, 0.0001, 0.0001],
        solref=[contacts.settling, 1.0],
        solreffriction=[contacts.stopping, 1.0],
        solimp=HARDNESS,
    )
