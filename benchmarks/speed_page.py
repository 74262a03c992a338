"""The figures of `benchmarks.speed` as Markdown tables and one SVG diagram."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

FIRST_LIMIT = 0.3
"""Seconds to the first partial answer of a correction: what still feels immediate."""
SPAN_LIMITS = {30: 0.3, 300: 2.0}
"""Frames that a correction touches -> seconds until all of them are right."""
FRAME_LIMIT = 100.0
"""Milliseconds a frame from clip to tracks, at 960x540 with 18 faces and 35 points on two cores."""


def speed_report(content: Mapping[str, Any]) -> str:
    """All tables. content: that of `speed.json`."""
    cores = content["machine"]["cores"]
    lines = ["# How long things take", "", f"`{content.get('command', 'python -m benchmarks.speed')}` on {cores} cores, kernels compiled.", ""]
    if content["clips"]:
        lines += ["## Stages, milliseconds a frame", "", *stage_table(content["clips"]), ""]
    if content.get("corrections"):
        lines += ["## One correction, seconds", "", *correction_table(content["corrections"]), ""]
    if content.get("paths"):
        lines += ["## The shortest path between two anchors", "", *path_table(content["paths"]), ""]
    if content.get("profile"):
        lines += ["## Where the time goes", "", *profile_table(content["profile"]), ""]
    return "\n".join(lines)


def stage_table(clips: Mapping[str, Any]) -> list[str]:
    """A column a clip. The last row is what the limit is about."""
    names = list(dict.fromkeys(stage for clip in clips.values() for stage in clip.get("stages", {})))
    lines = ["| | " + " | ".join(clips) + " |", "|---" * (len(clips) + 1) + "|"]
    for name in names:
        cells = [f"{1000 * clip['stages'][name] / clip['frames']:.1f}" if name in clip.get("stages", {}) else "" for clip in clips.values()]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    to_tracks = [f"{clip['ms_per_frame']:.0f}" if "ms_per_frame" in clip else str(clip.get("said")) for clip in clips.values()]
    lines.append(f"| clip to tracks (goal at 960x540 and 300 frames: {FRAME_LIMIT:.0f}) | " + " | ".join(to_tracks) + " |")
    lines.append("| peak memory, MB | " + " | ".join(f"{clip['peak_memory_mb']:.0f}" if clip.get("peak_memory_mb") else "" for clip in clips.values()) + " |")
    return lines


def correction_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """A row a span: medians and largest over the corners that were dragged."""
    lines = ["| frames | corners | first answer, median | largest | all frames, median | largest | processor, median | goal | |", "|---" * 9 + "|"]
    for span in sorted({row["span"] for row in rows}):
        mine = [row for row in rows if row["span"] == span]
        done = np.array([row["seconds"] for row in mine])
        first = np.array([row["first"] if row["first"] is not None else row["seconds"] for row in mine])
        limit = SPAN_LIMITS.get(span)
        kept = limit is not None and done.max() <= limit and first.max() <= FIRST_LIMIT
        verdict = "" if limit is None else "kept" if kept else "**not kept**"
        goal = "" if limit is None else f"{FIRST_LIMIT} / {limit}"
        figures = f"{np.median(first):.2f} | {first.max():.2f} | {np.median(done):.2f} | {done.max():.2f} | {np.median([row['processor'] for row in mine]):.2f}"
        lines.append(f"| {span} | {len(mine)} | {figures} | {goal} | {verdict} |")
    return lines


def path_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """A row a span; time is linear in it where the last column is flat."""
    lines = ["| frames | seconds | processor | milliseconds a frame |", "|---|---|---|---|"]
    return lines + [f"| {r['span']} | {r['seconds']:.2f} | {r['processor']:.2f} | {1000 * r['seconds'] / r['span']:.1f} |" for r in rows]


def profile_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Functions by their own seconds."""
    lines = ["| function | calls | own, s | share, % | with all below, s |", "|---|---|---|---|---|"]
    return lines + [f"| `{r['function']}` | {r['calls']} | {r['own']:.2f} | {r['share_pct']:.1f} | {r['whole']:.2f} |" for r in rows]


def time_against_span(rows: Sequence[Mapping[str, Any]], what: str, limited: bool) -> str:
    """An SVG diagram: seconds until all frames are right (dots), until the first answer (rings), against the frames touched; the limits as a line."""
    width, height, left, bottom, top, right = 640.0, 360.0, 56.0, 40.0, 16.0, 16.0
    span = np.array([row["span"] for row in rows], dtype=float)
    done = np.array([row["seconds"] for row in rows])
    first = np.array([row["first"] if row["first"] is not None else np.nan for row in rows])
    far, long = span.max() * 1.05, max(float(done.max()), max(SPAN_LIMITS.values()) if limited else 0.0) * 1.1

    def at(frames: float, seconds: float) -> tuple[float, float]:
        return left + (width - left - right) * frames / far, height - bottom - (height - top - bottom) * seconds / long

    (x0, y0), (x1, _), (_, y1) = at(0, 0), at(far, 0), at(0, long)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif" font-size="12">',
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>',
        f'<path d="M{x0:.1f} {y1:.1f}V{y0:.1f}H{x1:.1f}" fill="none" stroke="#333"/>',
    ]
    for frames in sorted({*span}):
        x, _ = at(frames, 0)
        parts.append(f'<text x="{x:.1f}" y="{y0 + 16:.1f}" text-anchor="middle">{frames:.0f}</text>')
    for seconds in np.linspace(0, long, 5):
        _, y = at(0, seconds)
        parts.append(f'<text x="{left - 8:.1f}" y="{y + 4:.1f}" text-anchor="end">{seconds:.2g}</text>')
    corners = [at(0, FIRST_LIMIT), at(min(SPAN_LIMITS), SPAN_LIMITS[min(SPAN_LIMITS)]), at(max(SPAN_LIMITS), SPAN_LIMITS[max(SPAN_LIMITS)])]
    if limited:
        parts.append('<path d="M' + "L".join(f"{x:.1f} {y:.1f}" for x, y in corners) + '" fill="none" stroke="#c33" stroke-dasharray="5 4"/>')
    for frames, seconds, sooner in zip(span, done, first, strict=True):
        x, y = at(frames, seconds)
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="#247" fill-opacity="0.7"/>')
        if np.isfinite(sooner):
            x, y = at(frames, sooner)
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="none" stroke="#247"/>')
    parts.append(f'<text x="{(x0 + x1) / 2:.1f}" y="{height - 6:.1f}" text-anchor="middle">frames that {what} touches</text>')
    parts.append(
        f'<text x="{left + 10:.1f}" y="{top + 14:.1f}">seconds: all frames (dots){", first answer (rings), goal (dashed)" if limited else ""}</text></svg>'
    )
    return "\n".join(parts) + "\n"
