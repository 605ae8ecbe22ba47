"""The link that is a robot's tip where nobody says which one."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

from irbcal.errors import RobotError

TIP_NAMES = ("tool0", "flange", "ee_link", "tcp")
LIKELY = re.compile(r"tool|tcp|flange|(^|_)ee(_|$)|(^|_)eef(_|$)|effector|tip|hand|wrist|mount", re.IGNORECASE)
"""Parts of names that links of tips bear."""
MOST = 12
"""Candidates that are named."""


def choose_tip(links: Sequence[str], above: Mapping[str, str], moved: Collection[str], source: str) -> str:
    """A robot's tip link: of a usual name, or the only one at the end of the longest chain of moving joints.

    Parameters
    ----------
    links : sequence of str
    above : dict of str to str
        The link that each one hangs on; the root on none.
    moved : collection of str
        The links whose joint moves.
    source : str
        File name for messages.

    Returns
    -------
    str

    Raises
    ------
    RobotError
        If it may be one of several; candidates are named, the likeliest first.
    """
    for name in TIP_NAMES:
        if name in links:
            return name
    ends = [link for link in links if link not in set(above.values())]
    chains = {link: _chain(link, above) for link in ends}
    deepest = max((sum(name in moved for name in chain) for chain in chains.values()), default=0)
    best = [link for link in ends if sum(name in moved for name in chains[link]) == deepest]
    if len(best) == 1:
        return best[0]
    listed = _likeliest_first([chains[link] for link in best], moved)
    more = f" and {len(listed) - MOST} more" if len(listed) > MOST else ""
    raise RobotError(
        f"which link is the tip? candidates are {', '.join(listed[:MOST])}{more}: name one of these, or a link before "
        "them, with --tip-link",
        file=source,
        parameter="tip_link",
    )


def _chain(link: str, above: Mapping[str, str]) -> list[str]:
    """The links from the root to this one."""
    chain = [link]
    while chain[-1] in above:
        chain.append(above[chain[-1]])
    return chain[::-1]


def _likeliest_first(chains: Sequence[Sequence[str]], moved: Collection[str]) -> list[str]:
    """Where the chains part (such as the hand before its fingers), then their ends: by name, then nearest first."""
    shared = 0
    while all(len(chain) > shared for chain in chains) and len({chain[shared] for chain in chains}) == 1:
        shared += 1
    together = list(chains[0][:shared])
    last = max((k for k, link in enumerate(together) if link in moved), default=len(together))
    trunk = together[last:][::-1]  # what is fixed to the last joint that all share, the outermost first
    ends = sorted((chain[-1], len(chain)) for chain in chains)
    ends.sort(key=lambda end: (not LIKELY.search(end[0]), end[1]))
    found = [*trunk, *(name for name, _ in ends)]
    return sorted(found, key=lambda name: not LIKELY.search(name))
