"""One label or none for each of a set of things, so that an energy of single labels, pairs and crowds is low.

Knows no plane: the energy comes in as three functions.
"""

from collections.abc import Callable, Sequence

import numpy as np

NONE = -1
"""The label of a thing that gets none; it costs nothing."""


def choose_labels(
    labels: Sequence[Sequence[int]],
    unary: Callable[[int, int], float],
    pair: Callable[[int, int, int, int], float],
    crowd: Callable[[int, int, Sequence[int]], float],
    neighbours: Sequence[Sequence[int]],
    order: Sequence[int],
    rng: np.random.Generator,
    *,
    attempts: int = 8,
    sweeps: int = 12,
) -> tuple[list[int], float]:
    """The best labels found, and their energy: the sum of unary(f, h), of pair(f, h, g, k) over neighbours and of crowd(f, h, all labels).

    Iterated conditional modes: each thing in turn takes the label that costs least beside the others', then each two neighbours the
    two labels that do, since a thing may only fit once the one beside it has changed. Begun from `order` and from random ones; the
    lowest energy wins.

    Args:
        labels: of each thing, those it may take.
        neighbours: of each thing, the others it shares a pair energy with.
    """

    def cost(f: int, h: int, now: Sequence[int], without: int = -1) -> float:
        if h == NONE:
            return 0.0
        shared = sum(pair(f, h, g, now[g]) for g in neighbours[f] if g != without and now[g] != NONE)
        return unary(f, h) + crowd(f, h, now) + shared

    def best_two(f: int, g: int, now: Sequence[int]) -> tuple[int, int]:
        trial = list(now)
        best, least = (now[f], now[g]), np.inf
        for h in [NONE, *labels[f]]:
            for k in [NONE, *labels[g]]:
                trial[f], trial[g] = h, k
                both = pair(f, h, g, k) if h != NONE and k != NONE else 0.0
                total = cost(f, h, trial, without=g) + cost(g, k, trial, without=f) + both
                if total < least - 1e-9 or (abs(total - least) <= 1e-9 and (h, k) == (now[f], now[g])):
                    best, least = (h, k), min(total, least)
        return best

    def energy(now: Sequence[int]) -> float:
        total = 0.0
        for f, h in enumerate(now):
            if h != NONE:
                total += unary(f, h) + crowd(f, h, now)
                total += sum(pair(f, h, g, now[g]) for g in neighbours[f] if g > f and now[g] != NONE)
        return total

    found, lowest = [NONE] * len(labels), np.inf
    for attempt in range(attempts):
        turns = list(order) if attempt == 0 else [int(f) for f in rng.permutation(len(labels))]
        now = [NONE] * len(labels)
        for _ in range(sweeps):
            before = list(now)
            for f in turns:
                now[f] = min((cost(f, h, now), h) for h in [NONE, *labels[f]])[1]
            for f in turns:
                for g in neighbours[f]:
                    if g > f:
                        now[f], now[g] = best_two(f, g, now)
            if now == before:
                break
        if (total := energy(now)) < lowest - 1e-9:
            found, lowest = now, total
    return found, float(lowest)
