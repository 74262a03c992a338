from dataclasses import replace

from numpy.testing import assert_allclose, assert_array_equal

from planewright.planes.structure_constraints import StructureConstraints
from planewright.relations.enforce import NotExpressible, join_constraints, pair_constraints, required_constraints
from planewright.sketch.graph import FaceId, PointId, SketchRelation, Up
from planewright.synthetic.structure_truth import house_truth

SKETCH = house_truth().sketch
FRONT, LEFT, TOP = FaceId("front"), FaceId("left"), FaceId("chimney_top")
EDGE = (PointId("FL"), PointId("eFL"))


def expressed(relation: SketchRelation, up: Up | None = None) -> StructureConstraints:
    found = required_constraints(replace(SKETCH, up=up), relation)
    assert isinstance(found, StructureConstraints)
    return found


def test_detected_pairs_become_groups_and_right_angles() -> None:
    found = pair_constraints([("parallel", 0, 3), ("orthogonal", 1, 2), ("coplanar", 4, 5), ("parallel", 3, 7)])
    assert_array_equal(found.same_direction, [[0, 3], [3, 7]])
    assert_array_equal(found.same_plane, [[4, 5]])
    assert_array_equal(found.angle_faces, [[1, 2]])
    assert_allclose(found.angle_cosine, [0.0])


def test_joining_keeps_every_row() -> None:
    parts = [pair_constraints([("parallel", 0, 1)]), expressed(SketchRelation("angle", "require", (FRONT, LEFT), degrees=60.0))]
    joined = join_constraints(parts)
    assert len(joined.same_direction) == len(joined.angle_faces) == len(joined.angle_cosine) == 1
    assert len(join_constraints([]).same_direction) == 0


def test_angles_that_are_relations_of_their_own_are_exact() -> None:
    assert len(expressed(SketchRelation("angle", "require", (FRONT, LEFT), degrees=180.0)).same_direction) == 1
    assert expressed(SketchRelation("angle", "require", (FRONT, LEFT), degrees=90.0)).angle_cosine[0] == 0.0
    assert_allclose(expressed(SketchRelation("angle", "require", (FRONT, LEFT), degrees=120.0)).angle_cosine, [0.5])


def test_up_may_be_a_face_an_edge_or_a_direction() -> None:
    vertical, horizontal = SketchRelation("vertical", "require", (FRONT,)), SketchRelation("horizontal", "require", (TOP,))
    assert len(expressed(vertical, Up(face=TOP)).angle_faces) == 1
    assert len(expressed(horizontal, Up(face=LEFT)).same_direction) == 1
    assert len(expressed(vertical, Up(edge=EDGE)).across_edge) == 1
    assert len(expressed(horizontal, Up(edge=EDGE)).along_edge) == 1
    assert_allclose(expressed(vertical, Up(direction=(0.0, 0.0, 3.0))).across_vector, [[0.0, 0.0, 1.0]])
    assert_allclose(expressed(horizontal, Up(direction=(0.0, 0.0, 3.0))).across_vector @ [0.0, 0.0, 1.0], 0.0, atol=1e-15)


def test_what_says_too_little_comes_back_with_a_reason() -> None:
    for relation in (
        SketchRelation("parallel", "require", (FRONT,)),
        SketchRelation("parallel", "require", (FRONT, FRONT)),
        SketchRelation("parallel", "require", (FRONT, FaceId("nowhere"))),
        SketchRelation("angle", "require", (FRONT, LEFT)),
        SketchRelation("symmetric", "require", (FRONT, LEFT)),
        SketchRelation("equal_length", "require", edges=(EDGE,)),
        SketchRelation("vertical", "require", (FRONT,)),
    ):
        found = required_constraints(SKETCH, relation)
        assert isinstance(found, NotExpressible)
        assert found.reason.endswith(".")
