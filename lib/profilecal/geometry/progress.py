"""How far long loops have come, for whoever started them and wants to see it."""

from collections.abc import Callable, Iterable
from contextvars import ContextVar
from typing import Any

# from what a loop goes through, what it does in words, and how often (None: not known)
# to the same, which is seen to pass
watcher: ContextVar[Callable] = ContextVar("watcher", default=lambda items, *_: items)


def watched(items: Iterable, doing: str, total: int | None = None) -> Iterable[Any]:
    """The same items, one by one, under the eyes of the `watcher` if there is one.

    >>> from profilecal.geometry.progress import watched, watcher
    >>> seen = []
    >>> token = watcher.set(lambda items, *about: seen.append(about) or items)
    >>> sum(watched(range(3), "adding"))
    3
    >>> watcher.reset(token)
    >>> seen
    [('adding', None)]
    """
    return watcher.get()(items, doing, total)
