"""Whether a tracker is of one object or of several: it is tried with a few scans of either kind."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import islice
from typing import Literal

from trackbench.base.errors import InputError, nearest

Identities = Literal["known", "hidden"]
#: So many scans show it.
TRIED = 20
OF_OTHER_KIND: Mapping[Identities, str] = {
    "known": 'it follows several objects: say identities="hidden"',
    "hidden": 'it follows one object: leave identities="hidden" out',
}


def require_known(identities: str) -> None:
    """Refuse what is neither of the two."""
    if identities not in OF_OTHER_KIND:
        raise InputError(f"{identities!r} is not known; {nearest(identities, OF_OTHER_KIND)}", key="identities")


def answers(found: Callable[[], Iterable[bool]]) -> bool:
    """Whether a tracker bears some scans and says something, given whether it does after each of them."""
    try:
        return any(list(islice(found(), TRIED)))
    except (Exception, SystemExit):
        return False
