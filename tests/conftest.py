"""For all tests."""

from __future__ import annotations

import signal

# Whoever starts a job in the background of a shell has SIGINT ignored, and all programs that are started from there as
# well; tests that end one with Ctrl-C would wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
