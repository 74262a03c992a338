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


def tracks_report(content: Mapping[str, Any], command: str) -> tuple[str, bool]:
    """The page, and whether every claim is kept. content: `clips` and `totals` of `benchmarks.tracks`."""
    lines = [
        "# Corners followed without a correction",
        "",
        f"`{command}`",
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
        lines += [f"## {TITLES.get(group, group)}", "", *table, ""]
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
