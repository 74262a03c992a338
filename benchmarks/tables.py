"""The tables of the tracks benchmark as Markdown: a column a clip, a group's total, the goal, and whether it is kept."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.claims import BASELINE_ROWS, CLAIMS, Claim

TITLES = {
    "twin": "Ordinary clips",
    "hard": "Clips that are hard on purpose",
    "recorded": "A recorded clip with corners marked by hand",
    "quick": "Small clips",
}


CURVE = tuple(0.25 * k for k in range(41))
"""Pixels at which the share of corner-frames within is noted for the diagram."""


def tracks_report(content: Mapping[str, Any]) -> tuple[str, bool]:
    """The page, and whether every claim is kept. content: that of `tracks.json`."""
    lines = [
        "# Corners followed without a correction",
        "",
        f"`{content['command']}`",
        "",
        "Errors are over every truly visible corner-frame; what is not claimed counts as missed in all percentages. A figure in bold breaks its row's goal.",
        "Baselines see the same frames and the same marks: Lucas-Kanade on single corners; each face by a homography from frame to frame;",
        "samples along edges from frame to frame, their lines intersected; the same with the most confident of nine candidates around each corner.",
        "",
    ]
    all_kept = True
    for group, total in content["totals"].items():
        clips = {name: figures for name, figures in content["clips"].items() if figures["group"] == group}
        table, kept = group_table(group, clips, total)
        all_kept = all_kept and kept
        lines += [f"## {TITLES.get(group, group)}", "", *table, "", *fallen_short(clips), ""]
        users = user_table(clips)
        lines += [*users, ""] if users else []
    return "\n".join(lines), all_kept


def group_table(group: str, clips: Mapping[str, Any], total: Mapping[str, Any]) -> tuple[list[str], bool]:
    """One group's table and whether its claims are kept."""
    lines = ["| | goal | " + " | ".join(clips) + " | together | |", "|---" * (len(clips) + 4) + "|"]
    failures = [f"{name}: status {c['status']}" for name, c in clips.items() if c["status"] != 0]
    all_kept = not failures
    for claim in CLAIMS:
        key = "corrections" if claim.key == "corrections_max" else claim.key
        values = {name: c.get("ours", {}).get(key) for name, c in clips.items()}
        if all(v is None for v in values.values()):
            continue
        # Nothing to measure (no corner is ever hidden, say) is no failure; a clip without a result is one.
        judged = [v for name, v in values.items() if v is not None or clips[name]["status"] != 0]
        together = together_of(claim, judged, total["ours"].get(key))
        verdict = claim.verdict(group, judged, total["ours"].get(key))
        all_kept = all_kept and verdict is not False
        cells = [_cell(claim, group, v) for v in values.values()]
        lines.append(f"| {claim.title} | {claim.goal(group)} | " + " | ".join(cells) + f" | {_plain(together, claim.digits)} | {_word(verdict)} |")
    rows = {claim.key: claim for claim in CLAIMS}
    for baseline in total.get("baselines", {}):
        for key in BASELINE_ROWS:
            cells = [_plain(c["baselines"][baseline].get(key), rows[key].digits) for c in clips.values()]
            figure = _plain(total["baselines"][baseline].get(key), rows[key].digits)
            lines.append(f"| {baseline}: {rows[key].title} | | " + " | ".join(cells) + f" | {figure} | |")
    if failures:
        lines += ["", "Without a result: " + "; ".join(failures) + "."]
    return lines, all_kept


def fallen_short(clips: Mapping[str, Any]) -> list[str]:
    """The corners whose median error is above 2 px, by clip."""
    bad = {name: c["ours"]["bad_corners"] for name, c in clips.items() if c.get("ours", {}).get("bad_corners")}
    if not bad:
        return ["No corner's median error is above 2 px."] if all("ours" in c for c in clips.values()) else []
    named = "; ".join(
        f"{name}: " + ", ".join(f"{k} ({'not claimed' if v is None else f'{v:.1f}'})" for k, v in corners.items()) for name, corners in bad.items()
    )
    return [f"Corners whose median error is above 2 px: {named}."]


def user_table(clips: Mapping[str, Any]) -> list[str]:
    """What simulated people did, a row a person; empty where there were none."""
    rows: list[str] = []
    for name, clip in clips.items():
        for seed, policies in enumerate(clip.get("users", ())):
            for policy, u in policies.items():
                seconds = f"{float(np.median(u['seconds'])):.2f}" if u["seconds"] else ""
                end = "satisfied" if u["satisfied"] else "refused" if u["stopped_by"] else "not satisfied"
                rows.append(
                    f"| {name} | {seed} | {policy} | {u['corrections']} | {u['looks']} | {u['within'][0]:.1f} | {u['within'][-1]:.1f} | {end} | {seconds} |"
                )
    head = "| clip | person | policy | corrections | looks | within 5 px before, % | after, % | | seconds a correction, median |"
    return [head, "|---" * 9 + "|", *rows] if rows else []


def curves(group: str, total: Mapping[str, Any]) -> str:
    """An SVG diagram: the share of a group's corner-frames within so many pixels, ours and the baselines'."""
    width, height, left, bottom, top, right = 640.0, 360.0, 48.0, 40.0, 16.0, 170.0
    lines = {"planewright": total["ours"], **total.get("baselines", {})}
    colours = ("#c33", "#247", "#283", "#a60", "#666")

    def at(pixels: float, percent: float) -> tuple[float, float]:
        return left + (width - left - right) * pixels / CURVE[-1], height - bottom - (height - top - bottom) * percent / 100.0

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif" font-size="12">',
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>',
    ]
    for percent in (0, 25, 50, 75, 100):
        (x0, y), (x1, _) = at(0, percent), at(CURVE[-1], percent)
        parts.append(f'<path d="M{x0:.1f} {y:.1f}H{x1:.1f}" stroke="#ccc"/><text x="{x0 - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{percent}</text>')
    for pixels in (1, 2, 5, 10):
        x, y = at(pixels, 0)
        parts.append(f'<path d="M{x:.1f} {y:.1f}V{top:.1f}" stroke="#eee"/><text x="{x:.1f}" y="{y + 16:.1f}" text-anchor="middle">{pixels}</text>')
    for k, (name, figures) in enumerate(lines.items()):
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in (at(pixels, share) for pixels, share in zip(CURVE, figures["curve"], strict=True)))
        colour = colours[k % len(colours)]
        parts.append(f'<path d="M{path}" fill="none" stroke="{colour}" stroke-width="{2.5 if k == 0 else 1.5}"/>')
        parts.append(f'<text x="{width - right + 10:.1f}" y="{top + 20 + 18 * k:.1f}" fill="{colour}">{name}</text>')
    title = f"{TITLES.get(group, group)}: % of visible corner-frames within so many pixels"
    return "\n".join([*parts, f'<text x="{left:.1f}" y="{height - 6:.1f}">{title}</text></svg>']) + "\n"


def together_of(claim: Claim, clips: list[float | None], pooled: float | None) -> float | None:
    """What the column of the total shows."""
    known = [c for c in clips if c is not None]
    if not known:
        return None
    match claim.judged:
        case "median of clips":
            return float(np.median(known))
        case "largest of clips":
            return max(known)
        case "each clip" | "all together":
            return pooled


def _cell(claim: Claim, group: str, value: float | None) -> str:
    broken = claim.judged in ("each clip", "largest of clips") and claim.holds(group, value) is False
    text = _plain(value, claim.digits)
    return f"**{text or 'none'}**" if broken else text


def _plain(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _word(verdict: bool | None) -> str:
    return "" if verdict is None else "kept" if verdict else "**not kept**"
