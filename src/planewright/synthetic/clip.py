"""A clip with known truth: a scene, a path, a camera, and how it is filmed."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planewright.geometry.camera import Intrinsics
from planewright.synthetic.motion import Motion, Visit
from planewright.synthetic.render import CompiledScene, RenderedFrames, Renderer, RenderOptions, compile_scene
from planewright.synthetic.scene import Scene


@dataclass(frozen=True, eq=False)
class SyntheticClip:
    """Everything that decides the pixels and the truth. Painting and lighting happen once, at the first frame."""

    name: str
    scene: Scene
    path: Motion
    intrinsics: Intrinsics
    options: RenderOptions
    visit: Visit | None = None
    """How the surfaces of the visitor move, if there is one."""

    @property
    def num_frames(self) -> int:
        """Frames of the clip."""
        return self.path.num_frames

    @cached_property
    def compiled(self) -> CompiledScene:
        """The painted and lit scene."""
        return compile_scene(self.scene, self.options.seed)

    @cached_property
    def renderer(self) -> Renderer:
        """Draws its frames."""
        return Renderer(self.scene, self.compiled, self.path, self.intrinsics, self.options, self.visit)

    @property
    def frames(self) -> RenderedFrames:
        """Its frames, drawn on demand."""
        return RenderedFrames(self.renderer, range(self.num_frames))


def centered_camera(size: tuple[int, int], focal_in_widths: float, distortion: tuple[float, ...] = ()) -> Intrinsics:
    """A camera whose focal length is that many image widths and whose principal point is the image's centre."""
    return Intrinsics(focal_in_widths * size[0], np.array([size[0] / 2, size[1] / 2]), size, distortion)
