"""Inside: a program in the daemon's place that does nothing at all.

python tests/vcan/nobody.py CONFIG OUT
"""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path


def main(_config: str, out: str) -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    Path(out, "summary.json").write_text(json.dumps({}))
    Path(out, "ready").touch()
    signal.sigwait({signal.SIGTERM})


if __name__ == "__main__":
    main(*sys.argv[1:])
