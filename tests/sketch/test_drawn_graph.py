import numpy as np

from planewright.sketch.drawn_graph import blocks, canonical, cycle_links, shortest_cycles, traversed_cycles


def test_a_cycle_is_written_in_one_way() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        cycle = rng.permutation(int(rng.integers(3, 9))).tolist()
        shift = int(rng.integers(len(cycle)))
        turned = cycle[shift:] + cycle[:shift]
        assert canonical(cycle) == canonical(turned) == canonical(turned[::-1])
        assert set(cycle_links(canonical(cycle))) == {(min(a, b), max(a, b)) for a, b in zip(cycle, cycle[1:] + cycle[:1], strict=True)}


def test_blocks_part_at_points_that_hold_the_graph_together() -> None:
    triangle, square, tail = [(0, 1), (1, 2), (0, 2)], [(2, 3), (3, 4), (4, 5), (2, 5)], [(5, 6), (6, 7)]
    apart = [(8, 9), (9, 10), (8, 10)]
    found = blocks([*tail, *square, *apart, *triangle])
    assert [set(block.links) for block in found] == [set(triangle), set(square), set(apart)]
    assert [block.num_faces for block in found] == [1, 1, 1]


def test_edges_of_all_blocks_and_bridges_are_all_edges() -> None:
    rng = np.random.default_rng(2)
    for _ in range(40):
        count = int(rng.integers(3, 15))
        links = sorted({(int(min(p)), int(max(p))) for p in (rng.choice(count, 2, replace=False) for _ in range(int(rng.integers(2, 25))))})
        inside = [link for block in blocks(links) for link in block.links]
        assert len(inside) == len(set(inside))
        # An edge is in no block exactly when taking it out parts its ends.
        for link in links:
            rest = [other for other in links if other != link]
            reached, grown = {link[0]}, True
            while grown:
                grown = False
                for a, b in rest:
                    if (a in reached) != (b in reached):
                        reached |= {a, b}
                        grown = True
            assert (link in inside) == (link[1] in reached)


def test_short_cycles_of_a_cube_are_its_faces() -> None:
    links = [(a, b) for a in range(8) for b in range(a + 1, 8) if bin(a ^ b).count("1") == 1]
    (cube,) = blocks(links)
    faces = {cycle for cycle in shortest_cycles(cube, 8) if len(cycle) == 4}
    assert len(faces) == 6
    assert cube.num_faces == 5


def test_traversal_of_a_plane_drawing_finds_each_face_once() -> None:
    xy = {3 * y + x: (float(x), float(y)) for y in range(3) for x in range(3)}
    links = [(3 * y + x, 3 * (y + dy) + x + dx) for y in range(3) for x in range(3) for dx, dy in ((1, 0), (0, 1)) if x + dx < 3 and y + dy < 3]
    (grid,) = blocks(links)
    found = traversed_cycles(grid, xy)
    assert sorted(len(cycle) for cycle in found) == [4, 4, 4, 4, 8]
