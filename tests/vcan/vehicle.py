"""In the guest: dsz installed as on a vehicle, under /opt, where a service without a home can read it.

The checkout and its environment may lie in somebody's home, which the units don't see. So Python and the
packages are mounted at another place, and the project is copied as in a wheel; nothing is left when the guest
ends. Of the environment's packages there are those that a vehicle has: without the desk's, which take time
and memory. And all is compiled, as pip does it: a checkout need not be, and then each start takes longer.
"""

from __future__ import annotations

import compileall
import re
import shutil
import subprocess
import sys
import sysconfig
from importlib import metadata
from pathlib import Path

PROJECT = Path(__file__).parents[2]
DSZ = Path("/opt/dsz/bin/dsz")
_START = """\
#!/opt/dsz/bin/python
import sys
from dsz_daemon.cli import main
sys.exit(main())
"""


def install_dsz() -> Path:
    """Makes /opt/dsz, an environment like that of `python -m venv` and `pip install`; returns the `dsz` in it."""
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    base = Path(sys.base_prefix)
    if base != Path("/usr"):
        base = _mounted(base, Path("/opt/python"))
    packages = _mounted(Path(sysconfig.get_path("purelib")), Path("/opt/packages"))
    site = DSZ.parents[1] / "lib" / version / "site-packages"
    site.mkdir(parents=True)
    _copy_project(site / "dsz_daemon")
    for name in _runtime_names():
        (site / name).symlink_to(packages / name)
    # Single modules are looked up compiled beside their link.
    compileall.compile_dir(site, maxlevels=0, quiet=1)
    DSZ.parent.mkdir()
    (DSZ.parent / "python").symlink_to(base / "bin" / version)
    (DSZ.parents[1] / "pyvenv.cfg").write_text(f"home = {base / 'bin'}\ninclude-system-site-packages = false\n")
    DSZ.write_text(_START)
    DSZ.chmod(0o755)
    return DSZ


def _copy_project(package: Path) -> None:
    """As in pyproject.toml: the package, in it the folders that are shipped."""
    shutil.copytree(PROJECT / "dsz_daemon", package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in ("config", "dbc", "systemd"):
        shutil.copytree(PROJECT / folder, package / "_shipped" / folder)
    compileall.compile_dir(package, quiet=1)


def _mounted(what: Path, where: Path) -> Path:
    where.mkdir(parents=True)
    subprocess.run(["mount", "--bind", what, where], check=True)
    return where


def _runtime_names() -> set[str]:
    """What `pip install dsz-daemon` puts into site-packages, but for dsz_daemon itself."""
    names: set[str] = set()
    seen: set[str] = set()
    wanted = _requirements("dsz-daemon")
    while wanted:
        name = wanted.pop()
        if name in seen:
            continue
        seen.add(name)
        try:
            files = metadata.files(name) or []
        except metadata.PackageNotFoundError:
            continue  # for another Python or system
        names |= {file.parts[0] for file in files if file.parts[0] not in {"..", "__pycache__"}}
        wanted |= _requirements(name)
    return names


def _requirements(name: str) -> set[str]:
    """Names of the distributions that one requires, those of extras left out."""
    lines = metadata.requires(name) or []
    return {match[0] for line in lines if "extra ==" not in line and (match := re.match(r"[\w.-]+", line))}
