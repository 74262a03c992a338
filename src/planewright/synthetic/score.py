"""A reconstruction against what is known to be true: every figure that the demo and the benchmarks print.

Reads `reconstruction.json` and one of three kinds of truth (docs/file-format.md): `planewright-truth` (everything is known),
`planewright-truth-tracks` (pixels of some corners), `planewright-truth-shape` (angles and length ratios of a real object).
A figure is None where there is nothing to measure it on.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from planewright.arrays import Bool, Float, Mat3, Vec3
from planewright.geometry.rigid import Rigid, rotation_angle

Figures = dict[str, float | int | str | None]

_MEASURED = ("marked", "tracked", "bridged")
_CHI2_95 = 5.991
"""95 % point of chi-square with two degrees of freedom."""
_PLANE_KINDS = ("parallel", "orthogonal", "coplanar")


def score(reconstruction: Mapping[str, Any], truth: Mapping[str, Any]) -> Figures:
    """All figures that this kind of truth allows; a single figure `refused` where the reconstruction is not well formed."""
    fault = first_fault(reconstruction)
    if fault is not None:
        return {"refused": fault}
    if truth["format"] == "planewright-truth-shape":
        return score_shape(reconstruction, truth)
    figures = score_tracks(reconstruction.get("tracks", {}), truth["tracks"])
    if truth["format"] == "planewright-truth":
        figures |= score_cameras(reconstruction, truth) | score_structure(reconstruction, truth) | score_relations(reconstruction, truth)
    figures["corrections"] = reconstruction.get("report", {}).get("corrections")
    return figures


def first_fault(reconstruction: Mapping[str, Any]) -> str | None:
    """What makes the file unfit to be measured, as a sentence: a number that is not finite, a normal that is no unit vector, an id twice."""

    def not_finite(value: Any, where: str) -> str | None:
        if isinstance(value, float):
            return None if np.isfinite(value) else f"{where} is {value}"
        children: list[tuple[Any, Any]] = []
        if isinstance(value, dict):
            children = list(value.items())
        elif isinstance(value, list):
            children = list(enumerate(value))
        for key, child in children:
            fault = not_finite(child, f"{where}.{key}")
            if fault is not None:
                return fault
        return None

    fault = not_finite(dict(reconstruction), "reconstruction")
    if fault is not None:
        return f"A number is not finite: {fault}."
    for face in reconstruction.get("faces", []):
        if face.get("normal") is not None and abs(np.linalg.norm(face["normal"]) - 1.0) > 1e-9:
            return f"The normal of face {face['id']} is no unit vector."
    for kind in ("points", "faces"):
        ids = [x["id"] for x in reconstruction.get(kind, [])]
        if len(set(ids)) < len(ids):
            return f"An id appears twice among the {kind}."
    return None


# --- tracks -----------------------------------------------------------------------------------------------------------


def score_tracks(found: Mapping[str, Any], truth: Mapping[str, Any]) -> Figures:
    """Corner errors in pixels over every truly visible corner-frame, visibility, and whether the claimed sigma holds.

    found: point id -> frame -> entry of `reconstruction.json`. truth: point id -> {xy, visible, in_image} lists, or -> frame -> [x, y].
    Percentages are of all visible corner-frames, so that what is not claimed counts as missed.
    """
    error: list[float] = []  # of visible corner-frames with a position
    claims: list[tuple[float, float]] = []  # error and sigma of visible, measured ones
    visible, seen, inside = (np.zeros(0, np.bool_) for _ in range(3))
    for point, known in truth.items():
        frames, xy, is_visible, is_inside = _track_rows(known)
        entries = [found.get(point, {}).get(str(k)) for k in frames]
        measured = np.array([e is not None and e.get("state") in _MEASURED for e in entries], np.bool_)
        visible, seen, inside = np.append(visible, is_visible), np.append(seen, measured), np.append(inside, is_inside)
        for row in np.flatnonzero(is_visible):
            entry = entries[row]
            if entry is None or entry.get("state") == "hidden" or entry.get("xy") is None:
                continue
            away = float(np.hypot(*(np.asarray(entry["xy"], float) - xy[row])))
            error.append(away)
            if measured[row]:
                claims.append((away, float(entry.get("sigma") or 0.0)))
    e, total = np.array(error), max(int(visible.sum()), 1)
    figures: Figures = {
        "visible": int(visible.sum()),
        "claimed_pct": 100.0 * len(e) / total,
        "rmse_px": float(np.sqrt((e**2).mean())) if len(e) else None,
        "median_px": float(np.median(e)) if len(e) else None,
    }
    figures |= {f"within_{k}px_pct": 100.0 * float((e <= k).sum()) / total for k in (1, 2, 3, 5)}
    figures["visibility_f1"] = _f1(seen[inside], visible[inside]) or 0.0
    figures["hidden_f1"] = _f1(~seen[inside], ~visible[inside]) if (inside & ~visible).any() else None
    away, sigma = np.array(claims).reshape(-1, 2).T
    figures["without_sigma"] = int((sigma == 0).sum())
    if len(sigma):
        figures["coverage95_pct"] = 100.0 * float((away**2 <= _CHI2_95 * sigma**2).mean())
        figures["sigma_median_px"] = float(np.median(sigma))
    return figures


def _track_rows(known: Mapping[str, Any]) -> tuple[list[int], Float[np.ndarray, "rows 2"], Bool[np.ndarray, "rows"], Bool[np.ndarray, "rows"]]:
    """Frames, pixels, visible, in the image of one true track."""
    if "xy" in known:
        return list(range(len(known["xy"]))), np.array(known["xy"], float), np.array(known["visible"], np.bool_), np.array(known["in_image"], np.bool_)
    yes = np.ones(len(known), np.bool_)
    return [int(k) for k in known], np.array(list(known.values()), float).reshape(-1, 2), yes, yes


def _f1(claimed: Bool[np.ndarray, "n"], actual: Bool[np.ndarray, "n"]) -> float | None:
    """Harmonic mean of precision and recall."""
    both = int(claimed.sum()) + int(actual.sum())
    return 2.0 * int((claimed & actual).sum()) / both if both else None


# --- cameras ----------------------------------------------------------------------------------------------------------


def similarity(source: Float[np.ndarray, "points 3"], target: Float[np.ndarray, "points 3"]) -> tuple[float, Rigid]:
    """Scale s and motion with target ~ motion.rotation @ (s source) + motion.translation in the least-squares sense (Umeyama 1991, eqs. 38-42)."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    u, d, vt = np.linalg.svd((target - b).T @ (source - a))
    flip = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * flip) @ vt
    scale = float((d * flip).sum() / max(((source - a) ** 2).sum(), 1e-30))
    return scale, Rigid(rotation, b - scale * rotation @ a)


def _poses(frames: Sequence[Mapping[str, Any]]) -> dict[int, Rigid]:
    return {
        f["index"]: Rigid(np.array(f["cam_from_world"]["rotation"], float), np.array(f["cam_from_world"]["translation"], float))
        for f in frames
        if f.get("cam_from_world")
    }


def _true_points(truth: Mapping[str, Any]) -> tuple[dict[str, Vec3], float]:
    """Corners by id, and the diagonal of the box around them."""
    points = {p["id"]: np.array(p["xyz"], float) for p in truth["points"]}
    return points, float(np.linalg.norm(np.ptp(np.array(list(points.values())), axis=0)))


def score_cameras(reconstruction: Mapping[str, Any], truth: Mapping[str, Any]) -> Figures:
    """Focal length (signed, percent), positions after a similarity (percent of the scene's diagonal), rotations after the best common turn (degrees)."""
    points, diagonal = _true_points(truth)
    true = _poses(truth["frames"])
    ours = {k: pose for k, pose in _poses(reconstruction.get("frames", [])).items() if k in true}
    figures: Figures = {
        "focal_error_pct": 100.0 * (reconstruction["camera"]["focal"][0] / truth["camera"]["focal"][0] - 1.0),
        "cameras": f"{len(ours)}/{len(true)}",
        "cameras_pct": 100.0 * len(ours) / len(true),
    }
    if len(ours) < 3:
        return figures
    mine, known = (np.array([-poses[k].rotation.T @ poses[k].translation for k in ours]) for poses in (ours, true))
    scale, motion = similarity(mine, known)
    ate = float(np.sqrt((np.linalg.norm(scale * mine @ motion.rotation.T + motion.translation - known, axis=1) ** 2).mean()))
    distance = float(np.median(np.linalg.norm(known - np.mean(list(points.values()), axis=0), axis=1)))
    turn = _common_turn([ours[k].rotation for k in ours], [true[k].rotation for k in ours])
    angles = np.degrees([rotation_angle(ours[k].rotation @ turn.T, true[k].rotation) for k in ours])
    return figures | {
        "ate_pct": 100.0 * ate / diagonal,
        "ate_of_distance_pct": 100.0 * ate / distance,
        "rotation_median_deg": float(np.median(angles)),
        "rotation_max_deg": float(angles.max()),
    }


def _common_turn(ours: Sequence[Mat3], true: Sequence[Mat3]) -> Mat3:
    """The true world from ours, by the rotations alone: the chordal mean."""
    u, _, vt = np.linalg.svd(sum((t.T @ o for o, t in zip(ours, true, strict=True)), np.zeros((3, 3))))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


# --- structure --------------------------------------------------------------------------------------------------------


def score_structure(reconstruction: Mapping[str, Any], truth: Mapping[str, Any]) -> Figures:
    """Corners and planes after a similarity that aligns the corners, how exact the planes are, and whether the right faces were found.

    Corners and offsets in percent of the true diagonal; normals in degrees, sides not told apart; `planarity_max` as a share of the diagonal.
    """
    known, diagonal = _true_points(truth)
    mine = {p["id"]: np.array(p["xyz"], float) for p in reconstruction.get("points", []) if p.get("xyz") is not None}
    common = [k for k in mine if k in known]
    figures: Figures = {"points": f"{len(common)}/{len(known)}", "points_pct": 100.0 * len(common) / len(known)}
    if len(common) < 4:
        return figures
    scale, motion = similarity(np.array([mine[k] for k in common]), np.array([known[k] for k in common]))
    error = np.array([np.linalg.norm(scale * motion.rotation @ mine[k] + motion.translation - known[k]) for k in common]) / diagonal
    figures |= {
        "corner_rms_pct": 100.0 * float(np.sqrt((error**2).mean())),
        "corner_max_pct": 100.0 * float(error.max()),
        "corner_worst": common[int(error.argmax())],
    }
    names = match_faces(reconstruction.get("faces", []), truth["faces"])
    true_faces = {f["id"]: f for f in truth["faces"]}
    tilt: dict[str, float] = {}
    shift: list[float] = []
    off_plane = 0.0
    for face in reconstruction.get("faces", []):
        if face.get("normal") is None:
            continue
        normal = np.array(face["normal"], float)
        for corner in (*face["loop"], *(c for hole in face.get("holes", []) for c in hole)):
            if corner in mine:
                off_plane = max(off_plane, abs(float(normal @ mine[corner]) - face["offset"]) * scale / diagonal)
        name = names.get(face["id"])
        if name is None:
            continue
        turned = motion.rotation @ normal
        tilt[name] = _line_angle_deg(turned, np.array(true_faces[name]["normal"], float))
        middle = np.mean([known[k] for k in true_faces[name]["loop"]], axis=0)
        shift.append(100.0 * abs(float(turned @ (middle - motion.translation)) - scale * face["offset"]) / diagonal)
    drawn, wanted = ({frozenset(f["loop"]) for f in faces} for faces in (reconstruction.get("faces", []), truth["faces"]))
    figures |= {
        "faces": f"{len(tilt)}/{len(true_faces)}",
        "faces_pct": 100.0 * len(tilt) / len(true_faces),
        "faces_found_f1": 2.0 * len(drawn & wanted) / max(len(drawn) + len(wanted), 1),
        "planarity_max": off_plane,
    }
    if tilt:
        angles = np.array(list(tilt.values()))
        figures |= {
            "normal_mean_deg": float(angles.mean()),
            "normal_median_deg": float(np.median(angles)),
            "normal_max_deg": float(angles.max()),
            "normal_worst": max(tilt, key=lambda k: tilt[k]),
            "offset_median_pct": float(np.median(shift)),
        }
    return figures


def _line_angle_deg(a: Vec3, b: Vec3) -> float:
    """Angle between two directions whose signs do not matter; accurate near zero and near a right angle."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b))))


def match_faces(found: Sequence[Mapping[str, Any]], truth: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Id of a found face -> id of the true one: the same id, else the loop that shares most corners (at least 60 % of both together)."""
    loops = {t["id"]: set(t["loop"]) for t in truth}
    names: dict[str, str] = {}
    for face in found:
        if face["id"] in loops:
            names[face["id"]] = face["id"]
            continue
        corners = set(face["loop"])
        shared = {k: len(corners & loop) / len(corners | loop) for k, loop in loops.items()}
        best = max(shared, key=lambda k: shared[k])
        if shared[best] >= 0.6:
            names[face["id"]] = best
    return names


# --- relations --------------------------------------------------------------------------------------------------------


def score_relations(reconstruction: Mapping[str, Any], truth: Mapping[str, Any]) -> Figures:
    """Precision and recall of the enforced relations of planes, closed under transitivity; near misses enforced by mistake; the largest residual in radians."""
    points, diagonal = _true_points(truth)
    mine = {p["id"]: np.array(p["xyz"], float) for p in reconstruction.get("points", []) if p.get("xyz") is not None}
    common = [k for k in mine if k in points]
    if len(common) < 4:
        return {}
    scale, _ = similarity(np.array([mine[k] for k in common]), np.array([points[k] for k in common]))
    planes = {f["id"]: (np.array(f["normal"], float), float(f["offset"])) for f in reconstruction.get("faces", []) if f.get("normal") is not None}
    names = match_faces(reconstruction.get("faces", []), truth["faces"])
    enforced = [r for r in reconstruction.get("relations", []) if r.get("state") == "enforced"]
    between = [r for r in enforced if r.get("kind") in _PLANE_KINDS]
    whole = [r for r in between if len(r["faces"]) == 2 and all(f in planes for f in r["faces"])]
    residual = 0.0
    for relation in whole:
        (a, offset_a), (b, offset_b) = (planes[f] for f in relation["faces"])
        off = abs(float(a @ b)) if relation["kind"] == "orthogonal" else float(np.linalg.norm(np.cross(a, b)))
        residual = max(residual, off)
        if relation["kind"] == "coplanar":
            residual = max(residual, abs(offset_a - float(np.sign(a @ b)) * offset_b) * scale / diagonal)
    figures: Figures = {
        "relations_other": len(enforced) - len(between),
        "relations_without_plane": len(between) - len(whole),
        "relation_residual_max": residual,
    }
    triples = [(r["kind"], names[r["faces"][0]], names[r["faces"][1]]) for r in whole if all(f in names for f in r["faces"])]
    implied = close([f["id"] for f in truth["faces"]], triples)
    for kind in _PLANE_KINDS:
        wanted = {frozenset(pair) for pair in truth["relations"][kind]}
        right = len(implied[kind] & wanted)
        figures[f"{kind}_precision"] = right / len(implied[kind]) if implied[kind] else None
        figures[f"{kind}_recall"] = right / len(wanted) if wanted else None
    near = [(str(m["kind"]).removeprefix("near_"), frozenset((m["a"], m["b"]))) for m in truth.get("near_misses", [])]
    figures["near_misses_enforced"] = f"{sum(pair in implied[kind] for kind, pair in near)}/{len(near)}"
    return figures


def close(faces: Sequence[str], relations: Sequence[tuple[str, str, str]]) -> dict[str, set[frozenset[str]]]:
    """All pairs that follow from the relations (kind, a, b): what is parallel to parallels is parallel, and right angles carry over to them."""
    direction = _groups(faces, [(a, b) for kind, a, b in relations if kind in ("parallel", "coplanar")])
    plane = _groups(faces, [(a, b) for kind, a, b in relations if kind == "coplanar"])
    crossed = {frozenset((direction[a], direction[b])) for kind, a, b in relations if kind == "orthogonal"}
    implied: dict[str, set[frozenset[str]]] = {kind: set() for kind in _PLANE_KINDS}
    for a, b in combinations(faces, 2):
        if direction[a] == direction[b]:
            implied["parallel"].add(frozenset((a, b)))
        elif frozenset((direction[a], direction[b])) in crossed:
            implied["orthogonal"].add(frozenset((a, b)))
        if plane[a] == plane[b]:
            implied["coplanar"].add(frozenset((a, b)))
    return implied


def _groups(items: Sequence[str], pairs: Sequence[tuple[str, str]]) -> dict[str, str]:
    """A representative for each item, the same for all that the pairs connect."""
    group = {k: k for k in items}
    for a, b in pairs:
        old, new = group[a], group[b]
        group = {k: new if g == old else g for k, g in group.items()}
    return group


# --- shape ------------------------------------------------------------------------------------------------------------


def score_shape(reconstruction: Mapping[str, Any], truth: Mapping[str, Any]) -> Figures:
    """Known angles between faces (degrees) and lengths of edges (percent, after one common scale: the median of the ratios)."""
    points = {p["id"]: np.array(p["xyz"], float) for p in reconstruction.get("points", []) if p.get("xyz") is not None}
    normals = {f["id"]: np.array(f["normal"], float) for f in reconstruction.get("faces", []) if f.get("normal") is not None}
    angles = [(normals[a], normals[b], x["deg"]) for x in truth["angles"] for a, b in [x["faces"]] if a in normals and b in normals]
    off = np.array([abs(_line_angle_deg(a, b) - deg) for a, b, deg in angles])
    edges = [(points[a], points[b], x["length"]) for x in truth["edge_lengths"] for a, b in [x["edge"]] if a in points and b in points]
    ratio = np.array([np.linalg.norm(a - b) / length for a, b, length in edges])
    figures: Figures = {
        "angles_pct": 100.0 * len(off) / len(truth["angles"]) if truth["angles"] else None,
        "edges_pct": 100.0 * len(ratio) / len(truth["edge_lengths"]) if truth["edge_lengths"] else None,
    }
    if len(off):
        figures |= {"angle_error_median_deg": float(np.median(off)), "angle_error_max_deg": float(off.max())}
    if len(ratio):
        spread = 100.0 * np.abs(ratio / np.median(ratio) - 1.0)
        figures |= {"length_error_median_pct": float(np.median(spread)), "length_error_max_pct": float(spread.max())}
    return figures
