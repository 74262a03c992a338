"""The sketch lifted to 3D: which plane each face lies on, and from that where the corners are.

Each face gathers hypotheses (planes that the pixels agree with) from every frame in which three of its corners are located.
A hypothesis may be wrong though its pixels agree: what stands in front of a hidden face is a plane too. So the set is chosen
together: planes must meet the click rays of shared corners at the same depth, and two faces may not explain the same pixels
by the same plane. What is known then locates further corners, in further frames, and the faces left over try again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from planewright.arrays import Bool, Float, Int, UInt8, Vec3
from planewright.geometry.plane import fit_plane
from planewright.lifting.choice import choose_labels
from planewright.lifting.photometric import (
    PhotometricOptions,
    PhotometricPlane,
    Reference,
    dominant_plane,
    hypotheses,
    photo_cost,
    plane_from_scene_points,
    plane_from_world,
    plane_to_world,
    reference_from_mask,
    relative_sigma,
)
from planewright.lifting.rays import MarkRays, mark_rays, meet, triangulate_marks
from planewright.lifting.views import Views
from planewright.progress import Progress, silent
from planewright.sfm.cameras import ScenePoints
from planewright.sketch.graph import Sketch


@dataclass(frozen=True, kw_only=True)
class LiftOptions:
    """How the sketch is lifted."""

    photometric: PhotometricOptions = field(default_factory=PhotometricOptions)
    click_sigma: float = 1.0
    """Standard deviation of a click an axis, pixels of the clip."""
    plane_sigma: float = 3.0
    """Depth error allowed to a plane on top of what the click gives, in pixels of motion (`Views.depth_per_pixel`); formal sigmas of
    planes are far too small."""
    rounds: int = 5
    """How often faces that found no plane try again with the corners known by then."""
    same_depth: float = 2.5
    """A face is hidden by another drawn over it that stands this far before it, in pixels of motion."""
    witness_frames: int = 4
    """Scene features count as seen in a view when they were observed within this many frames of it."""
    behind: float = 6.0
    """A feature seen inside a face's polygon contradicts a plane that it lies behind by more than this, in pixels of motion: faces are opaque."""
    worth: float = 0.25
    """A plane must explain the pixels it shares with another drawn face better than that face's by this much a pixel (log-likelihood)."""


AGREEMENT = 4.0
"""What a plane with which nearly all pixels agree earns; one at which the views agree to a ZNCC of 0.4 earns nothing."""
CORNERS = 1.5
"""What a plane through three corners that are known by other faces earns; through more, twice that."""
LOOSE = 0.1
"""A plane on which the pixels leave a corner's depth open by more than this share says nothing about it: the front of a bare box hung by three
of its corners that way, and took the fourth a hundred pixels off its mark."""
WEAK = 1.0
"""A plane from pixels that earns less does not stand against one through corners."""
WITNESS = 1.2
"""What each feature costs that is seen through a face, above a quarter of those inside it, and up to ten of them."""

EXPLAINED = 40.0
"""Energy a share of pixels that other faces explain, above 0.3: nothing else outweighs a face all of whose pixels show others."""


PATCH = 5
"""Working pixels to each side of a point that is located as a patch of its own. Corners of four clips with truth, taken as points without
faces: median depth error 1.1, .8, 2.2, 2.8 pixels of motion with 5; 1.2, 1.3, 5.0, 3.1 with 7; 1.4, 1.1, 8.6, 4.7 with 10."""
DEPTHS = 0.3
"""Spread of the logarithms of depths in a scene."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A plane a face may lie on."""

    normal: Vec3
    offset: float
    quality: float
    """Mean ZNCC over the views; NaN where pixels did not take part."""
    view: int
    """View in which it was found, -1 where it comes from corners."""
    probe: Float[np.ndarray, "probe 3"]
    """Points of the plane spread over the face, as seen in that view."""
    covered: Bool[np.ndarray, "probe faces"]
    """Which other faces are drawn over each of them in that view."""
    found: PhotometricPlane | None = None
    """The pixels' own account, where there is one."""
    support: float = 1.0
    """Where it comes from corners or scene features: how much speaks for it."""
    agreed: bool = False
    """Where it comes from corners: whether the pixels agree with it as well as with a plane of their own."""
    seen_through: float = 0.0
    """How many scene features inside the face were seen behind the plane, above a quarter of them."""

    @property
    def energy(self) -> float:
        """What choosing it costs by itself; negative where it earns."""
        earned = CORNERS * self.support if self.found is None else AGREEMENT * float(np.clip((self.quality - 0.4) / 0.5, -1.0, 1.1))
        return WITNESS * min(self.seen_through, 10.0) - earned


@dataclass(frozen=True, eq=False)
class Lifted:
    """The first 3D state of the sketch."""

    points: Float[np.ndarray, "points 3"]
    point_known: Bool[np.ndarray, "points"]
    normals: Float[np.ndarray, "faces 3"]
    """Towards the cameras that saw the face; where it comes from corners, towards one in which they were marked."""
    offsets: Float[np.ndarray, "faces"]
    face_known: Bool[np.ndarray, "faces"]
    from_pixels: Bool[np.ndarray, "faces"]
    """False where the plane only comes from corners known otherwise."""
    plane_sigma: Float[np.ndarray, "faces"]
    """How sure the pixels are of a plane: the relative standard deviation of the depth of the face's corners on it, the largest of them; zero
    where it does not come from pixels."""
    corners: tuple[tuple[int, ...], ...]
    """Rows of each face's corners, holes included."""


@dataclass(frozen=True, eq=False)
class Witnesses:
    """Scene features seen inside a face's polygon about the time of a view."""

    xy: Float[np.ndarray, "n 2"]
    """Array coordinates."""
    rho: Float[np.ndarray, "n"]
    """Inverse depth there."""
    sigma: Float[np.ndarray, "n"]
    """Relative standard deviation of the depth."""


class _Lifter:
    """The state of one lift: located corners and the hypotheses of each face."""

    def __init__(self, views: Views, sketch: Sketch, scene: ScenePoints, options: LiftOptions, rng: np.random.Generator):
        self.views, self.sketch, self.scene, self.options, self.rng = views, sketch, scene, options, rng
        self.rays: MarkRays = mark_rays(views, sketch)
        row = {point.id: i for i, point in enumerate(sketch.points)}
        self.loops = [[row[c] for c in face.loop] for face in sketch.faces]
        self.holes = [[[row[c] for c in hole] for hole in face.holes] for face in sketch.faces]
        self.corners = [[*loop, *(c for hole in holes for c in hole)] for loop, holes in zip(self.loops, self.holes, strict=True)]
        self.num_faces, self.num_points = len(sketch.faces), len(sketch.points)
        self.faces_at = np.bincount([c for corners in self.corners for c in set(corners)], minlength=self.num_points)
        self.points = np.full((self.num_points, 3), np.nan)
        self.known = np.zeros(self.num_points, bool)
        self.spread = np.full(self.num_points, np.inf)  # relative depth sigma of known points
        self.told_by: list[set[int]] = [set() for _ in range(self.num_points)]  # faces that located each corner
        self.found: list[list[Hypothesis]] = [[] for _ in range(self.num_faces)]
        self.masks: dict[int, dict[int, UInt8[np.ndarray, "height width"]]] = {}
        self.tried: set[tuple[int, int, int]] = set()
        self.choice: list[Hypothesis | None] = [None] * self.num_faces
        self.planes_of_scene: list[tuple[Vec3, float]] | None = None
        self.rho_ranges: dict[int, tuple[float, float]] = {}
        self.mark_sigma = options.click_sigma * views.scale
        self.plane_sigma = options.plane_sigma * views.depth_per_pixel
        self.same_depth = options.same_depth * views.depth_per_pixel
        self.triangulated = self.triangulate()

    def triangulate(self) -> dict[int, tuple[float, float]]:
        """Corners marked in frames far enough apart: depth along the first mark's ray, and its relative sigma."""
        out: dict[int, tuple[float, float]] = {}
        for c in range(self.num_points):
            rows = self.rays.of_point(c)
            hit = triangulate_marks(self.rays, rows)
            if hit is None or hit[1] < np.radians(4.0):
                continue
            first = rows[0]
            depth = float((hit[0] - self.rays.origin[first]) @ self.views.rotation[self.rays.view[first]][2])
            if depth > 0:
                out[c] = (depth, float(2.0 * self.mark_sigma / (self.views.calibration[0, 0] * np.sin(hit[1]))))
        return out

    # -- polygons -----------------------------------------------------------------------------------------------

    def located(self, view: int, corners: Sequence[int]) -> list[tuple[float, float] | None]:
        """Where corners are in a view: marked there, or known in 3D and projected; None elsewhere. Array coordinates."""
        out: list[tuple[float, float] | None] = []
        p = self.views.projections[view]
        for c in corners:
            rows = np.nonzero((self.rays.point == c) & (self.rays.view == view))[0]
            if len(rows):
                x, y = self.rays.xy[rows[0]]
                out.append((float(x) - 0.5, float(y) - 0.5))
            elif self.known[c]:
                q = p @ np.append(self.points[c], 1.0)
                out.append((float(q[0] / q[2]) - 0.5, float(q[1] / q[2]) - 0.5) if q[2] > 1e-9 else None)
            else:
                out.append(None)
        return out

    def mask(self, view: int, face: int) -> tuple[UInt8[np.ndarray, "height width"], Float[np.ndarray, "corners 2"]] | None:
        """The face's polygon in a view (1 inside, holes 0), from at least three located corners of its loop."""
        loop = [xy for xy in self.located(view, self.loops[face]) if xy is not None]
        if len(loop) < 3:
            return None
        height, width = self.views.images.shape[1:]
        mask = np.zeros((height, width), np.uint8)
        polygon = np.clip(np.array(loop), -4 * max(width, height), 5 * max(width, height))
        cv2.fillPoly(mask, [np.round(polygon * 16).astype(np.int32)], 1, shift=4)
        for hole in self.holes[face]:
            border = [xy for xy in self.located(view, hole) if xy is not None]
            if len(border) >= 3:
                cv2.fillPoly(mask, [np.round(np.array(border) * 16).astype(np.int32)], 0, shift=4)
        return mask, polygon

    def rho_range(self, view: int) -> tuple[float, float] | None:
        """Inverse depths worth trying in a view: those of the scene features, with room on both sides."""
        if view not in self.rho_ranges:
            z = self.scene.xyz @ self.views.rotation[view][2] + self.views.translation[view][2]
            z = z[z > 0]
            if len(z) < 8:
                return None
            near, far = np.percentile(z, [1.0, 98.0])
            room = far - near
            self.rho_ranges[view] = (1.0 / min(1.4 * far, far + 0.5 * room), 1.0 / max(0.75 * near, near - 0.4 * room))
        return self.rho_ranges[view]

    # -- hypotheses ---------------------------------------------------------------------------------------------

    def mark_views(self, corners: Sequence[int]) -> list[int]:
        """Views in which any of the corners is marked, the one with most marks first."""
        of_corner = np.isin(self.rays.point, corners)
        views, counts = np.unique(self.rays.view[of_corner], return_counts=True)
        return [int(v) for v in views[np.argsort(-counts, kind="stable")]]

    def search(self, face: int) -> None:
        """Hypotheses of a face from every view with marks in which three of its corners are located and which was not tried so."""
        for view in self.mark_views(self.corners[face])[:4]:
            located = sum(xy is not None for xy in self.located(view, self.loops[face]))
            if located < 3 or (face, view, located) in self.tried:
                continue
            self.tried.add((face, view, located))
            self.found[face] += self.search_view(face, view)

    def search_scene(self, face: int) -> None:
        """Hypotheses of a face of which no view shows three located corners: the planes on which most of the scene lies tell where its
        corners would be, and so where to look."""
        rows = [self.rays.of_point(c)[0] for c in self.loops[face] if len(self.rays.of_point(c))]
        if len(rows) < 3 or any(f == face for f, *_ in self.tried):
            return
        self.tried.add((face, -1, 0))
        corners = [int(self.rays.point[row]) for row in rows]
        kept = self.points[corners].copy(), self.known[corners].copy()
        for normal, offset in self.scene_planes():
            depth, _ = meet(self.rays, np.array(rows), normal, offset)
            low, high = np.percentile(np.linalg.norm(self.scene.xyz[:, None] - self.views.centers[None, ::20], axis=2), [0.5, 99.5])
            if (depth < 0.5 * low).any() or (depth > 3.0 * high).any():
                continue
            self.points[corners] = self.rays.origin[rows] + depth[:, None] * self.rays.direction[rows]
            self.known[corners] = True
            areas = [0 if (drawn := self.mask(v, face)) is None else int(drawn[0].sum()) for v in range(len(self.views.frame))]
            for view in np.argsort(-np.array(areas), kind="stable")[:1]:
                if areas[view] > 400:
                    self.found[face] += self.search_view(face, int(view))
            self.points[corners], self.known[corners] = kept

    def scene_planes(self) -> list[tuple[Vec3, float]]:
        """Up to six planes on which many of the scene's features lie, most first."""
        if self.planes_of_scene is None:
            self.planes_of_scene = []
            left = self.scene.xyz
            distance = float(np.median(np.linalg.norm(left - self.views.centers.mean(axis=0), axis=1))) if len(left) else 1.0
            tolerance = 2.0 * self.views.depth_per_pixel * distance
            while len(self.planes_of_scene) < 6 and len(left) >= 30:
                best = np.zeros(len(left), bool)
                for _ in range(300):
                    a, b, c = left[self.rng.choice(len(left), 3, replace=False)]
                    normal = np.cross(b - a, c - a)
                    size = float(np.linalg.norm(normal))
                    if size > 1e-12:
                        on = np.abs((left - a) @ normal) < tolerance * size
                        best = on if on.sum() > best.sum() else best
                if best.sum() < max(20, 0.02 * len(self.scene.xyz)):
                    break
                self.planes_of_scene.append(fit_plane(left[best], np.ones(int(best.sum()))))
                left = left[~best]
        return self.planes_of_scene

    def search_view(self, face: int, view: int) -> list[Hypothesis]:
        drawn = self.mask(view, face)
        rho_range = self.rho_range(view)
        if drawn is None or rho_range is None:
            return []
        mask, polygon = drawn
        area = max(int(mask.sum()), 1)
        others: dict[int, UInt8[np.ndarray, "height width"]] = {}
        free = mask.copy()
        for other in range(self.num_faces):
            if other == face or (theirs := self.mask(view, other)) is None:
                continue
            shared = theirs[0] & mask
            if not shared.any():
                continue
            others[other] = theirs[0]
            # what is drawn smaller over this face stands in front of it, as a rule
            if theirs[0].sum() < 0.6 * area:
                free[np.asarray(cv2.dilate(theirs[0], np.ones((5, 5), np.uint8))) > 0] = 0
        if free.sum() < 0.25 * area:
            free = mask
        inner = cv2.erode(free, np.ones((5, 5), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
        if inner.sum() < 60:
            inner = cv2.erode(free, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
        reference = reference_from_mask(self.views, view, inner > 0, self.options.photometric)
        if reference is None:
            return []
        starts = [start for start in [plane_from_scene_points(self.views, reference, polygon, self.scene.xyz, self.rng)] if start is not None]
        starts += self.hinges(face, reference)
        starts += self.through_corners(face, reference)
        planes = hypotheses(self.views, reference, rho_range, starts, self.options.photometric)
        self.masks.setdefault(view, {}).update(others)
        probes = reference.pixels[:: max(1, len(reference.pixels) // 24)].astype(int)
        covered = np.zeros((len(probes), self.num_faces), bool)
        for other, theirs in others.items():
            covered[:, other] = theirs[probes[:, 1], probes[:, 0]] > 0
        out: list[Hypothesis] = []
        witnesses = self.witnesses(view, inner > 0)
        through = [self.seen_through(reference, found.plane, witnesses) for found in planes]
        best = max((agreement(found) for found, count in zip(planes, through, strict=True) if count < 3), default=0.0)
        for found, count in zip(planes, through, strict=True):
            normal, offset = plane_to_world(self.views, reference, found.plane)
            if self.looseness(face, found, normal, offset) > LOOSE:
                continue
            # of two planes for the same pixels, a clearly worse one needs much to speak for it
            quality = agreement(found) - 3.0 * max(best - agreement(found), 0.0)
            out.append(Hypothesis(normal, offset, quality, view, self.on_plane(view, probes + 0.5, normal, offset), covered, found, seen_through=count))
        return [*out, *self.from_witnesses(view, reference, polygon, witnesses, covered, probes)]

    def looseness(self, face: int, found: PhotometricPlane, normal: Vec3, offset: float) -> float:
        """Largest relative standard deviation of the depth of a marked corner on a plane, as its pixels know it."""
        rows = np.array([self.rays.of_point(c)[0] for c in self.corners[face] if len(self.rays.of_point(c))], int)
        depth, _ = meet(self.rays, rows, normal, offset)
        corners = self.rays.origin[rows] + depth[:, None] * self.rays.direction[rows]
        return max((relative_sigma(self.views, found, at) for at in corners), default=0.0)

    def witnesses(self, view: int, mask: Bool[np.ndarray, "height width"]) -> Witnesses:
        """Scene features observed about the time of a view that lie inside a mask there."""
        frame, near = int(self.views.frame[view]), self.options.witness_frames
        seen = (self.scene.seen[:, 0] <= frame + near) & (self.scene.seen[:, 1] >= frame - near)
        cam = self.scene.xyz[seen] @ self.views.rotation[view].T + self.views.translation[view]
        ahead = cam[:, 2] > 1e-6
        axis, cam = self.views.rotation[view][2], cam[ahead]
        sigma = np.sqrt(np.einsum("i,nij,j->n", axis, self.scene.covariance[seen][ahead], axis)) / cam[:, 2]
        k = self.views.calibration
        xy = (cam[:, :2] / cam[:, 2:]) @ k[:2, :2].T + k[:2, 2] - 0.5
        x, y = (np.rint(v).astype(int) for v in xy.T)
        inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
        inside[inside] = mask[y[inside], x[inside]]
        return Witnesses(xy[inside], 1.0 / cam[inside, 2], sigma[inside])

    def seen_through(self, reference: Reference, plane: Vec3, witnesses: Witnesses) -> float:
        """How many features lie behind a plane through which they were seen, less a quarter of all: some are wrong, others seen beside what is drawn."""
        rho = witnesses.rho
        basis = np.concatenate([(witnesses.xy - reference.center) / reference.radius, np.ones((len(rho), 1))], axis=1)
        there = basis @ plane
        behind = rho < there * (1.0 - np.maximum(self.options.behind * self.views.depth_per_pixel, 5.0 * witnesses.sigma))
        return max(0.0, float(behind.sum()) - 0.25 * len(rho))

    def from_witnesses(
        self,
        view: int,
        reference: Reference,
        polygon: Float[np.ndarray, "corners 2"],
        witnesses: Witnesses,
        covered: Bool[np.ndarray, "probe faces"],
        probes: Int[np.ndarray, "probe 2"],
    ) -> list[Hypothesis]:
        """The plane of the scene features seen through what stands before the face: features behind the plane most of them lie on."""
        rho = witnesses.rho
        basis = np.concatenate([(witnesses.xy - reference.center) / reference.radius, np.ones((len(rho), 1))], axis=1)
        left = np.ones(len(rho), bool)
        tolerance = 0.5 * self.options.behind * self.views.depth_per_pixel
        for _ in range(4):
            plane = dominant_plane(basis[left], rho[left], tolerance, self.rng)
            if plane is None or plane[2] <= 0 or (reference.basis @ plane).min() <= 0:
                return []
            through = self.seen_through(reference, plane, witnesses)
            on = np.abs(basis @ plane - rho) < tolerance * rho
            if through < 3 and on.sum() >= 8:
                normal, offset = plane_to_world(self.views, reference, plane)
                probe = self.on_plane(view, probes + 0.5, normal, offset)
                return [Hypothesis(normal, offset, float("nan"), view, probe, covered, support=min(float(on.sum()) / 8.0, 2.0), seen_through=through)]
            left &= rho < (basis @ plane) * (1.0 - tolerance)
        return []

    def through_corners(self, face: int, reference: Reference) -> list[Vec3]:
        """The plane through the known corners of the face, as a start."""
        planes = [plane_from_world(self.views, reference, guess.normal, guess.offset) for guess in self.planes_through(face)[:1]]
        return [plane for plane in planes if plane is not None and plane[2] > 0 and (reference.basis @ plane).min() > 0]

    def on_plane(self, view: int, pixels: Float[np.ndarray, "probe 2"], normal: Vec3, offset: float) -> Float[np.ndarray, "probe 3"]:
        """World points of the plane at pixels of a view."""
        rays = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ np.linalg.inv(self.views.calibration).T
        directions = rays @ self.views.rotation[view]
        center = self.views.centers[view]
        along = directions @ normal
        along = np.where(np.abs(along) < 1e-9, 1e-9, along)
        return center + directions * ((offset - center @ normal) / along)[:, None]

    def hinges(self, face: int, reference: Reference) -> list[Vec3]:
        """Planes through two known corners of the face, the best of a fan of tilts as the pixels see it."""
        known = [c for c in self.corners[face] if self.known[c]]
        if not len(known) >= 2:
            return []
        pairs = [(a, b) for i, a in enumerate(known) for b in known[i + 1 :]]
        a, b = max(pairs, key=lambda pair: float(np.linalg.norm(self.points[pair[0]] - self.points[pair[1]])))
        axis = self.points[b] - self.points[a]
        if np.linalg.norm(axis) < 1e-12:
            return []
        axis /= np.linalg.norm(axis)
        to_camera = self.views.centers[reference.view] - self.points[a]
        u = to_camera - axis * (axis @ to_camera)
        u /= max(float(np.linalg.norm(u)), 1e-12)
        v = np.cross(axis, u)
        out: list[Vec3] = []
        for angle in np.radians(np.arange(-75, 76, 15)):
            normal = np.cos(angle) * u + np.sin(angle) * v
            plane = plane_from_world(self.views, reference, normal, float(normal @ self.points[a]))
            if plane is not None and plane[2] > 0 and (reference.basis @ plane).min() > 0:
                out.append(plane)
        return out

    # -- the global choice --------------------------------------------------------------------------------------

    def corner_depths(self, face: int, guess: Hypothesis) -> dict[int, tuple[float, float]]:
        """Depth of each marked corner of the face on the hypothesis' plane, along its first mark's ray, with its relative sigma."""
        out: dict[int, tuple[float, float]] = {}
        for c in self.corners[face]:
            rows = self.rays.of_point(c)[:1]
            if len(rows):
                depth, slope = meet(self.rays, rows, guess.normal, guess.offset)
                at = self.rays.origin[rows[0]] + depth[0] * self.rays.direction[rows[0]]
                own = relative_sigma(self.views, guess.found, at) if guess.found is not None else 0.0
                out[c] = (float(depth[0]), float(np.sqrt((slope[0] * self.mark_sigma) ** 2 + self.plane_sigma**2 + own**2)))
        return out

    def choose(self) -> float:
        """Pick one hypothesis or none a face, so that planes agree at shared corners and no two faces share their pixels.

        Energy: `Hypothesis.energy` of a chosen plane; `_disagreement` for each corner two chosen faces share; up to +28 where its pixels are
        explained by other chosen faces drawn there. Returns the energy.
        """
        depths = [[self.corner_depths(f, h) for h in self.found[f]] for f in range(self.num_faces)]
        usable = [[h for h, d in enumerate(depths[f]) if all(z > 0 for z, _ in d.values())] for f in range(self.num_faces)]
        for f, guesses in enumerate(self.found):
            # beside a plane through corners known by other faces, one at which the views hardly agree is no witness
            if any(guesses[h].view < 0 for h in usable[f]):
                usable[f] = [h for h in usable[f] if guesses[h].view < 0 or guesses[h].energy < -WEAK]
        neighbours = [[g for g in range(self.num_faces) if g != f and set(self.corners[f]) & set(self.corners[g])] for f in range(self.num_faces)]
        drawn_over = [[np.nonzero(guess.covered.any(axis=0))[0].tolist() for guess in guesses] for guesses in self.found]
        behind_cache: dict[tuple[int, int, int, int], Bool[np.ndarray, "probe"]] = {}

        def explained(f: int, h: int, labels: Sequence[int]) -> float:
            """Share of the face's pixels that other chosen faces explain."""
            mine = self.found[f][h]
            by_others = np.zeros(len(mine.probe), bool)
            for g in drawn_over[f][h]:
                if labels[g] >= 0:
                    key = (f, h, g, labels[g])
                    if key not in behind_cache:
                        behind_cache[key] = mine.covered[:, g] & self.explains(mine, g, self.found[g][labels[g]])
                    by_others |= behind_cache[key]
            return float(by_others.mean())

        pair_cache: dict[tuple[int, int, int, int], float] = {}

        def pair(f: int, h: int, g: int, k: int) -> float:
            key = (f, h, g, k) if f < g else (g, k, f, h)
            if key not in pair_cache:
                pair_cache[key] = self.pair_energy(*key, depths)
            return pair_cache[key]

        def unary(f: int, h: int) -> float:
            guess = self.found[f][h]
            energy = guess.energy
            for c, (z, sigma) in depths[f][h].items():
                if c in self.triangulated:
                    there, sure = self.triangulated[c]
                    energy += _disagreement(np.log(z / there), np.hypot(sigma, sure))
            return energy

        def crowd(f: int, h: int, labels: Sequence[int]) -> float:
            return EXPLAINED * max(0.0, explained(f, h, labels) - 0.3)

        order = sorted(range(self.num_faces), key=lambda f: min((self.found[f][h].energy for h in usable[f]), default=9.0))
        best, energy = choose_labels(usable, unary, pair, crowd, neighbours, order, self.rng)
        for f, h in enumerate(best):
            self.choice[f] = self.found[f][h] if h >= 0 else None
        return energy

    def pair_energy(self, f: int, h: int, g: int, k: int, depths: list[list[dict[int, tuple[float, float]]]]) -> float:
        # a plane through corners agrees with the faces that located them by its making: that is no evidence, a contradiction is
        circular = self.found[f][h].view < 0 or self.found[g][k].view < 0
        energy = 0.0
        for c, (za, sa) in depths[f][h].items():
            if c in depths[g][k]:
                zb, sb = depths[g][k][c]
                cost = _disagreement(np.log(za / zb), np.hypot(sa, sb))
                # a corner of n faces has n - 1 to agree with: together they say it once
                energy += cost if cost > 0 else 0.0 if circular else cost / max(1, self.faces_at[c] - 1)
        return energy

    def explains(self, mine: Hypothesis, g: int, other: Hypothesis) -> Bool[np.ndarray, "probe"]:
        """Which of the probe points show the other face: those that lie behind it, and all where its plane carries the pixels that both
        are drawn over into other views as well as this one does (within `worth` of the robust cost a pixel)."""
        center = self.views.centers[mine.view]
        toward = mine.probe - center
        along = toward @ other.normal
        reach = (other.offset - center @ other.normal) / np.where(np.abs(along) < 1e-12, 1e-12, along)
        hidden = (reach > 0) & (reach < 1.0 - self.same_depth)
        if mine.found is None:
            return hidden | ((mine.view >= 0) & (np.abs(reach - 1.0) < self.same_depth))
        if hidden.all():
            return hidden
        if mine.view not in self.masks or g not in self.masks[mine.view]:
            return hidden
        reference = mine.found.reference
        shared = self.masks[mine.view][g][reference.pixels[:, 1].astype(int), reference.pixels[:, 0].astype(int)] > 0
        plane = plane_from_world(self.views, reference, other.normal, other.offset)
        if shared.sum() < 30 or plane is None:
            return hidden
        part = replace(reference, pixels=reference.pixels[shared], basis=reference.basis[shared], values=reference.values[shared])
        own, theirs = (photo_cost(self.views, part, q, self.options.photometric) for q in (mine.found.plane, plane))
        return hidden | (theirs < own + self.options.worth)

    # -- corners ------------------------------------------------------------------------------------------------

    def locate(self) -> None:
        """Corners from the chosen planes: each ray's depth, the median of what its faces say weighted by their certainty."""
        self.known[:] = False
        self.spread[:] = np.inf
        sayings: list[list[tuple[float, float]]] = [[] for _ in range(self.num_points)]
        self.told_by = [set() for _ in range(self.num_points)]
        for f, guess in enumerate(self.choice):
            if guess is not None:
                for c, saying in self.corner_depths(f, guess).items():
                    if saying[0] > 0:
                        sayings[c].append(saying)
                        self.told_by[c].add(f)
        for c in range(self.num_points):
            rows = self.rays.of_point(c)
            if len(rows) == 0:
                continue
            if c in self.triangulated:
                sayings[c].append(self.triangulated[c])
            if not sayings[c]:
                continue
            z = np.array([s[0] for s in sayings[c]])
            sigma = np.array([s[1] for s in sayings[c]])
            order = np.argsort(z, kind="stable")
            weight = np.cumsum(1.0 / sigma[order] ** 2)
            middle = z[order][np.searchsorted(weight, 0.5 * weight[-1])]
            agree = np.abs(np.log(z / middle)) < 3.0 * np.hypot(sigma, sigma.min())
            w = 1.0 / sigma[agree] ** 2
            depth = float((w * z[agree]).sum() / w.sum())
            self.points[c] = self.rays.origin[rows[0]] + depth * self.rays.direction[rows[0]]
            self.known[c] = True
            self.spread[c] = float(1.0 / np.sqrt(w.sum())) if len(w) > 1 else float(sigma[agree].min())

    def from_corners(self, face: int) -> list[Hypothesis]:
        """Planes through known corners of the face: through all of them, and where those disagree, through all but one each.

        Where the pixels agree with such a plane as well as with one that was fitted to them, they speak for it too.
        """
        out: list[Hypothesis] = []
        for guess in self.planes_through(face):
            lender = self.lender(face, guess)
            if lender is None:
                out.append(guess)
                continue
            turn = 1.0 if float(guess.normal @ lender.normal) > 0 else -1.0
            support = guess.support - lender.energy / CORNERS
            out.append(replace(guess, normal=turn * guess.normal, offset=turn * guess.offset, support=support, agreed=True))
        return out

    def lender(self, face: int, guess: Hypothesis) -> Hypothesis | None:
        """The plane of the pixels' own that earns most of those which they tell from `guess` by no more than `worth`."""
        best: Hypothesis | None = None
        for other in self.found[face]:
            if other.found is None or other.energy >= (0.0 if best is None else best.energy):
                continue
            plane = plane_from_world(self.views, other.found.reference, guess.normal, guess.offset)
            if plane is None:
                continue
            own, theirs = (photo_cost(self.views, other.found.reference, q, self.options.photometric) for q in (other.found.plane, plane))
            if theirs < own + self.options.worth:
                best = other
        return best

    def planes_through(self, face: int) -> list[Hypothesis]:
        independent = [c for c in dict.fromkeys(self.corners[face]) if self.known[c] and (c in self.triangulated or self.told_by[c] - {face})]
        known = np.array([c for c in independent if self.spread[c] < 20 * self.plane_sigma], int)
        if len(known) == 2:
            return self.standing(face, known)
        if guess := self.through(known):
            return [guess]
        if not 4 <= len(known) <= 12:
            return []
        return [guess for c in known if (guess := self.through(known[known != c]))]

    def standing(self, face: int, known: Int[np.ndarray, "two"]) -> list[Hypothesis]:
        """Planes through two known corners and one that nothing has located yet, but that is drawn over another face: most likely it
        stands on it, as a box does on the ground."""
        out: list[Hypothesis] = []
        for c in self.corners[face]:
            rows = self.rays.of_point(c)[:1]
            if self.known[c] or len(rows) == 0:
                continue
            view = int(self.rays.view[rows[0]])
            x, y = (int(v) for v in self.rays.xy[rows[0]])
            depths: list[float] = []
            for g, ground in enumerate(self.choice):
                drawn = None if ground is None or c in self.corners[g] else self.mask(view, g)
                if ground is not None and drawn is not None and 0 <= y < len(drawn[0]) and 0 <= x < drawn[0].shape[1] and drawn[0][y, x]:
                    depths.append(float(meet(self.rays, rows, ground.normal, ground.offset)[0][0]))
            if not depths or min(depths) <= 0:
                continue
            xyz = np.concatenate([self.points[known], self.rays.origin[rows] + min(depths) * self.rays.direction[rows]])
            normal, offset = self.towards(int(rows[0]), *fit_plane(xyz, np.ones(3)))
            if np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)[1] > 8.0 * self.plane_sigma * float(np.median(depths)):
                out.append(Hypothesis(normal, offset, float("nan"), -1, xyz, np.zeros((3, self.num_faces), bool), support=0.7))
        return out

    def towards(self, row: int, normal: Vec3, offset: float) -> tuple[Vec3, float]:
        """The plane with its normal on the side of a mark's camera."""
        return (normal, offset) if float(normal @ self.rays.origin[row]) > offset else (-normal, -offset)

    def through(self, corners: Int[np.ndarray, "corners"]) -> Hypothesis | None:
        """The plane through known corners; None where they are on a line, or disagree."""
        if len(corners) < 3:
            return None
        xyz = self.points[corners]
        first = np.array([self.rays.of_point(int(c))[0] for c in corners])
        sigma = self.spread[corners] * np.linalg.norm(xyz - self.rays.origin[first], axis=1)
        weight = 1.0 / sigma**2
        normal, offset = fit_plane(xyz, weight)
        center = weight @ xyz / weight.sum()
        # the second singular value of the corners in units of their sigmas says whether they are off a line
        across = np.linalg.svd((xyz - center) / np.maximum(sigma, 0.2 * sigma.max())[:, None], compute_uv=False)[1]
        if across < 3.0 or (np.abs(xyz @ normal - offset) > 4.0 * sigma).any():
            return None
        normal, offset = self.towards(int(first[0]), normal, offset)
        nobody = np.zeros((len(xyz), self.num_faces), bool)
        return Hypothesis(normal, offset, float("nan"), -1, xyz, nobody, support=1.0 if len(corners) == 3 else 2.0)


def agreement(found: PhotometricPlane) -> float:
    """Mean ZNCC, less where the views hardly show the face."""
    return found.zncc * min(1.0, 2 * found.share)


def _disagreement(difference: float, sigma: float) -> float:
    """What two depths (logarithms) of a corner cost: minus the log-likelihood ratio of "the same corner" against any depth of the scene,
    with a chance of 0.1 % that one of the clicks is wrong. About -4 where they agree to half a percent, +6.9 where they do not."""
    same = np.exp(-0.5 * (difference / sigma) ** 2) / sigma
    # a depth that is out of all range earns nothing by being out of range
    other = np.exp(-0.5 * (difference / max(DEPTHS, sigma)) ** 2) / DEPTHS
    return -float(np.log(0.999 * same / other + 0.001))


def lift_sketch(
    views: Views, sketch: Sketch, scene: ScenePoints, options: LiftOptions = LiftOptions(), *, rng: np.random.Generator, progress: Progress = silent
) -> Lifted:
    """Planes and corners of the sketch in the world, as far as the views give them."""
    lifter = _Lifter(views, sketch, scene, options, rng)
    if not sketch.faces:
        lifter.locate()  # by marks alone; the rounds are about faces
    before: tuple[int, int, float] | None = None
    for turn in range(options.rounds):
        for f in range(lifter.num_faces):
            progress(f"Lifting faces, round {turn + 1}", f, lifter.num_faces)
            pixels = [guess for guess in lifter.found[f] if guess.view >= 0]
            chosen = lifter.choice[f]
            if chosen is None or chosen.found is None:
                lifter.found[f] = pixels
                lifter.search(f)
                if turn >= 1 and not lifter.found[f]:
                    lifter.search_scene(f)
                pixels = lifter.found[f]
            lifter.found[f] = [*pixels, *lifter.from_corners(f)]
        energy = lifter.choose()
        lifter.locate()
        now = (int(lifter.known.sum()), sum(c is not None for c in lifter.choice), energy)
        if turn >= 2 and now == before:
            break
        before = now
    return _finish(lifter)


def _finish(lifter: _Lifter) -> Lifted:
    faces = lifter.num_faces
    normals, offsets, known, sigma = np.full((faces, 3), np.nan), np.full(faces, np.nan), np.zeros(faces, bool), np.zeros(faces)
    for f, choice in enumerate(lifter.choice):
        guess = choice or next(iter(lifter.from_corners(f)), None)
        if guess is not None:
            normals[f], offsets[f], known[f] = guess.normal, guess.offset, True
            if guess.found is not None:
                corners = lifter.points[[c for c in lifter.corners[f] if lifter.known[c]]]
                sigma[f] = max((relative_sigma(lifter.views, guess.found, at) for at in corners), default=0.0)
    lone_points(lifter)
    return Lifted(
        lifter.points, lifter.known.copy(), normals, offsets, known,
        np.array([guess is not None and (guess.view >= 0 or guess.agreed) for guess in lifter.choice], bool), sigma,
        tuple(map(tuple, lifter.corners)),
    )  # fmt: skip


def lone_points(lifter: _Lifter) -> None:
    """Points on no face with a plane: the depth of the patch around their mark."""
    options = replace(lifter.options.photometric, keep=1)
    height, width = lifter.views.images.shape[1:]
    for c in np.nonzero(~lifter.known)[0]:
        rows = lifter.rays.of_point(int(c))
        best: tuple[float, Vec3, float] | None = None
        for row in rows[:3]:
            view = int(lifter.rays.view[row])
            x, y = (int(v) for v in lifter.rays.xy[row])
            rho_range = lifter.rho_range(view)
            if rho_range is None:
                continue
            mask = np.zeros((height, width), bool)
            mask[max(y - PATCH, 0) : y + PATCH + 1, max(x - PATCH, 0) : x + PATCH + 1] = True
            reference = reference_from_mask(lifter.views, view, mask, options)
            if reference is None:
                continue
            planes = hypotheses(lifter.views, reference, rho_range, (), options)
            if planes and planes[0].zncc > 0.6 and (best is None or planes[0].zncc > best[0]):
                normal, offset = plane_to_world(lifter.views, reference, planes[0].plane)
                depth, _ = meet(lifter.rays, np.array([row]), normal, offset)
                if depth[0] > 0:
                    best = (planes[0].zncc, lifter.rays.origin[row] + depth[0] * lifter.rays.direction[row], float(depth[0]))
        if best is not None:
            lifter.points[c], lifter.known[c], lifter.spread[c] = best[1], True, 5 * lifter.plane_sigma
