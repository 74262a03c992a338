"""Scenes with known truth: for tests, benchmarks, examples and the demo."""

from planewright.synthetic.boxes import boxes as boxes
from planewright.synthetic.clip import SyntheticClip as SyntheticClip
from planewright.synthetic.desktop import desktop as desktop
from planewright.synthetic.difficulty import Difficulty as Difficulty
from planewright.synthetic.difficulty import clip_difficulty as clip_difficulty
from planewright.synthetic.difficulty import difficulty as difficulty
from planewright.synthetic.hall import hall as hall
from planewright.synthetic.hard import HARD as HARD
from planewright.synthetic.houses import demo_scene as demo_scene
from planewright.synthetic.houses import toy_house as toy_house
from planewright.synthetic.library import library as library
from planewright.synthetic.observe import draw as draw
from planewright.synthetic.observe import true_cameras as true_cameras
from planewright.synthetic.observe import true_tracks as true_tracks
from planewright.synthetic.observe import truth as truth
from planewright.synthetic.refusals import object_on_turntable as object_on_turntable
from planewright.synthetic.refusals import rotating_camera as rotating_camera
from planewright.synthetic.refusals import single_plane as single_plane
from planewright.synthetic.refusals import still_camera as still_camera
from planewright.synthetic.render import RenderedFrames as RenderedFrames
from planewright.synthetic.render import RenderOptions as RenderOptions
from planewright.synthetic.score import score as score
from planewright.synthetic.write import write_clip as write_clip
