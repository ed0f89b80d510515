"""Builds wheel and sdist, installs the wheel into an environment of its own and uses it in an empty folder.

What a user of the wheel has: no checkout, no development tools. Ends with 0 when everything worked.
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[2]


def run(*command: str | Path, cwd: Path) -> str:
    """Runs a command; shows its output and ends where it fails."""
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
        raise SystemExit(f"failed ({done.returncode}): {' '.join(str(part) for part in command)}")
    return done.stdout


def main() -> None:
    """Builds, installs and uses."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
        run(*pip, "wheel", "--no-deps", "-w", folder, ROOT, cwd=folder)
        run(*pip, "install", "--target", folder / "build", "hatchling", cwd=folder)
        run(
            sys.executable, "-c",
            f"import sys; sys.path.insert(0, {str(folder / 'build')!r}); import os; os.chdir({str(ROOT)!r});"
            f"from hatchling.build import build_sdist; build_sdist({str(folder)!r})",
            cwd=folder,
        )  # fmt: skip
        (wheel,) = folder.glob("*.whl")
        (sdist,) = folder.glob("*.tar.gz")
        inside = set(zipfile.ZipFile(wheel).namelist())
        for wanted in ("dsz_daemon/_shipped/dbc/dsz.dbc", "dsz_daemon/_shipped/config/example.yaml"):
            if wanted not in inside:
                raise SystemExit(f"{wanted} is not in {wheel.name}")
        with tarfile.open(sdist) as archive:
            if not any(member.endswith("/dbc/dsz.dbc") for member in archive.getnames()):
                raise SystemExit(f"dbc/dsz.dbc is not in {sdist.name}")
        venv.create(folder / "env", with_pip=True)
        python, dsz = folder / "env" / "bin" / "python", folder / "env" / "bin" / "dsz"
        # The runtime dependencies only: what a vehicle has.
        run(python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", wheel, cwd=folder)
        empty = folder / "empty"
        empty.mkdir()
        print(run(dsz, "--version", cwd=empty).strip())
        shipped = run(python, "-c", "from dsz_daemon.shipped import shipped; print(shipped('config'))", cwd=empty)
        example = Path(shipped.strip()) / "example.yaml"
        print(run(dsz, "check", example, cwd=empty).splitlines()[0])
        run(
            dsz,
            "run",
            "-c",
            example,
            "--bus",
            "can0=virtual:a",
            "--bus",
            "can1=virtual:b",
            "--duration",
            "0.5",
            cwd=empty,
        )
        refused = subprocess.run(
            [str(dsz), "demo", "-o", "demo"], cwd=empty, capture_output=True, text=True, check=False
        )
        if refused.returncode != 4 or "dsz-daemon[desk]" not in refused.stderr or "Traceback" in refused.stderr:
            raise SystemExit(f"without the desk extra, demo said: {refused.stderr}")
        run(python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", f"{wheel}[desk]", cwd=folder)
        print(run(dsz, "demo", "-o", "demo", "--speed", "20", cwd=empty))
        if not (empty / "demo" / "report.html").is_file():
            raise SystemExit("dsz demo wrote no report.html")


if __name__ == "__main__":
    main()
