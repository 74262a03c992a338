"""The list of relations that people read: each pair of faces once for each kind, with figures and a reason."""

from collections.abc import Sequence

import numpy as np

from planewright.arrays import Bool, Int
from planewright.planes.structure_constraints import Groups
from planewright.planes.structured_bundle import StructureSolution
from planewright.relations.detect import PAIR_KINDS, Detection, DetectOptions, PairKind, PairTest, PairTests, weigh_pairs
from planewright.relations.relation import Relation, RelationState
from planewright.relations.require import Requirements
from planewright.sketch.graph import FaceId, Sketch


def list_relations(
    sketch: Sketch,
    free: StructureSolution,
    final: StructureSolution,
    required: Requirements,
    found: Detection | None,
    released: Sequence[PairTest],
    options: DetectOptions = DetectOptions(),
) -> tuple[Relation, ...]:
    """The person's relations first, then every pair that holds in the final solution, then the candidates that were not applied.

    The list is closed: what follows from enforced relations by way of other faces is listed as enforced too, with the step that completed it.
    """
    ids = [face.id for face in sketch.faces]
    known = np.flatnonzero(final.face_known & free.face_known)
    pairs = np.array([(a, b) for i, a in enumerate(known.tolist()) for b in known[i + 1 :].tolist()], dtype=np.int64).reshape(-1, 2)
    steps = found.accepted if found is not None else ()
    measured: dict[PairKind, PairTests] = {kind: weigh_pairs(free, kind, pairs, options) for kind in PAIR_KINDS}
    holds = _when(free, final, required, steps, pairs)
    taken = {(relation.kind, frozenset(relation.faces)) for relation in required.relations}
    out = list(required.relations)
    drawn = free.face_plane[pairs[:, 0]] == free.face_plane[pairs[:, 1]]
    for kind in PAIR_KINDS:
        for k in np.flatnonzero(holds[kind] >= 0).tolist():
            a, b = pairs[k].tolist()
            if (kind, frozenset((ids[a], ids[b]))) in taken:
                continue
            taken.add((kind, frozenset((ids[a], ids[b]))))
            order = int(holds[kind][k])
            step = steps[order - 1] if order else None
            if drawn[k] and kind != "orthogonal":
                reason = "The drawing makes them one plane: they share corners that are not on one line."
                out.append(Relation(kind, (ids[a], ids[b]), "enforced", "detected", 0.0, 0.0, 0.0 if kind == "coplanar" else None, None, None, reason))
                continue
            angle, sigma, gap = _figures(kind, measured, k)
            text = f"{angle:.2f} deg +- {sigma:.2f} deg before" + (f", {100.0 * gap / free.diagonal:.2f} % of the scene apart" if gap is not None else "")
            if step is not None and {a, b} == {step.a, step.b} and kind == step.kind:
                reason = f"{text}; 2 ln BF {step.log_bayes_factor:.1f} in favour."
            elif step is not None:
                reason = f"{text}; it follows once {ids[step.a]} and {ids[step.b]} are {step.kind}."
            else:
                reason = f"{text}; it follows from what the person requires and from the drawing."
            factor = step.log_bayes_factor if step is not None else None
            out.append(Relation(kind, (ids[a], ids[b]), "enforced", "detected", angle, sigma, gap, factor, order or None, reason))
    if found is not None:
        out += _not_applied(ids, free, final, found, released, pairs, measured, taken)
    return tuple(out)


def _figures(kind: PairKind, measured: dict[PairKind, PairTests], k: int) -> tuple[float, float, float | None]:
    """Angle off and its standard deviation in degrees; the distance for coplanar."""
    tests = measured["orthogonal" if kind == "orthogonal" else "parallel"]
    deviation = float(tests.deviation[k])
    angle = np.arcsin(min(deviation, 1.0)) if kind == "orthogonal" else 2.0 * np.arcsin(min(0.5 * deviation, 1.0))
    gap = float(measured["coplanar"].deviation[k]) if kind == "coplanar" else None
    return float(np.degrees(angle)), float(np.degrees(tests.sigma[k])), gap


def _when(
    free: StructureSolution, final: StructureSolution, required: Requirements, steps: Sequence[PairTest], pairs: Int[np.ndarray, "pairs 2"]
) -> dict[PairKind, Int[np.ndarray, "pairs"]]:
    """The step at which each pair came to hold: 0 before the first (drawing, person), -1 never."""
    count = len(final.normals)
    direction, plane = Groups(count), Groups(count)
    given = required.constraints
    drawn = [(face, int(free.face_direction[face])) for face in range(count)]
    for a, b in [*drawn, *given.same_direction.tolist(), *given.same_plane.tolist()]:
        direction.join(a, b)
    for a, b in [*((face, int(free.face_plane[face])) for face in range(count)), *given.same_plane.tolist()]:
        plane.join(a, b)
    crossed = list(required.orthogonal)
    out: dict[PairKind, Int[np.ndarray, "pairs"]] = {kind: np.full(len(pairs), -1) for kind in PAIR_KINDS}
    for order, step in enumerate([None, *steps]):
        if step is not None and step.kind == "orthogonal":
            crossed.append((step.a, step.b))
        elif step is not None:
            direction.join(step.a, step.b)
            if step.kind == "coplanar":
                plane.join(step.a, step.b)
        rank = direction.roots()
        right = np.zeros((count, count), dtype=bool)
        for a, b in crossed:
            right[rank[a], rank[b]] = right[rank[b], rank[a]] = True
        ends = rank[pairs]
        now = {"parallel": ends[:, 0] == ends[:, 1], "orthogonal": right[ends[:, 0], ends[:, 1]], "coplanar": _same(plane.roots(), pairs)}
        for kind in PAIR_KINDS:
            out[kind][(out[kind] < 0) & now[kind]] = order
    # Parallel planes that share a corner are one plane, whether or not a step said so.
    late = (out["coplanar"] < 0) & _same(final.face_plane, pairs)
    out["coplanar"][late] = np.where(out["parallel"][late] < 0, len(steps), out["parallel"][late])
    late = (out["parallel"] < 0) & _same(final.face_direction, pairs)
    out["parallel"][late] = len(steps)
    return out


def _same(roots: Int[np.ndarray, "faces"], pairs: Int[np.ndarray, "pairs 2"]) -> Bool[np.ndarray, "pairs"]:
    return roots[pairs[:, 0]] == roots[pairs[:, 1]]


def _not_applied(
    ids: Sequence[FaceId],
    free: StructureSolution,
    final: StructureSolution,
    found: Detection,
    released: Sequence[PairTest],
    pairs: Int[np.ndarray, "pairs 2"],
    measured: dict[PairKind, PairTests],
    taken: set[tuple[str, frozenset[FaceId]]],
) -> list[Relation]:
    """Candidates that were weighed and not applied: all pairs of faces between the two groups."""
    out: list[Relation] = []
    tests: list[tuple[PairTest, RelationState, str]] = [
        (test, "released", "It was enforced and given up: it cost far more than its deviation allows.") for test in released
    ]
    for test, unclear in zip(found.refused, found.ambiguous, strict=True):
        doubt = "too uncertain to tell from a near miss" if test.log_bayes_factor > 0.0 else "about as likely as not"
        tests.append((test, "ambiguous", f"It is {doubt}; not applied.") if unclear else (test, "released", "The views speak against it."))
    for test, state, why in tests:
        groups = final.face_plane if test.kind == "coplanar" else final.face_direction
        ends = np.sort(groups[pairs], axis=1)
        between = np.flatnonzero((ends == np.sort(groups[[test.a, test.b]])).all(axis=1))
        for k in between.tolist():
            a, b = pairs[k].tolist()
            key = (test.kind, frozenset((ids[a], ids[b])))
            if key in taken:
                continue
            taken.add(key)
            angle, sigma, gap = _figures(test.kind, measured, k)
            text = f"{100.0 * gap / free.diagonal:.2f} % of the scene apart" if gap is not None else f"{angle:.2f} deg +- {sigma:.2f} deg"
            unit = free.diagonal / 100.0 if test.kind == "coplanar" else np.pi / 180.0
            at_last = f"{test.deviation / unit:.2f} +- {test.sigma / unit:.2f} with all else applied"
            reason = f"{text} ({at_last}); 2 ln BF {test.log_bayes_factor:.1f}. {why}"
            out.append(Relation(test.kind, (ids[a], ids[b]), state, "detected", angle, sigma, gap, test.log_bayes_factor, None, reason))
    return out
