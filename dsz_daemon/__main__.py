"""`python -m dsz_daemon` is `dsz`."""

from dsz_daemon.cli import main

raise SystemExit(main())
