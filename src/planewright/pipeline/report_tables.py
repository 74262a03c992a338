"""The tables of the report. Everything that came from a file is text here and is escaped by the page."""

from dataclasses import dataclass

import numpy as np

from planewright.pipeline.result import Result, next_corrections, normal_sigmas_deg
from planewright.planes.planar_scene import PlanarScene
from planewright.relations.relation import Relation
from planewright.tracking.tracks import State, Tracks


@dataclass(frozen=True)
class Row:
    """One line of a table."""

    cells: tuple[str, ...]
    css: str = ""


@dataclass(frozen=True)
class Table:
    """A table with a caption; `numeric` columns are set to the right."""

    title: str
    head: tuple[str, ...]
    rows: tuple[Row, ...]
    numeric: frozenset[int] = frozenset()
    note: str = ""


def face_table(scene: PlanarScene) -> Table:
    """Every face: its plane and how sure it is."""
    sigmas = normal_sigmas_deg(scene)
    rows: list[Row] = []
    for f, face in enumerate(scene.sketch.faces):
        origin = ("found" if face.found else "given") + (", open" if face.open else "")
        holes = str(len(face.holes)) if face.holes else ""
        if scene.face_known[f]:
            normal = ", ".join(f"{value:+.3f}" for value in scene.normals[f])
            rows.append(Row((short(face.id), origin, str(len(face.loop)), holes, normal, f"{scene.offsets[f]:.4g}", f"{sigmas[f]:.2f}")))
        else:
            rows.append(Row((short(face.id), origin, str(len(face.loop)), holes, "not determined", "", ""), css="bad"))
    head = ("face", "origin", "corners", "holes", "normal", "offset", "sigma of normal, deg")
    return Table("Faces", head, tuple(rows), numeric=frozenset({2, 3, 5, 6}))


def relation_table(result: Result) -> Table:
    """Every relation that was looked at, with the decision and its reason."""
    rows = [
        Row(
            (
                relation.kind,
                ", ".join(short(face, 16) for face in relation.faces),
                relation.state,
                relation.source,
                "" if relation.order is None else str(relation.order),
                figure(relation.deviation_deg, relation.sigma_deg),
                relation.reason,
            ),
            css=relation.state,
        )
        for relation in sorted(result.structure.relations, key=_weight)
    ]
    return Table("Relations", ("kind", "faces", "state", "source", "order", "deviation, deg", "reason"), tuple(rows), numeric=frozenset({4, 5}))


def _weight(relation: Relation) -> tuple[int, int]:
    """What was enforced comes first, in its order; then what a person should look at."""
    return ("enforced", "conflicting", "ambiguous", "released").index(relation.state), relation.order or 0


def adjacency_table(result: Result) -> Table:
    """Which faces meet, where, and at which angle."""
    rows = [
        Row((", ".join(short(face) for face in pair.faces), ", ".join(short(end) for end in pair.edge), figure(pair.dihedral_deg, pair.sigma_deg)))
        for pair in result.structure.adjacency
    ]
    return Table("Adjacency", ("faces", "edge", "angle between the faces, deg"), tuple(rows), numeric=frozenset({2}))


def point_table(scene: PlanarScene, tracks: Tracks) -> Table:
    """Every corner: where it is, how sure, and in how many frames it was measured."""
    rows: list[Row] = []
    for i, point in enumerate(scene.sketch.points):
        states = tracks.state[tracks.point_index == i]
        counts = tuple(str(int(np.isin(states, kinds).sum())) for kinds in ([State.MARKED], [State.TRACKED, State.BRIDGED], [State.PREDICTED], [State.HIDDEN]))
        if scene.point_known[i]:
            where = ", ".join(f"{value:.4g}" for value in scene.points[i])
            variance = np.diag(scene.point_covariance[i])
            sigma = f"{np.sqrt(max(float(variance.max()), 0.0)):.2g}" if np.isfinite(variance).all() else ""
            rows.append(Row((short(point.id), where, sigma, *counts)))
        else:
            rows.append(Row((short(point.id), "not determined", "", *counts), css="bad"))
    head = ("corner", "position", "sigma", "marked", "measured", "predicted", "hidden")
    return Table("Corners", head, tuple(rows), numeric=frozenset({2, 3, 4, 5, 6}), note="The last four columns count frames.")


def correction_table(result: Result) -> Table:
    """The marks worth making next."""
    rows = [Row((short(mark.point), str(mark.frame), f"{mark.gain:.0f}", mark.reason)) for mark in next_corrections(result)]
    note = "Frames gained: in which the corner is expected to come from more than 5 px off to within." if rows else "Nothing is worth a correction."
    return Table("Next corrections", ("corner", "frame", "frames gained", "why"), tuple(rows), numeric=frozenset({1, 2}), note=note)


def figure(value: float | None, sigma: float | None) -> str:
    """Value ± sigma."""
    if value is None or not np.isfinite(value):
        return ""
    return f"{value:.2f}" + (f" ± {sigma:.2f}" if sigma is not None and np.isfinite(sigma) else "")


def short(text: str, length: int = 24) -> str:
    """A name from a file, cut to a length that a table can bear."""
    return text if len(text) <= length else f"{text[: length - 1]}…"
