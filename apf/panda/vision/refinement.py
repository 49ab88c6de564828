"""Corners of markers, to a fraction of a pixel: where lines along their edges meet.

Blur rounds corners off, so that what looks for corners themselves finds them too far inside: a marker seems smaller,
and thus farther away. Blur does not move the middle of an edge.
"""

import cv2
import numpy as np

from apf.panda.vision.markers import CELLS

ROUNDS = 3
ALONG = np.linspace(0.15, 0.85, 15)
"""Where an edge is looked at, of its length: not at the corners."""
ACROSS = np.linspace(-1.0, 1.0, 13)
"""Where the image is looked at across an edge, of the reach."""
REACH = (0.7, 1.0, 3.0)
"""How far from an edge: of a cell's width, at least, at most [pixels]. What is beyond belongs to other edges."""
SCATTER = 0.3
"""Points off the line of their edge [pixels] by more than this count for less."""
FAR = 2.5
"""Corners that would move farther [pixels] stay where they are."""


def refined(image: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """[M, 4, 2] corners of markers in an image [H, W] uint8, from those found [M, 4, 2], clockwise, in pixels."""
    if not len(corners):
        return corners
    better = corners
    for _ in range(ROUNDS):
        better = _where_edges_meet(image, better)
    moved = np.abs(better - corners).max((1, 2))
    return np.where((moved <= FAR)[:, None, None], better, corners)


def _where_edges_meet(image: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """[M, 4, 2] corners where the lines through the brightest steps near each edge meet; NaN where there is no line."""
    edges = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(edges, axis=-1, keepdims=True)
    along = edges / lengths
    out = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    share, least, most = REACH
    width = np.abs(_cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])) / 2 / lengths[..., 0].max(1)
    across = np.clip(share * width / CELLS, least, most)[:, None] * ACROSS
    places = ALONG * lengths  # [M, 4, S]
    points = corners[:, :, None] + places[..., None] * along[:, :, None]
    samples = points[:, :, :, None] + across[:, None, None, :, None] * out[:, :, None, None]
    steps = np.maximum(np.diff(_brightness(image, samples), axis=-1), 0.0)
    middles = (across[:, 1:] + across[:, :-1]) / 2
    total = steps.sum(-1)
    offsets = (steps * middles[:, None, None]).sum(-1) / np.maximum(total, 1e-9)
    shift, slope = _line(places, offsets, total)
    origins, directions = corners + shift[..., None] * out, along + slope[..., None] * out
    before, ahead = np.roll(origins, 1, axis=1), np.roll(directions, 1, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        way = _cross(origins - before, directions) / _cross(ahead, directions)
    return before + way[..., None] * ahead


def _line(x: np.ndarray, y: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[...] y at 0 and slope of the lines through points [..., S]; a second fit trusts less what is off the first."""
    shift, slope = np.zeros(x.shape[:-1]), np.zeros(x.shape[:-1])
    for doubt in (False, True):
        off = y - shift[..., None] - slope[..., None] * x
        w = weights / (1 + (off / SCATTER) ** 2) if doubt else weights
        w = w / np.maximum(w.sum(-1, keepdims=True), 1e-9)
        mx, my = (w * x).sum(-1), (w * y).sum(-1)
        spread = (w * (x - mx[..., None]) ** 2).sum(-1)
        slope = (w * (x - mx[..., None]) * (y - my[..., None])).sum(-1) / np.maximum(spread, 1e-9)
        shift = my - slope * mx
    return shift, slope


def _brightness(image: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[...] of an image [H, W] at points [..., 2] between its pixels; beyond its edge, as at its edge."""
    flat = np.nan_to_num(points).reshape(len(points), -1, 2).astype(np.float32)
    found = cv2.remap(image, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return found.reshape(points.shape[:-1]).astype(float)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
