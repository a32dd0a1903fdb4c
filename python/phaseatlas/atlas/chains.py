"""Chains and rings of members, each of which names the next one."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..arrays import Ints

__all__ = ["chains"]


def chains(following: Ints) -> list[Ints]:
    """Members of each chain in their order, chains by their least member.

    Parameters
    ----------
    following : (n,) array of int
        What comes after each member, -1 at the end of a chain. Rings start at their least member.
    """
    n = len(following)
    if n == 0:
        return []
    inner = np.flatnonzero(following >= 0)
    graph = coo_array((np.ones(len(inner)), (inner, following[inner])), shape=(n, n))
    _, chain = connected_components(graph, directed=False)
    _, least, chain = np.unique(chain, return_index=True, return_inverse=True)
    # A ring is opened before its least member; a chain has an end already.
    ring = np.bincount(chain, following < 0) == 0
    opened = np.where(ring[chain] & (following == least[chain]), -1, following)
    # Steps to the end by doubling: each round looks twice as far.
    jump = np.where(opened < 0, np.arange(n), opened)
    left = (opened >= 0).astype(np.int64)
    while (jump[jump] != jump).any():
        left += left[jump]
        jump = jump[jump]
    order = np.lexsort((-left, chain))
    return np.split(order, np.cumsum(np.bincount(chain, minlength=len(least)))[:-1])
