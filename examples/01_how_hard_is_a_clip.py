"""Follow single corners by plain Lucas-Kanade through the demo clip, and see how few arrive: why corners are solved as parts of planes.

python examples/01_how_hard_is_a_clip.py [FOLDER]
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from planewright.synthetic import demo_scene, draw, true_tracks
from planewright.synthetic.difficulty import clicked, difficulty, follow_corners

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
folder.mkdir(parents=True, exist_ok=True)

clip = demo_scene(60, (480, 270))
xy, visible, _ = true_tracks(clip)
marks = clicked(draw(clip, np.random.default_rng(0)), list(clip.scene.points))
frames = list(clip.frames.gray(range(clip.num_frames)))
found = follow_corners(frames, marks, clip.num_frames)
figure = difficulty(frames, marks, xy, visible)

picture = clip.renderer.frame(clip.num_frames - 1)
for row, path in found.items():
    true, ours = xy[row, -1], path[-1]
    if visible[row, -1] and np.isfinite(ours[0]):
        color = (60, 255, 60) if np.linalg.norm(ours - true) <= 2 else (255, 60, 60)
        cv2.line(picture, (int(true[0]), int(true[1])), (int(ours[0]), int(ours[1])), color, 1, cv2.LINE_AA)
        cv2.circle(picture, (int(ours[0]), int(ours[1])), 4, color, 1, cv2.LINE_AA)
cv2.imwrite(str(folder / "01_how_hard_is_a_clip.png"), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
print(f"Lucas-Kanade keeps {figure.within_2px_pct:.0f} % of {figure.visible} visible corner-frames within 2 px, {figure.within_5px_pct:.0f} % within 5 px")
