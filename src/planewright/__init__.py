"""Planar 3D models from a handheld clip and a drawn sketch."""

__version__ = "0.1.0"
