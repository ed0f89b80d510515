"""A CAN controller's own stamps on the machine's time line.

A controller's clock starts anywhere and runs at its own rate. The kernel stamps each frame a little
after the controller did, sometimes much later, never before: the least difference seen lately is the
controller's distance, and what a frame lies above it is the machine's delay, which is what hardware
stamps are for taking out.
"""

from __future__ import annotations

from dataclasses import dataclass

# Two crystals part by up to some 100 ppm, i.e. by 0.2 ms in two blocks: below what the stamps are used for.
_BLOCK_NS = 1_000_000_000
# More than any queue holds a frame back: the controller was reset.
_RESET_NS = 500_000_000


@dataclass
class HardwareTime:
    """Maps stamps of one controller; remembers the least distance of this block and the one before."""

    block_end_ns: int = 0
    least_ns: int | None = None
    before_ns: int | None = None

    def kernel_ns(self, hardware_ns: int, kernel_ns: int) -> int:
        """When the controller stamped the frame, on the kernel's clock; both stamps in ns."""
        distance_ns = kernel_ns - hardware_ns
        known = [ns for ns in (self.least_ns, self.before_ns) if ns is not None]
        if known and abs(distance_ns - min(known)) > _RESET_NS:
            self.least_ns = self.before_ns = None
            known = []
        if kernel_ns >= self.block_end_ns or not known:
            self.before_ns, self.least_ns = self.least_ns, None
            self.block_end_ns = kernel_ns + _BLOCK_NS
        self.least_ns = distance_ns if self.least_ns is None else min(self.least_ns, distance_ns)
        least_ns = self.least_ns if self.before_ns is None else min(self.least_ns, self.before_ns)
        return hardware_ns + least_ns
