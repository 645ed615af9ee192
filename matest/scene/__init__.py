"""Geometry and light: cameras, meshes, surfaces, lights, shadows, and the points that shading needs."""

from matest.scene.camera import Camera
from matest.scene.environment import EnvironmentLight
from matest.scene.lights import DirectionalLight, Light, PointLight
from matest.scene.mesh import Mesh
from matest.scene.points import Points, illuminate
from matest.scene.scene import Scene
from matest.scene.surface import Surface

__all__ = [
    "Camera",
    "DirectionalLight",
    "EnvironmentLight",
    "Light",
    "Mesh",
    "PointLight",
    "Points",
    "Scene",
    "Surface",
    "illuminate",
]
