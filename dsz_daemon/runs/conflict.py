"""Somebody else sends our ids: what becomes of our own output."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

# So long after the other sender's last frame an id is ours again: twice the slowest usual cycle.
_QUIET_NS = 2_000_000_000


@dataclass
class OutputConflict:
    """Follows, by id, how many frames with our ids others sent; `refused` are the ids that we leave to them for now.

    `mode` is the setting `output.on_conflict`: "report" goes on with all, "refuse" holds back the messages whose
    ids are taken, "move" asks once for other ids and, should somebody send those as well, holds back too.
    """

    mode: Literal["refuse", "report", "move"]
    seen: dict[int, int] = field(default_factory=dict)
    last_ns: dict[int, int] = field(default_factory=dict)
    moved: bool = False
    refused: frozenset[int] = frozenset()
    wants_to_move: bool = False

    def follow(self, foreign: Mapping[int, int], now_ns: int) -> None:
        """Takes the latest counts of foreign frames by id into account."""
        for can_id, count in foreign.items():
            if count != self.seen.get(can_id, 0):
                self.seen[can_id] = count
                self.last_ns[can_id] = now_ns
                self.wants_to_move = self.wants_to_move or (self.mode == "move" and not self.moved)
        if not self.last_ns:
            return
        self.last_ns = {can_id: ns for can_id, ns in self.last_ns.items() if now_ns - ns <= _QUIET_NS}
        is_held_back = self.mode == "refuse" or self.moved
        self.refused = frozenset(self.last_ns) if is_held_back else frozenset()

    def moved_over(self) -> None:
        """The output has other ids now."""
        self.moved, self.wants_to_move, self.last_ns, self.refused = True, False, {}, frozenset()
