"""What the person requires and forbids: obeyed as far as it can be, and reported where it is at odds with the views or with itself."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from planewright.planes.structure_constraints import StructureConstraints
from planewright.planes.structured_bundle import StructureSolution
from planewright.relations.detect import PAIR_KINDS, DetectOptions, Pair, PairKind, weigh_pairs
from planewright.relations.enforce import NotExpressible, join_constraints, required_constraints
from planewright.relations.relation import Relation, RelationState
from planewright.sketch.graph import FaceId, Sketch, SketchRelation

Solve = Callable[[StructureConstraints], StructureSolution]
Feasible = Callable[[StructureConstraints], bool]


@dataclass(frozen=True, eq=False)
class Requirements:
    """What was made of the person's relations."""

    constraints: StructureConstraints
    """Of the required relations that can hold together."""
    orthogonal: tuple[tuple[int, int], ...]
    """Face rows at right angles by requirement."""
    forbidden: tuple[Pair, ...]
    relations: tuple[Relation, ...]
    """One for each pair or other relation of the person."""
    obeyed: tuple[bool, ...]
    """Whether each of `relations` is part of `constraints`."""
    warnings: tuple[str, ...]


def obey_requirements(
    sketch: Sketch, free: StructureSolution, solve: Solve, feasible: Feasible, options: DetectOptions = DetectOptions()
) -> tuple[Requirements, StructureSolution]:
    """The required relations that can hold together, and the solution with them.

    Where they contradict each other, those that come later in the sketch give way, and the smallest contradicting set is named. Where one is at odds with
    the views it is obeyed all the same and reported as conflicting.
    """
    wishes = _split(sketch)
    required = [wish for wish in wishes if wish.stance == "require"]
    parts = [required_constraints(sketch, wish) for wish in required]
    kept, clashes = _consistent(parts, feasible)
    constraints = join_constraints(part for k, part in enumerate(parts) if k in kept and not isinstance(part, NotExpressible))
    base = solve(constraints) if kept else free
    relations: list[Relation] = []
    obeyed: list[bool] = []
    warnings: list[str] = []
    for k, (wish, part) in enumerate(zip(required, parts, strict=True)):
        if isinstance(part, NotExpressible):
            relation = _relation(wish, "released", f"It cannot be enforced. {part.reason}")
        elif k in kept:
            relation = _measured(sketch, wish, part, free, solve, options)
        else:
            others = "; ".join(describe(required[other]) for other in clashes[k] if other != k)
            relation = _relation(wish, "conflicting", f"It contradicts {others or 'what the drawing forces'}, and was left out.")
        if relation.state != "enforced":
            warnings.append(f"Required: {describe(wish)}. {relation.reason}")
        relations.append(relation)
        obeyed.append(k in kept)
    forbidden = _forbidden(sketch, [wish for wish in wishes if wish.stance == "forbid"])
    for wish in wishes:
        if wish.stance == "forbid":
            relations.append(_relation(wish, "released", "Forbidden by the person."))
            obeyed.append(False)
    crossed = [(a, b) for (a, b), cosine in zip(constraints.angle_faces.tolist(), constraints.angle_cosine.tolist(), strict=True) if cosine == 0.0]
    return Requirements(constraints, tuple(crossed), forbidden, tuple(relations), tuple(obeyed), tuple(warnings)), base


def describe(relation: SketchRelation) -> str:
    """The relation in words, for messages."""
    what = ", ".join(relation.faces) or ", ".join(f"{a}-{b}" for a, b in relation.edges)
    angle = f" of {relation.degrees:g} degrees" if relation.kind == "angle" and relation.degrees is not None else ""
    about = f" about {relation.about}" if relation.about else ""
    return f"{relation.kind.replace('_', ' ')}{angle} {what}{about}"


def _split(sketch: Sketch) -> list[SketchRelation]:
    """Relations of several faces as one for each pair with the first face, or for each face where it speaks of single ones; duplicates once."""
    out: list[SketchRelation] = []
    for wish in sketch.relations:
        if wish.kind in ("vertical", "horizontal"):
            out += [SketchRelation(wish.kind, wish.stance, (face,)) for face in wish.faces]
        elif len(wish.faces) > 2:
            out += [SketchRelation(wish.kind, wish.stance, (wish.faces[0], face), (), wish.degrees, wish.about) for face in wish.faces[1:]]
        else:
            out.append(wish)
    return list(dict.fromkeys(out))


def _consistent(parts: list[StructureConstraints | NotExpressible], feasible: Feasible) -> tuple[set[int], dict[int, tuple[int, ...]]]:
    """Rows that can hold together, taken in order, and for each other one the smallest set (itself included) that cannot.

    The set is found by leaving out one member after the other and keeping out those without which the rest still contradicts itself (a deletion filter;
    Chinneck, Feasibility and Infeasibility in Optimization, 2008, section 6.2).
    """
    usable = [(k, part) for k, part in enumerate(parts) if not isinstance(part, NotExpressible)]
    if not usable or feasible(join_constraints(part for _, part in usable)):
        return {k for k, _ in usable}, {}
    kept: list[tuple[int, StructureConstraints]] = []
    clashes: dict[int, tuple[int, ...]] = {}
    for k, part in usable:
        if feasible(join_constraints([*(other for _, other in kept), part])):
            kept.append((k, part))
            continue
        clash = list(kept)
        for member in kept:
            fewer = [other for other in clash if other is not member]
            if not feasible(join_constraints([*(other for _, other in fewer), part])):
                clash = fewer
        clashes[k] = (*(other for other, _ in clash), k)
    return {k for k, _ in kept}, clashes


def _measured(sketch: Sketch, wish: SketchRelation, part: StructureConstraints, free: StructureSolution, solve: Solve, options: DetectOptions) -> Relation:
    """A relation that is obeyed, with what the views say about it."""
    row = {face.id: f for f, face in enumerate(sketch.faces)}
    kinds: dict[str, PairKind] = {"angle": "orthogonal", "parallel": "parallel", "orthogonal": "orthogonal", "coplanar": "coplanar"}
    kind = kinds.get(wish.kind)
    if kind is None:
        return _priced(wish, part, free, solve, options)
    a, b = row[wish.faces[0]], row[wish.faces[1]]
    if not (free.face_known[a] and free.face_known[b]):
        return _relation(wish, "enforced", "Required by the person; without it the views do not determine both planes.")
    deviation, sigma, wald, factor = _deviation(free, kind, a, b, part, options)
    limit = float(chi2.ppf(options.significance, 1 if kind == "orthogonal" else 2))
    text = f"{np.degrees(deviation):.2f} deg +- {np.degrees(sigma):.2f} deg before"
    gap = None
    conflict = wald > limit
    if kind == "coplanar":
        tests = weigh_pairs(free, "coplanar", np.array([[a, b]]), options)
        gap = float(tests.deviation[0])
        conflict |= float(tests.wald[0]) > float(chi2.ppf(options.significance, 1))
        text += f", {100.0 * gap / free.diagonal:.2f} % of the scene apart"
    reason = f"Obeyed, but the views disagree: {text}." if conflict else f"Required by the person; {text}."
    return Relation(
        wish.kind,
        wish.faces,
        "conflicting" if conflict else "enforced",
        "person",
        float(np.degrees(deviation)),
        float(np.degrees(sigma)),
        gap,
        factor,
        None,
        reason,
    )


def _deviation(
    free: StructureSolution, kind: PairKind, a: int, b: int, part: StructureConstraints, options: DetectOptions
) -> tuple[float, float, float, float]:
    """Angle off (radians), its standard deviation, the Wald statistic and 2 ln BF of a required relation of two faces."""
    tests = weigh_pairs(free, "orthogonal" if kind == "orthogonal" else "parallel", np.array([[a, b]]), options)
    if kind == "orthogonal" and len(part.angle_cosine):
        # cos is measured up to its sign; the derivative of the angle by the cosine is 1 / sin.
        cosine = abs(float(free.normals[a] @ free.normals[b]))
        wanted = float(part.angle_cosine[0])
        sine = max(float(np.sqrt(max(1.0 - cosine * cosine, 0.0))), 1e-3)
        off = abs(float(np.arccos(min(cosine, 1.0)) - np.arccos(wanted)))
        sigma = float(tests.sigma[0]) / sine
        wald = off * off / (sigma * sigma + np.radians(options.as_built_angle_deg) ** 2)
        return off, sigma, float(wald), float(tests.log_bayes_factor[0])
    off = 2.0 * float(np.arcsin(min(0.5 * float(tests.deviation[0]), 1.0)))
    return off, float(tests.sigma[0]), float(tests.wald[0]), float(tests.log_bayes_factor[0])


def _priced(wish: SketchRelation, part: StructureConstraints, free: StructureSolution, solve: Solve, options: DetectOptions) -> Relation:
    """A relation that is no pair of angles: what enforcing it alone costs says whether the views agree."""
    cost = 2.0 * (solve(part).cost - free.cost)
    limit = 2.0 * float(chi2.ppf(options.significance, 3))
    if cost > limit:
        return _relation(wish, "conflicting", f"Obeyed, but the views disagree: it adds {cost:.0f} to twice the cost, where up to {limit:.0f} is noise.")
    return _relation(wish, "enforced", f"Required by the person; it adds {max(cost, 0.0):.1f} to twice the cost, where up to {limit:.0f} is noise.")


def _relation(wish: SketchRelation, state: RelationState, reason: str) -> Relation:
    return Relation(wish.kind, wish.faces, state, "person", None, None, None, None, None, reason)


def _forbidden(sketch: Sketch, wishes: list[SketchRelation]) -> tuple[Pair, ...]:
    row: dict[FaceId, int] = {face.id: f for f, face in enumerate(sketch.faces)}
    out: list[Pair] = []
    for wish in wishes:
        if wish.kind in PAIR_KINDS and len(wish.faces) == 2 and all(face in row for face in wish.faces):
            out.append((wish.kind, row[wish.faces[0]], row[wish.faces[1]]))
    return tuple(out)
