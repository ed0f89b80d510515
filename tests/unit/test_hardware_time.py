"""Controller stamps against the true times of a simulated bus."""

from __future__ import annotations

import numpy as np

from dsz_daemon.pipeline.hardware_time import HardwareTime


def test_the_machines_delay_is_taken_out() -> None:
    """A controller 80 ppm fast that started elsewhere; the kernel comes 20 us to 5 ms after it."""
    rng, mapped = np.random.default_rng(5), HardwareTime()
    true_ns = np.cumsum(rng.integers(200_000, 2_000_000, 20_000)) + 1_700_000_000_000_000_000
    kernel_ns = true_ns + 20_000 + rng.exponential(300_000, true_ns.size).astype(np.int64).clip(0, 5_000_000)
    hardware_ns = 123_456 + ((true_ns - true_ns[0]) * 1.00008).astype(np.int64)
    errors = np.array(
        [mapped.kernel_ns(int(h), int(k)) - int(t) for h, k, t in zip(hardware_ns, kernel_ns, true_ns, strict=True)]
    )[200:]
    # 80 ppm over two blocks of a second is 0.16 ms; the kernel's own stamps are off by 0.3 ms on average, 5 at most.
    assert np.abs(errors).max() < 250_000
    assert (kernel_ns - true_ns).max() > 2_000_000


def test_a_controller_that_was_reset_is_followed_at_once() -> None:
    mapped = HardwareTime()
    for n in range(100):
        mapped.kernel_ns(5_000_000_000 + n * 1_000_000, 10**18 + n * 1_000_000)
    assert mapped.kernel_ns(7_000, 10**18 + 200_000_000) == 10**18 + 200_000_000
    assert mapped.kernel_ns(1_007_000, 10**18 + 201_500_000) == 10**18 + 201_000_000
