"""How the robot sees: markers on blocks, cameras, and estimates of poses from images."""

from apf.panda.vision.cameras import Camera, Cameras, WristCamera
from apf.panda.vision.eyes import Eyes, Sighting

__all__ = ["Camera", "Cameras", "Eyes", "Sighting", "WristCamera"]
