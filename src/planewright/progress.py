"""How a long step reports that it is alive, and how it is stopped: the callback raises `Cancelled`."""

from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar, runtime_checkable

Item = TypeVar("Item")


@runtime_checkable
class Progress(Protocol):
    """Called often from inside long steps. Raise `Cancelled` in it to stop the work."""

    def __call__(self, title: str, done: int, total: int | None) -> None:
        """`done` of `total` units of the step called `title` are finished; `total` is None where it is unknown."""
        ...


def silent(title: str, done: int, total: int | None) -> None:
    """Report nothing."""
    del title, done, total


def steps(items: Iterable[Item], title: str, progress: Progress, total: int | None = None) -> Iterator[Item]:
    """The items, with a report before each and one after the last."""
    if total is None and hasattr(items, "__len__"):
        total = len(items)  # pyright: ignore[reportArgumentType]
    done = 0
    for item in items:
        progress(title, done, total)
        yield item
        done += 1
    progress(title, done, total)
