"""Draw a little scene with known truth: one brick wall with a window, seen from a hand-held path.

python examples/00_draw_a_scene.py [FOLDER]
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Path as CameraPath
from planewright.synthetic.motion import draw_tremor
from planewright.synthetic.observe import true_tracks
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, TrueFace, face_surfaces, quad
from planewright.synthetic.textures import bricks, planks, window

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
folder.mkdir(parents=True, exist_ok=True)

# Corners have names; faces are loops of names, counter-clockwise when seen from outside. World z is up.
points = {
    "a": (-1.5, 0.0, 0.0), "b": (1.5, 0.0, 0.0), "c": (1.5, 0.0, 1.6), "d": (-1.5, 0.0, 1.6),
    "w": (-0.8, 0.0, 0.5), "x": (0.2, 0.0, 0.5), "y": (0.2, 0.0, 1.2), "z": (-0.8, 0.0, 1.2),
}  # fmt: skip
faces = (TrueFace("wall", ("a", "b", "c", "d"), (("w", "x", "y", "z"),)), TrueFace("pane", ("w", "x", "y", "z")))
paints = {"wall": bricks((172, 92, 68), (204, 196, 184)), "pane": window()}
floor = quad((-4.0, -4.0, 0.0), (8.0, 0.0, 0.0), (0.0, 8.0, 0.0), planks((150, 116, 80), 0.4), 120.0)
scene = Scene(points, faces, (*face_surfaces(points, faces, paints, 180.0), floor), sun=(0.4, -0.6, 0.7))

path = CameraPath(
    num_frames=60,
    target=np.array([0.0, 0.0, 0.7]),
    radius=3.6,
    height=(1.2, 1.8),
    azimuth_deg=(-130.0, -60.0),
    tremor=draw_tremor(0.04, 0.6, np.random.default_rng(0)),
)
clip = SyntheticClip("wall", scene, path, centered_camera((480, 270), 0.9), RenderOptions())

xy, visible, _ = true_tracks(clip)
pictures = []
for number in (0, 20, 39, 59):
    picture = clip.renderer.frame(number)
    for x, y in xy[:, number][visible[:, number]]:
        cv2.circle(picture, (int(x), int(y)), 4, (255, 230, 0), 1, cv2.LINE_AA)
    pictures.append(picture)
sheet = np.vstack([np.hstack(pictures[:2]), np.hstack(pictures[2:])])
cv2.imwrite(str(folder / "00_draw_a_scene.png"), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
print(f"{folder / '00_draw_a_scene.png'}: four of {clip.num_frames} frames, true corners in yellow")
