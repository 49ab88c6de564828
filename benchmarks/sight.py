"""How well the robot's cameras see: errors of estimates in rendered scenes whose poses are known."""

from collections.abc import Iterator

import cv2
import numpy as np

from apf.panda import PandaWorld
from apf.panda.geometry import about_z, angle, distance, inverse, moved, pose
from apf.panda.grasps import Grasp, grasps_of
from apf.panda.kinematics import REST, forward, inverse_kinematics
from apf.panda.reality.photographer import Photographer, State
from apf.panda.stations import posture, tilts
from apf.panda.vision.cameras import LEFT, STATIC, WRIST
from apf.panda.vision.detection import detect, drawn
from apf.panda.vision.eyes import Eyes
from apf.rng import stream
from apf.towers import ROTATIONS, BlockSet

SCENES, GRASPS = 40, 120
OPEN = (0.04, 0.04)


class Sight:
    """A robot that looks, and what is true."""

    def __init__(self, world: PandaWorld, blocks: BlockSet) -> None:
        self.world, self.blocks = world, blocks
        self.cameras = world.cameras.named()
        self.photographer = Photographer(world.layout, self.cameras, world.flaws.drawn(self.cameras))
        self.eyes = Eyes(self.cameras, blocks)
        self.homes = world.layout.home_poses(blocks.dims)

    def errors(
        self, names: tuple[str, ...], poses: np.ndarray, q: np.ndarray, fingers: tuple[float, float], seed: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Of each block [B]: error of its estimate [m] and [rad]; NaN if it was not seen.

        Args:
            names: Of the cameras.
            poses: [B, 4, 4] true.
            q: [7] joints as the robot measures them.
            fingers: Position of each finger [m].
            seed: Of the noise.
        """
        true = q + self.photographer.drawn.zeros
        state = State(poses, true, fingers, forward(true))
        images = self.photographer.images(names, self.blocks, state, np.random.default_rng(seed))
        places = {
            name: forward(q) @ camera.mounting if name == WRIST else camera.mounting
            for name, camera in self.cameras.items()
        }
        found = self.eyes.estimate(images, places, poses)
        pairs = list(zip(found.poses, poses))
        off = np.array([distance(a, b) for a, b in pairs])
        turned = np.array([angle(a, b) if np.isfinite(a).all() else np.nan for a, b in pairs])
        return off, turned

    def scene(self, rng: np.random.Generator) -> np.ndarray:
        """[B, 4, 4]: blocks turned at random at home, five of them in a tower at the base."""
        poses = self.homes.copy()
        for block, dims in enumerate(self.blocks.dims):
            rotation = ROTATIONS[rng.integers(24)]
            poses[block, :3, :3] = about_z(rng.uniform(-np.pi, np.pi)) @ rotation
            poses[block, 2, 3] = (np.abs(rotation) @ dims)[2] / 2
        height = 0.0
        for block in rng.permutation(len(self.blocks))[:5]:
            rotation = ROTATIONS[rng.integers(24)]
            side = (np.abs(rotation) @ self.blocks.dims[block])[2]
            place = np.append(self.world.layout.base + rng.normal(0, 0.01, 2), height + side / 2)
            poses[block] = pose(place, rotation)
            height += side
        return poses


def static(world: PandaWorld, blocks: BlockSet) -> dict[str, np.ndarray]:
    """Errors [m], [rad] of all blocks of many scenes, seen by both cameras beside the table, the arm at rest."""
    sight, rng = Sight(world, blocks), stream(0, "static sight")
    found = [sight.errors(STATIC, sight.scene(rng), REST, OPEN, seed) for seed in range(SCENES)]
    return {"off": np.concatenate([off for off, _ in found]), "turned": np.concatenate([t for _, t in found])}


def wrist(world: PandaWorld, blocks: BlockSet) -> dict[str, dict[str, np.ndarray]]:
    """Errors [m], [rad] of the block that is about to be grasped, and in the hand, seen by the camera on the hand."""
    sight, rng = Sight(world, blocks), stream(0, "wrist sight")
    found: dict[str, list[tuple[float, float]]] = {"before": [], "held": []}
    while len(found["held"]) < GRASPS:
        poses, block = sight.homes.copy(), int(rng.integers(len(blocks)))
        rotation = ROTATIONS[rng.integers(24)]
        side = (np.abs(rotation) @ blocks.dims[block])[2]
        place = np.append(world.layout.base + rng.normal(0, 0.03, 2), side / 2 + rng.uniform(0, 0.25))
        poses[block] = pose(place, about_z(rng.uniform(-1, 1)) @ rotation)
        for kind, q, where in _looks(world, blocks, block, poses[block], rng):
            seen = poses.copy()
            seen[block] = where
            fingers = OPEN if kind == "before" else (blocks.dims[block].min() / 2,) * 2
            off, turned = sight.errors((WRIST,), seen, q, fingers, len(found[kind]))
            found[kind].append((off[block], turned[block]))
    return {kind: {"off": np.array(pairs)[:, 0], "turned": np.array(pairs)[:, 1]} for kind, pairs in found.items()}


def _looks(
    world: PandaWorld, blocks: BlockSet, block: int, where: np.ndarray, rng: np.random.Generator
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """From before a random grasp of a block and after the lift: joints [7], and where the block is then."""
    grasps = grasps_of(blocks.dims[block], world.gripper)
    possible = [g for g, tilt in zip(grasps, tilts(where, grasps)) if tilt <= np.deg2rad(world.reach.tilt)]
    if not possible:
        return
    grasp: Grasp = possible[int(rng.integers(len(possible)))]
    target = where @ grasp.pose
    lifted = moved(target, (0, 0, world.reach.lift))
    looks = (
        ("before", moved(target, -world.reach.approach * target[:3, 2]), where),
        ("held", lifted, lifted @ inverse(grasp.pose)),
    )
    solved = [(kind, inverse_kinematics(at, posture(at)), place) for kind, at, place in looks]
    if all(len(solutions) for _, solutions, _ in solved):
        for kind, solutions, place in solved:
            yield kind, solutions[0], place


def picture(world: PandaWorld, blocks: BlockSet) -> np.ndarray:
    """[480, 1493, 3] uint8: a scene as the left camera and the one on the hand see it, the markers found drawn in."""
    sight, rng = Sight(world, blocks), stream(0, "picture of sight")
    poses = sight.scene(rng)
    top = poses[int(np.argmax(poses[:, 2, 3]))]
    above = pose(top[:3, 3] + [0, 0, 0.12], np.diag([1.0, -1.0, -1.0]))
    q = inverse_kinematics(above, posture(above))[0]
    true = q + sight.photographer.drawn.zeros
    images = sight.photographer.images((LEFT, WRIST), blocks, State(poses, true, OPEN, forward(true)), rng)
    found = [drawn(image, detect(image, len(blocks)), blocks.name) for image in images.values()]
    return np.hstack([cv2.resize(image, (round(480 * image.shape[1] / image.shape[0]), 480)) for image in found])
