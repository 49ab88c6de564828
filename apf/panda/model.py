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
def urdf() -> str:
    """Path of the model's file, written once in a process and removed with it."""
    tree = ElementTree.parse(URDF)
    for link in tree.iter("link"):
        side = FINGER_LINKS.get(link.attrib["name"])
        if side is not None:
            for part in [*link.findall("collision"), *link.findall("contact")]:
                link.remove(part)
            for size, middle, turn in BOXES:
                _add_box(link, size, (middle[0], side * middle[1], middle[2]), side * turn)
    for mesh in tree.iter("mesh"):
        mesh.attrib["filename"] = mesh.attrib["filename"].replace("package://", f"{URDF.parent}/")
    path = Path(_directory().name) / "panda.urdf"
    tree.write(path)
    return str(path)


def _add_box(link: ElementTree.Element, size: tuple, middle: tuple, turn: float) -> None:
    collision = ElementTree.SubElement(link, "collision")
    ElementTree.SubElement(collision, "origin", xyz=" ".join(map(str, middle)), rpy=f"{turn} 0 0")
    geometry = ElementTree.SubElement(collision, "geometry")
    ElementTree.SubElement(geometry, "box", size=" ".join(map(str, size)))
