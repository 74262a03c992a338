"""Compare the results of a run with the baseline: what became worse, beyond noise, and what became better. Status 1 where anything became worse.

python -m benchmarks.compare [RESULTS.json] [--baseline FILE] [--update]
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.metrics import BY_KEY, METRICS, number

_BASELINE = Path(__file__).parent / "baseline.json"


def compare(baseline: dict[str, dict[str, Any]], now: dict[str, dict[str, Any]]) -> tuple[list[str], list[str]]:
    """What is worse and what is better, a line a figure. A figure that the baseline has and the run lacks is worse."""
    worse: list[str] = []
    better: list[str] = []
    for name in now:
        for key, old in baseline.get(name, {}).items():
            metric, before, after = BY_KEY[key], number(old), rounded(number(now[name].get(key)))
            if before is None:
                continue
            line = f"{name:16} {key:24} {before:12.5g} -> {'none' if after is None else f'{after:.5g}'} {metric.unit}"
            change = float("inf") if after is None else metric.worsening(before, after)
            if change > metric.slack(before):
                worse.append(line)
            elif -change > metric.slack(before):
                better.append(line)
    return worse, better


def trimmed(results: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The figures that a baseline keeps: those that are metrics, to five digits."""
    kept: dict[str, dict[str, Any]] = {}
    for name, figures in results.items():
        values = {m.key: rounded(number(figures.get(m.key))) for m in METRICS}
        kept[name] = {key: value for key, value in values.items() if value is not None}
    return kept


def rounded(value: float | None) -> float | None:
    """To five digits, as the baseline keeps them: a figure that must not change at all is compared in the same digits."""
    return None if value is None else float(f"{value:.5g}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", nargs="?", type=Path, default=Path("out/benchmarks/results.json"))
    parser.add_argument("--baseline", type=Path, default=_BASELINE)
    parser.add_argument("--update", action="store_true", help="write the results of this run into the baseline (workloads that did not run stay)")
    args = parser.parse_args()
    now = json.loads(args.results.read_text(encoding="utf-8"))
    baseline = json.loads(args.baseline.read_text(encoding="utf-8")) if args.baseline.exists() else {}
    if args.update:
        merged = dict(sorted({**baseline, **trimmed(now)}.items()))
        args.baseline.write_text(json.dumps(merged, indent=1) + "\n", encoding="utf-8")
        return
    worse, better = compare(baseline, now)
    for title, lines in (("worse", worse), ("better", better)):
        print(f"{title}: {len(lines)}", *lines, sep="\n  ")
    new = [name for name in now if name not in baseline]
    if new:
        print(f"not in the baseline: {', '.join(new)}")
    sys.exit(1 if worse else 0)


if __name__ == "__main__":
    main()
