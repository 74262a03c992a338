"""Cameras from followed features."""

from planewright.sfm.cameras import Cameras as Cameras
from planewright.sfm.cameras import ScenePoints as ScenePoints
from planewright.sfm.degeneracy import Refused as Refused
from planewright.sfm.solve import SfmOptions as SfmOptions
from planewright.sfm.solve import SfmSummary as SfmSummary
from planewright.sfm.solve import Solved as Solved
from planewright.sfm.solve import solve_cameras as solve_cameras
