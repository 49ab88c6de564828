"""The Panda of pybullet_data, with fingers whose contacts can be trusted.

Its fingers are meshes. Pressed flat on a block, a mesh gets contact normals that point along the face as well as out
of it, and a block that was let go comes along with the hand; its springy contacts with friction anchors do the rest.
Here each finger consists of boxes instead, of the sizes that the maker's own description has, with ordinary contacts.
All else is as it was.
"""

import tempfile
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import pybullet_data

from apf.panda.kinematics import TARGET_ABOVE_HAND
from apf.panda.vision.cameras import WristCamera

URDF = Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf"
BOXES = [
    ((0.0175, 0.0152, 0.0185), (0.0, 0.00758, 0.04525), 0.0),
    ((0.0175, 0.007, 0.0235), (0.0, 0.0159, 0.02835), 0.5236),
    ((0.022, 0.015, 0.020), (0.0, 0.0185, 0.011), 0.0),
]
"""Of the left finger: size [m], middle [m], turn about x [rad]; the first is the pad. The right one mirrors it."""
FINGER_LINKS = {"panda_leftfinger": 1.0, "panda_rightfinger": -1.0}


@cache
def _directory() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory(prefix="apf-panda-")


@cache
def urdf(wrist: WristCamera, plain: bool = False) -> str:
    """Path of the model's file with a camera on the hand, written once in a process and removed with it.

    Args:
        wrist: The camera.
        plain: Is the arm drawn as what it collides with? That has a thirtieth of the triangles, and hides a
            little more.
    """
    tree = ElementTree.parse(URDF)
    for link in tree.iter("link"):
        if plain:
            _draw_plainly(link)
        side = FINGER_LINKS.get(link.attrib["name"])
        if side is not None:
            for part in [*link.findall("collision"), *link.findall("contact")]:
                link.remove(part)
            for size, middle, turn in BOXES:
                _add_box(link, size, (middle[0], side * middle[1], middle[2]), side * turn)
    for mesh in tree.iter("mesh"):
        mesh.attrib["filename"] = mesh.attrib["filename"].replace("package://", f"{URDF.parent}/")
    _add_camera(tree.getroot(), wrist)
    path = Path(_directory().name) / f"panda-{len(list(Path(_directory().name).iterdir()))}.urdf"
    tree.write(path)
    return str(path)


def _draw_plainly(link: ElementTree.Element) -> None:
    """A link's meshes to look at become those that it collides with."""
    plain = link.find("collision/geometry/mesh")
    if plain is not None:
        for mesh in link.findall("visual/geometry/mesh"):
            mesh.attrib["filename"] = plain.attrib["filename"]


def _add_camera(robot: ElementTree.Element, wrist: WristCamera) -> None:
    """A cube that collides, around where the camera on the hand is. PyBullet draws it; from within it is not seen."""
    link = ElementTree.SubElement(robot, "link", name="panda_camera")
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "mass", value="0.03")
    inertia = {"ixx": "1e-5", "iyy": "1e-5", "izz": "1e-5", "ixy": "0", "ixz": "0", "iyz": "0"}
    ElementTree.SubElement(inertial, "inertia", inertia)
    _add_box(link, (wrist.size,) * 3, (0, 0, 0), 0.0)
    joint = ElementTree.SubElement(robot, "joint", name="panda_camera_joint", type="fixed")
    ElementTree.SubElement(joint, "parent", link="panda_hand")
    ElementTree.SubElement(joint, "child", link="panda_camera")
    x, y, z = wrist.position
    ElementTree.SubElement(joint, "origin", xyz=f"{x} {y} {z + TARGET_ABOVE_HAND}", rpy="0 0 0")


def _add_box(link: ElementTree.Element, size: tuple, middle: tuple, turn: float) -> None:
    collision = ElementTree.SubElement(link, "collision")
    ElementTree.SubElement(collision, "origin", xyz=" ".join(map(str, middle)), rpy=f"{turn} 0 0")
    geometry = ElementTree.SubElement(collision, "geometry")
    ElementTree.SubElement(geometry, "box", size=" ".join(map(str, size)))
