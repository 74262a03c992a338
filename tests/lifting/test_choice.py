"""Labels chosen together, against trying all of them on problems small enough: random ones, harder than any sketch."""

from itertools import product

import numpy as np
import pytest

from planewright.lifting.choice import NONE, choose_labels


def problem(seed: int, things: int = 5, count: int = 3):
    rng = np.random.default_rng(seed)
    alone = rng.normal(-2.0, 2.0, (things, count))
    between = rng.normal(0.0, 3.0, (things, count, things, count))
    between = between + between.transpose(2, 3, 0, 1)
    beside = np.triu(rng.random((things, things)) < 0.6, 1)
    neighbours = [[g for g in range(things) if beside[min(f, g), max(f, g)]] for f in range(things)]
    return alone, between, neighbours


def energy(alone, between, neighbours, labels) -> float:
    total = sum(alone[f, h] for f, h in enumerate(labels) if h != NONE)
    return total + sum(between[f, h, g, labels[g]] for f, h in enumerate(labels) if h != NONE for g in neighbours[f] if g > f and labels[g] != NONE)


@pytest.mark.parametrize("seed", range(12))
def test_the_choice_is_at_most_a_tenth_worse_than_the_best_of_all(seed: int) -> None:
    alone, between, neighbours = problem(seed)
    found, lowest = choose_labels(
        [range(3)] * 5, lambda f, h: alone[f, h], lambda f, h, g, k: between[f, h, g, k], lambda f, h, now: 0.0, neighbours, range(5), np.random.default_rng(0)
    )
    assert np.isclose(lowest, energy(alone, between, neighbours, found))
    best = min(energy(alone, between, neighbours, labels) for labels in product(range(-1, 3), repeat=5))
    assert lowest <= best + 0.1 * abs(best)


def test_two_that_only_fit_together_are_found() -> None:
    """Each by itself would rather keep its first label; both changed together are better."""
    pairs = np.array([[-1.0, 6.0], [6.0, -4.0]])
    found, lowest = choose_labels(
        [(0, 1)] * 2, lambda f, h: -1.0, lambda f, h, g, k: pairs[h, k], lambda f, h, now: 0.0, [(1,), (0,)], (0, 1), np.random.default_rng(0), attempts=1
    )
    assert found == [1, 1]
    assert lowest == -6.0


def test_a_crowd_can_forbid_what_pairs_allow() -> None:
    found, _ = choose_labels(
        [(0,)] * 3, lambda f, h: -1.0 - f, lambda f, h, g, k: 0.0, lambda f, h, now: 9.0 * (sum(k != NONE for k in now) > 2),
        [(1, 2), (0, 2), (0, 1)], (2, 1, 0), np.random.default_rng(0),
    )  # fmt: skip
    assert sum(k != NONE for k in found) == 2


def test_nothing_to_choose_gives_nothing() -> None:
    found, lowest = choose_labels([(), ()], lambda f, h: 0.0, lambda f, h, g, k: 0.0, lambda f, h, now: 0.0, [(1,), (0,)], (0, 1), np.random.default_rng(0))
    assert found == [NONE, NONE]
    assert lowest == 0.0
