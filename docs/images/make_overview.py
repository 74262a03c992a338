"""Makes overview.jpg, the picture of README.md: the drawing, the model over another frame, the model textured and shaded. All of it is the demo's.

python docs/images/make_overview.py
"""

from pathlib import Path

import cv2
import numpy as np

from planewright import reconstruct
from planewright.arrays import ColorImage
from planewright.geometry.camera import Intrinsics
from planewright.model.render import render_model
from planewright.pipeline.overlay import edge_strokes
from planewright.pipeline.report_pictures import main_frame
from planewright.pipeline.result import Result
from planewright.pipeline.views import FOCAL, SIZE, model_poses
from planewright.planes.polygons import scene_polygons
from planewright.synthetic import demo_scene, write_clip
from planewright.video.clip import open_clip

SIDE = (640, 360)
AMBER, WHITE = (255, 210, 63), (255, 255, 255)


def polyline(image: ColorImage, xy: object, color: tuple[int, int, int], closed: bool = False) -> None:
    """A line through points in pixels; OpenCV puts pixel centres at whole numbers, and takes sixteenths."""
    cv2.polylines(image, [np.rint((np.asarray(xy) - 0.5) * 16).astype(np.int32)], closed, color, 2, cv2.LINE_AA, 4)


def drawing(result: Result, image: ColorImage) -> ColorImage:
    frame = main_frame(result.scene)
    marks = {point.id: point.marks.get(frame) for point in result.scene.sketch.points}
    tinted = image.copy()
    for f, face in enumerate(result.scene.sketch.faces):
        loop = [marks[corner] for corner in face.loop if marks[corner] is not None]
        hue = np.array([[[(f * 69 + 105) % 180, 190, 230]]], np.uint8)
        color = tuple(int(c) for c in cv2.cvtColor(hue, cv2.COLOR_HSV2RGB)[0, 0])
        cv2.fillPoly(tinted, [np.rint(np.array(loop)).astype(np.int32)], color, cv2.LINE_AA)
    image = cv2.addWeighted(tinted, 0.35, image, 0.65, 0)
    for face in result.scene.sketch.faces:
        polyline(image, [marks[corner] for corner in face.loop if marks[corner] is not None], WHITE, closed=True)
    for x, y in (mark for mark in marks.values() if mark is not None):
        cv2.circle(image, (round(x * 16 - 8), round(y * 16 - 8)), 64, WHITE, -1, cv2.LINE_AA, 4)
    return image


def overlay(result: Result, image: ColorImage, row: int) -> ColorImage:
    for stroke in edge_strokes(result.scene, scene_polygons(result.scene), result.cameras, row):
        if stroke.visible:
            polyline(image, stroke.xy, AMBER)
    return image


folder = Path("out/overview")
clip_file, sketch, _ = write_clip(demo_scene(), folder)
result = reconstruct(clip_file, sketch)
frames = open_clip(clip_file)
row = int(np.flatnonzero(result.cameras.posed)[8])
first = drawing(result, next(iter(frames.color([main_frame(result.scene) or 0])))[1].copy())
second = overlay(result, next(iter(frames.color([int(result.cameras.frame[row])])))[1].copy(), row)
_, poses = model_poses(result.model, result.cameras)
lens = Intrinsics(focal=FOCAL * SIDE[1] / SIZE[1], principal_point=np.array([SIDE[0] / 2, SIDE[1] / 2]), image_size=SIDE)
renders = [render_model(result.model, poses[0], lens, "textured"), render_model(result.model, poses[2], lens, "shaded")]
sheet = np.vstack([np.hstack([first, second]), np.hstack(renders)])
cv2.imwrite(str(Path(__file__).with_name("overview.jpg")), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])
