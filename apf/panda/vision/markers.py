"""Markers of blocks: each face of each block carries one of its own (OpenCV's aruco, dictionary DICT_4X4_250).

Face 2 a + b of a block looks along its axis a (0: x, 1: y, 2: z), in the positive direction if b = 0. The marker of
face f of block i has the number 6 i + f. It lies in the middle of the face, and is as large as the shorter side of the
face allows with a white margin of one cell: 6 of 8 cells.
"""

import cv2
import numpy as np

from apf.errors import InputError

FACES = 6
CELLS, MARGIN = 6, 1
"""Cells of a marker along its side, its black border included, and white cells beside it."""
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
MOST = len(DICTIONARY.bytesList) // FACES
"""Blocks that can have markers of their own."""
TILE = 256
"""Sides of the picture of one face in the texture of a block [pixels]."""
ACROSS, DOWN = 3, 2
"""Pictures of faces in a texture."""


def check_number(blocks: int) -> None:
    """Raises InputError if there are not enough markers for so many blocks."""
    if blocks > MOST:
        raise InputError(f"there are {blocks} blocks; there are markers for {MOST}")


def face_axes(face: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors [3] of a face in the block's frame: to the right and up as it is seen from outside, and outwards."""
    axis, negative = divmod(face, 2)
    right, up, out = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3], np.eye(3)[axis]
    return (-right, up, -out) if negative else (right, up, out)


def face_sides(dims: np.ndarray, face: int) -> tuple[float, float]:
    """Width and height of a face [m] of a block with sides dims [3], as it is seen from outside."""
    right, up, _ = face_axes(face)
    return float(np.abs(right) @ dims), float(np.abs(up) @ dims)


def marker_sides(dims: np.ndarray) -> np.ndarray:
    """[6] sides of the markers [m] of a block with sides dims [3]."""
    share = CELLS / (CELLS + 2 * MARGIN)
    return np.array([share * min(face_sides(dims, face)) for face in range(FACES)])


def marker_poses(dims: np.ndarray) -> np.ndarray:
    """[6, 4, 4] of the markers in the frame of a block with sides dims [3]: x to the right, y up, z outwards."""
    poses = np.tile(np.eye(4), (FACES, 1, 1))
    for face in range(FACES):
        right, up, out = face_axes(face)
        poses[face, :3, :3] = np.stack([right, up, out], axis=1)
        poses[face, :3, 3] = out * (np.abs(out) @ dims) / 2
    return poses


def marker_corners(dims: np.ndarray) -> np.ndarray:
    """[6, 4, 3] corners [m] of the markers in the frame of a block of sides dims [3], clockwise from the upper left."""
    half = marker_sides(dims)[:, None, None] / 2
    flat = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])
    poses = marker_poses(dims)
    return np.einsum("fij,fcj->fci", poses[:, :3, :3], half * flat) + poses[:, None, :3, 3]


def marker_image(number: int, cell: int = 1) -> np.ndarray:
    """[8 c, 8 c] uint8: a marker with its white margin, c = `cell` pixels for each cell."""
    image = cv2.aruco.generateImageMarker(DICTIONARY, number, CELLS)
    return np.pad(image, MARGIN, constant_values=255).repeat(cell, 0).repeat(cell, 1)


def texture(block: int, dims: np.ndarray, colour: tuple[float, ...]) -> np.ndarray:
    """[512, 768, 3] uint8: the six faces of a block, each stretched to a square, in three columns and two rows.

    The edges of a face are at the middles of the first and last pixels of its square, as `mesh` has them.

    Args:
        block: Its number.
        dims: [3] its sides [m].
        colour: Of what is not marker, 0 to 1.
    """
    image = np.empty((DOWN * TILE, ACROSS * TILE, 3), np.uint8)
    image[:] = np.round(255 * np.array(colour[:3]))
    middle = (TILE - 1) / 2
    for face in range(FACES):
        width, height = face_sides(dims, face)
        picture = cv2.cvtColor(marker_image(FACES * block + face, TILE // (CELLS + 2 * MARGIN)), cv2.COLOR_GRAY2RGB)
        scale = (TILE - 1) / TILE * min(width, height) / np.array([width, height])
        picture = cv2.GaussianBlur(picture, (0, 0), sigmaX=0.5 / scale[0], sigmaY=0.5 / scale[1])
        placed = np.column_stack([np.diag(scale), middle * (1 - scale)])
        row, column = divmod(face, ACROSS)
        tile = image[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE]
        tile[:] = cv2.warpAffine(
            picture, placed, (TILE, TILE), dst=tile.copy(), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT
        )
    return image


def mesh(dims: np.ndarray) -> str:
    """A block with sides dims [3] as the text of an OBJ file, its faces mapped to those of `texture`."""
    lines, inset = [], 0.5 / TILE
    for face in range(FACES):
        right, up, out = face_axes(face)
        row, column = divmod(face, ACROSS)
        for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            point = (right * x + up * y + out) * dims / 2
            across = (column + 0.5 + x * (0.5 - inset)) / ACROSS
            above = 1 - (row + 0.5 - y * (0.5 - inset)) / DOWN
            lines += [f"v {point[0]:.9f} {point[1]:.9f} {point[2]:.9f}", f"vt {across:.9f} {above:.9f}"]
        lines.append(f"vn {out[0]:g} {out[1]:g} {out[2]:g}")
    for face in range(FACES):
        a, b, c, d = (f"{4 * face + corner}/{4 * face + corner}/{face + 1}" for corner in (1, 2, 3, 4))
        lines += [f"f {a} {b} {c}", f"f {a} {c} {d}"]
    return "\n".join(lines) + "\n"
