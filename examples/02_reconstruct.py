"""From a clip and a sketch to a textured model, by code; the clip is drawn on the spot, so the errors are known.

python examples/02_reconstruct.py [FOLDER]
"""

import json
import sys
from pathlib import Path

from planewright import reconstruct
from planewright.synthetic import demo_scene, score, write_clip

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples/02_reconstruct")
clip, sketch, truth = write_clip(demo_scene(), folder / "input")

result = reconstruct(clip, sketch, output=folder / "result", force=True)
print(f"{len(result.model.faces)} faces, focal length {result.cameras.intrinsics.focal:.1f} px +- {result.cameras.focal_sigma:.1f}")

found = json.loads((folder / "result" / "reconstruction.json").read_text(encoding="utf-8"))
figures = score(found, json.loads(truth.read_text(encoding="utf-8")))
for key in ("within_2px_pct", "focal_error_pct", "rotation_median_deg", "corner_rms_pct", "normal_mean_deg", "near_misses_enforced"):
    print(f"{key:24} {figures[key]}")
print(f"The model is {folder / 'result' / 'model.glb'}.")
