"""The grid of a prediction: segments between jumps of the inputs, steps, stages, interpolation."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

STAGES = 7
BLOCK = 20000  # numbers of a matrix of each step that are worked on at a time: they stay in the cache
C = np.array([0.0, 1 / 3, 2 / 3, 1 / 3, 1 / 2, 1 / 2, 1.0])
A = np.zeros((STAGES, STAGES))
A[1, :1] = 1 / 3
A[2, :2] = 0.0, 2 / 3
A[3, :3] = 1 / 12, 1 / 3, -1 / 12
A[4, :4] = -1 / 16, 9 / 8, -3 / 16, -3 / 8
A[5, :5] = 0.0, 9 / 8, -3 / 8, -3 / 4, 1 / 2
A[6, :6] = 9 / 44, -9 / 11, 63 / 44, 18 / 11, 0.0, -16 / 11
B = np.array([11 / 120, 0.0, 27 / 40, 27 / 40, -4 / 15, -4 / 15, 11 / 120])


PLACES = tuple(sorted({*C.tolist()}))  # of the stages in a step: (5,) different ones


def transitions(rate: Sequence[np.ndarray], h: np.ndarray, driven: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return what one step makes of x' = rate x + drive(t): x_next = Phi x + sum of Gamma drive by place.

    ``rate``: seven arrays (steps, n, n), one per stage; ``h`` (steps,) [s]. Returns Phi (steps, n, n)
    and Gamma (steps, n, places, n - driven), `PLACES` in order, by drives of the rows from ``driven`` on.
    From the last stage to the first: the derivative of the end by a slope is that of what it is used for.
    """
    steps, n, _ = rate[0].shape
    phi, gamma = np.empty((steps, n, n)), np.zeros((steps, n, len(PLACES), n - driven))
    block, unit = max(BLOCK // n**2, 1), np.eye(n)
    for first in range(0, steps, block):
        part = slice(first, min(first + block, steps))
        step = h[part, None, None]
        used = np.empty((STAGES, len(step), n, n))
        flat = used.reshape(STAGES, -1)
        for j in range(STAGES - 1, -1, -1):
            own = step * ((A[j + 1 :, j] @ flat[j + 1 :]).reshape(used[j].shape) + B[j] * unit)
            np.matmul(own, rate[j][part], out=used[j])
            gamma[part, :, PLACES.index(C[j])] += own[..., driven:]
        phi[part] = used.sum(axis=0) + unit
    return phi, gamma


def stage_values(rate: Sequence[np.ndarray], starts: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return the stages (stages, steps, n) of x' = rate x from the ``starts`` (steps, n) of all steps.

    ``rate`` as in `transitions`, ``h`` (steps,) [s].
    """
    values, slopes = np.empty((2, STAGES, *starts.shape))
    for j in range(STAGES):
        values[j] = starts + h[:, None] * np.tensordot(A[j, :j], slopes[:j], axes=1)
        slopes[j] = (rate[j] @ values[j][..., None])[..., 0]
    return values


POINTS = 8  # of the interpolation: degree seven
SLACK = 1e-9  # [s] by which a sample may precede a jump and still count as after it


@dataclass(frozen=True)
class Timeline:
    """Uniform steps within segments; a jump of an input is the end of one segment and the start of the next.

    ``edges`` (segments + 1,) [s], ``counts`` (segments,) steps in each, even unless it is a coarse one.
    Evaluations are numbered: seven stages of every step in order, then the end of every segment. Nodes are
    the ends of steps, those at an edge twice: before and after the jump.
    """

    edges: np.ndarray
    counts: np.ndarray

    @classmethod
    def of(cls, start: float, stop: float, jumps: Sequence[float], longest: float) -> Timeline:
        """Return the grid from start to stop [s] with steps of at most ``longest`` [s]."""
        inner = [t for t in sorted(set(jumps)) if start + SLACK < t < stop - SLACK]
        edges = np.array([start, *inner, stop])
        counts = 2 * np.maximum(np.ceil(np.diff(edges) / (2.0 * longest) - 1e-9).astype(int), POINTS - 1)
        return cls(edges, counts)

    @cached_property
    def coarse(self) -> Timeline:
        """The grid with steps twice as long."""
        return Timeline(self.edges, self.counts // 2)

    def parts(self, most: int, *, whole: bool = False) -> Iterator[tuple[Timeline, bool]]:
        """Yield it in parts of ``most`` steps, the last of fewer, and whether each ends with a segment.

        ``whole``: every segment ends a part.
        """
        edges, counts = [float(self.edges[0])], []
        for (a, b), n in zip(itertools.pairwise(self.edges.tolist()), self.counts.tolist(), strict=True):
            done = 0
            while done < n:
                counts.append(min(n - done, most - sum(counts)))
                done += counts[-1]
                edges.append(b if done == n else a + (b - a) * done / n)
                if sum(counts) == most or edges[-1] == self.edges[-1] or (whole and done == n):
                    yield Timeline(np.array(edges), np.array(counts)), done == n
                    edges, counts = edges[-1:], []

    @cached_property
    def kept(self) -> np.ndarray:
        """Nodes (coarse nodes,) that are those of the coarse grid."""
        first = np.concatenate([[0], np.cumsum(self.counts + 1)[:-1]])
        return np.concatenate([f + np.arange(0, n + 1, 2) for f, n in zip(first, self.counts, strict=True)])

    @property
    def steps(self) -> int:
        """Number of steps."""
        return int(self.counts.sum())

    @cached_property
    def h(self) -> np.ndarray:
        """Length of every step (steps,) [s]."""
        return np.repeat(np.diff(self.edges) / self.counts, self.counts)

    @cached_property
    def step_starts(self) -> np.ndarray:
        """Start of every step (steps,) [s]."""
        pieces = zip(itertools.pairwise(self.edges), self.counts, strict=True)
        return np.concatenate([np.linspace(a, b, n + 1)[:-1] for (a, b), n in pieces])

    @cached_property
    def evaluations(self) -> np.ndarray:
        """Times of all evaluations (7 steps + segments,) [s]."""
        stages = self.step_starts[:, None] + self.h[:, None] * C
        return np.concatenate([stages.ravel(), self.edges[1:]])

    @cached_property
    def evaluation_segment(self) -> np.ndarray:
        """Segment of every evaluation (evaluations,)."""
        own = np.repeat(np.arange(len(self.counts)), self.counts * STAGES)
        return np.concatenate([own, np.arange(len(self.counts))])

    @cached_property
    def node_evaluation(self) -> np.ndarray:
        """Number of the evaluation at every node (steps + segments,)."""
        first = np.concatenate([[0], np.cumsum(self.counts)])
        parts = []
        for s, (a, b) in enumerate(itertools.pairwise(first)):
            parts += [np.arange(a, b) * STAGES, [self.steps * STAGES + s]]
        return np.concatenate(parts).astype(int)

    @cached_property
    def node_step(self) -> np.ndarray:
        """Step that starts at every node (nodes,); at the end of a segment the one that ends there."""
        parts, first = [], 0
        for count in self.counts:
            parts += [np.arange(first, first + count), [first + count - 1]]
            first += int(count)
        return np.concatenate(parts).astype(int)

    @cached_property
    def step_node(self) -> np.ndarray:
        """Node at the start of every step (steps,); the one at its end, before any jump, is the next."""
        return np.arange(self.steps) + np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def stage_interpolation(self) -> dict[float, csr_array]:
        """Interpolation from the nodes (steps, nodes) to the stages inside of all steps, by their place."""
        return {c: self.interpolation(self.step_starts + c * self.h) for c in sorted({*C} - {0.0, 1.0})}

    def at_stages(self, nodes: np.ndarray, steps: slice, first: int) -> dict[float, np.ndarray]:
        """Return values at the stages of some steps, (steps, ...) by their place in a step.

        From those at the nodes from ``first`` on that lie `POINTS` around the steps or nearer.
        """
        flat, place = nodes.reshape(len(nodes), -1), self.step_node[steps] - first
        found = {0.0: nodes[place], 1.0: nodes[place + 1]}
        for c, weights in self.stage_interpolation.items():
            own = weights[steps, first : first + len(nodes)]
            found[c] = (own @ flat).reshape(len(place), *nodes.shape[1:])
        return found

    def interpolation(self, times: np.ndarray) -> csr_array:
        """Return W (N, nodes) that takes values at the nodes to times (N,): Lagrange of degree seven.

        Never across a jump; a time at a jump is after it. Times must lie within the grid.
        """
        times = np.clip(times, self.edges[0], self.edges[-1])
        segment = np.searchsorted(self.edges[1:-1], times + SLACK, side="right")
        offset = np.concatenate([[0], np.cumsum(self.counts + 1)])
        span = np.diff(self.edges) / self.counts
        x = np.clip((times - self.edges[segment]) / span[segment], 0.0, self.counts[segment])
        first = np.clip(np.floor(x).astype(int) - (POINTS // 2 - 1), 0, self.counts[segment] + 1 - POINTS)
        local = x - first
        weights = np.ones((len(times), POINTS))
        for i in range(POINTS):
            for j in range(POINTS):
                if i != j:
                    weights[:, i] *= (local - j) / (i - j)
        columns = (offset[segment] + first).astype(np.int32)[:, None] + np.arange(POINTS, dtype=np.int32)
        starts = np.arange(0, weights.size + 1, POINTS, dtype=np.int32)
        return csr_array((weights.ravel(), columns.ravel(), starts), shape=(len(times), int(offset[-1])))
