"""Where blocks are, from the images of several cameras together: one estimate joins all faces and all cameras."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from apf.panda.geometry import angle, inverse, pose
from apf.panda.vision.cameras import Camera, projected
from apf.panda.vision.detection import Detection, detect_all, sorted_out
from apf.panda.vision.markers import marker_corners, marker_poses, marker_sides
from apf.towers import BlockSet

SCALE = 0.5
"""Errors of corners [pixels] beyond this count less than their squares (soft L1)."""
OUTLIER = 12.0
"""A marker whose corners are farther off [pixels] was misread, and is left out."""
GATE = 6.0
"""A block whose markers fit its pose worse than this [pixels] counts as not seen."""
UNSURE = 2.0
"""Of two poses that explain a single marker, one is ruled out if it fits this many times worse."""


@dataclass(frozen=True, eq=False)
class Doubled:
    """A marker that one camera saw more than once, in one image: it was left out.

    camera: Its name. block, face: Whose marker it is. on: The blocks that it is on; None: on none that is seen.
    """

    camera: str
    block: int
    face: int
    on: tuple[int | None, ...]


@dataclass(frozen=True, eq=False)
class Sighting:
    """What was seen of B blocks.

    poses: [B, 4, 4] in the robot's frame; NaN where a block was not seen. seen: [B] bool. residual: [B] how well the
    markers fit [pixels, root mean square]. markers: [B] how many were used. surprise: [B] how far the markers that are
    seen are from where they would be if the block were where it was expected [pixels, median over markers]; NaN where
    nothing was expected or seen. doubled: markers that were seen twice in one image.
    """

    poses: np.ndarray
    seen: np.ndarray
    residual: np.ndarray
    markers: np.ndarray
    surprise: np.ndarray
    doubled: tuple[Doubled, ...] = ()


@dataclass(frozen=True, eq=False)
class _View:
    """One marker in one image: where it is seen [4, 2], which points [4, 3] of the block these are, and by what."""

    face: int
    corners: np.ndarray
    points: np.ndarray
    camera: np.ndarray
    """[4, 4] pose of the optical frame."""
    intrinsics: np.ndarray


class Eyes:
    """Knows the cameras and the markers of a block set."""

    def __init__(self, cameras: Mapping[str, Camera], blocks: BlockSet) -> None:
        """Nothing is seen yet.

        Args:
            cameras: By their names.
            blocks: The set.
        """
        self.cameras, self.blocks = cameras, blocks
        self._corners = [marker_corners(dims) for dims in blocks.dims]
        self._poses = [marker_poses(dims) for dims in blocks.dims]
        self._sides = [marker_sides(dims) for dims in blocks.dims]

    def estimate(
        self,
        images: Mapping[str, np.ndarray],
        places: Mapping[str, np.ndarray],
        expected: np.ndarray | None = None,
        only: int | None = None,
    ) -> Sighting:
        """Where the blocks are.

        Args:
            images: [H, W] uint8 by the names of cameras that answered; none has to.
            places: [4, 4] by the names of cameras: their optical frames in the robot's frame.
            expected: [B, 4, 4] where blocks are thought to be: to say how far what is seen surprises, and to decide
                between two poses that explain a single marker equally well.
            only: The block that is asked for; the others count as not seen. None: all are asked for.

        Raises:
            ValueError: An image is not of the camera's size, or not of bytes.
        """
        views: list[list[_View]] = [[] for _ in range(len(self.blocks))]
        doubled: dict[str, list[Detection]] = {}
        for name, image in images.items():
            camera = self.cameras[name]
            if image.shape != (camera.height, camera.width) or image.dtype != np.uint8:
                what = f"image is {image.shape} {image.dtype}"
                raise ValueError(f"camera {name}: its {what}; it must be {(camera.height, camera.width)} uint8")
            once, doubled[name] = sorted_out(detect_all(image, len(self.blocks)))
            for each in once:
                if only is not None and each.block != only:
                    continue
                points = self._corners[each.block][each.face]
                views[each.block].append(_View(each.face, each.corners, points, places[name], camera.intrinsics))
        found = [
            self._locate(block, seen, None if expected is None else expected[block]) for block, seen in enumerate(views)
        ]
        poses = np.array([where for where, _, _ in found]).reshape(-1, 4, 4)
        return Sighting(
            poses,
            np.array([n > 0 for _, _, n in found], bool),
            np.array([residual for _, residual, _ in found], float),
            np.array([n for _, _, n in found], int),
            np.array([_surprise(expected, block, seen) for block, seen in enumerate(views)], float),
            tuple(each for name, twice in doubled.items() for each in self._doubled(name, twice, places[name], poses)),
        )

    def _doubled(
        self, name: str, twice: Sequence[Detection], place: np.ndarray, poses: np.ndarray
    ) -> Iterator[Doubled]:
        """Each marker that a camera at a place [4, 4] saw twice, and the blocks at poses [B, 4, 4] that it is on."""
        for block, face in dict.fromkeys((each.block, each.face) for each in twice):
            on = [self._bearer(name, each, place, poses) for each in twice if (each.block, each.face) == (block, face)]
            yield Doubled(name, block, face, tuple(on))

    def _bearer(self, name: str, marker: Detection, place: np.ndarray, poses: np.ndarray) -> int | None:
        """The block of which a face is seen where the marker is; None: no block that is seen has one there."""
        off = np.full(len(poses), np.inf)
        for block in np.flatnonzero(~np.isnan(poses[:, 0, 0])):
            points = self._corners[block] @ poses[block, :3, :3].T + poses[block, :3, 3]
            pixels = projected(points, place, self.cameras[name].intrinsics)
            turned = [np.roll(pixels, turn, axis=1) for turn in range(4)]  # another marker may be pasted on at any turn
            off[block] = np.linalg.norm(np.array(turned) - marker.corners, axis=-1).mean(-1).min()
        return int(off.argmin()) if off.min() < OUTLIER else None

    def _locate(self, block: int, views: Sequence[_View], expected: np.ndarray | None) -> tuple[np.ndarray, float, int]:
        """Pose, residual and number of markers used; NaN, infinity and 0 if the block is not seen."""
        while views:
            start = self._start(block, views, expected)
            where = _fit(start, views)
            errors = np.array([np.sqrt((_errors(where, [view]) ** 2).sum(-1).mean()) for view in views])
            if errors.max() <= OUTLIER:
                residual = float(np.sqrt((errors**2).mean()))
                if residual <= GATE:
                    return where, residual, len(views)
            if len(views) == 1:
                break
            views = [view for i, view in enumerate(views) if i != errors.argmax()]
        return np.full((4, 4), np.nan), np.inf, 0

    def _start(self, block: int, views: Sequence[_View], expected: np.ndarray | None) -> np.ndarray:
        """[4, 4] the pose, of those that a single marker tells, that fits all markers best."""
        candidates = [where for view in views for where in self._of_marker(block, view)]
        costs = np.array([np.abs(_errors(where, views)).mean() for where in candidates])
        if len(views) == 1 and expected is not None:
            likely = [where for where, cost in zip(candidates, costs) if cost <= UNSURE * costs.min() + SCALE]
            return min(likely, key=lambda where: angle(where, expected))
        return candidates[int(np.nan_to_num(costs, nan=np.inf).argmin())]

    def _of_marker(self, block: int, view: _View) -> list[np.ndarray]:
        """The two poses [4, 4] of a block that explain one of its markers (IPPE), those behind the camera left out."""
        half = self._sides[block][view.face] / 2
        flat = half * np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            flat, view.corners, view.intrinsics, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        block_in_marker = inverse(self._poses[block][view.face])
        return [
            view.camera @ pose(shift.ravel(), cv2.Rodrigues(turn)[0]) @ block_in_marker
            for turn, shift in zip(turns, shifts)
            if shift.ravel()[2] > 0
        ]


def _errors(where: np.ndarray, views: Sequence[_View]) -> np.ndarray:
    """[views, 4, 2] how far off the corners of markers are seen [pixels] if the block is at a pose [4, 4]."""
    points = np.array([view.points for view in views]) @ where[:3, :3].T + where[:3, 3]
    cameras = np.array([view.camera for view in views])
    local = np.einsum("vij,vci->vcj", cameras[:, :3, :3], points - cameras[:, None, :3, 3])
    depth = np.maximum(local[..., 2:], 1e-3)
    seen = np.einsum("vij,vcj->vci", np.array([view.intrinsics for view in views]), local / depth)[..., :2]
    return seen - np.array([view.corners for view in views])


def _surprise(expected: np.ndarray | None, block: int, views: Sequence[_View]) -> float:
    """See `Sighting.surprise`."""
    if expected is None or not views:
        return np.nan
    return float(np.median(np.sqrt((_errors(expected[block], views) ** 2).sum(-1).mean(-1))))


def _fit(start: np.ndarray, views: Sequence[_View]) -> np.ndarray:
    """[4, 4] the pose near `start` at which the corners are seen where they should be, with soft-L1 errors."""

    def moved(x: np.ndarray) -> np.ndarray:
        return pose(start[:3, 3] + x[3:], start[:3, :3] @ cv2.Rodrigues(x[:3])[0])

    found = least_squares(
        lambda x: _errors(moved(x), views).ravel(),
        np.zeros(6),
        loss="soft_l1",
        f_scale=SCALE,
        x_scale=(0.1,) * 3 + (0.01,) * 3,
    )
    return moved(found.x)
