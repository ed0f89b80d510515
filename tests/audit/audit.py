"""Dependency audit, part of `make check`: `python tests/audit/audit.py` (`--offline`: no question to the network).

Offline, and each a failure: the environment is consistent (`pip check`); every import of dsz_daemon is the
standard library or a declared dependency, on the vehicle or on the desk; nothing is unpickled, evaluated or handed
to a shell, and no `noqa` hides it; licences of all that gets installed are known ones. Online: `pip-audit` asks for
known vulnerabilities of what the vehicle installs; where it can't look, that is said and is no failure.
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "dsz_daemon"

# By name of the module. PyYAML and json read; pickle, marshal and shelve would run what they read.
_FORBIDDEN_MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "code", "codeop", "runpy"}
# Where a module's name is no text in the call: it is one of two in that very file.
_COMPUTED = {"edge/samples_file.py"}
_FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "breakpoint"}
_FORBIDDEN_ATTRIBUTES = {
    ("os", "system"), ("os", "popen"), ("os", "execv"), ("os", "execve"), ("os", "spawnv"), ("subprocess", "getoutput"),
    ("subprocess", "getstatusoutput"), ("tempfile", "mktemp"), ("yaml", "load_all"), ("yaml", "unsafe_load"),
    ("yaml", "full_load"),
    ("numpy", "load"), ("np", "load"), ("pandas", "read_pickle"), ("builtins", "eval"), ("builtins", "exec"),
}  # fmt: skip
# ruff's rules that say the same of what is called in the usual way; here none may be switched off.
_NEVER_HIDDEN = ("S102", "S301", "S302", "S306", "S307", "S506", "S602", "S604", "S605")
# May be switched off where the line says why: which program is started is ours to say, not a file's.
_WITH_A_REASON = ("S603", "S607", "S108", "S104", "S310", "S324", "S314")

# Permissive, or weak copyleft in a library that is only imported and can be exchanged by its user.
_LICENCES = re.compile(
    r"MIT|BSD|Apache|Python Software Foundation|PSF|ISC|Zlib|Unlicense|CC0|MPL|Mozilla|LGPL|Lesser General|HPND|NCSA",
    re.IGNORECASE,
)
_STRONG = re.compile(r"(?<!L)(?<!Lesser )(?:AGPL|\bGPL|General Public License)(?!.*(?:LGPL|Lesser))", re.IGNORECASE)

# Twenty packages are asked for in some five seconds; a network that swallows what is sent must not keep `make check`.
_PATIENCE_S = 20.0


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """(line, module) of everything that a file imports, by a statement or by `import_module` of a text."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.lineno, node.module
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module") and node.args:
            name = node.args[0]
            yield node.lineno, name.value if isinstance(name, ast.Constant) and isinstance(name.value, str) else "?"


def undeclared_imports(package: Path, declared: dict[str, set[str]]) -> list[str]:
    """Imports that no declared dependency provides; `declared` are module names for "vehicle" and "desk"."""
    faults = []
    for path in sorted(package.rglob("*.py")):
        for line, module in imports(path):
            top = module.split(".")[0]
            if module == "?" and str(path.relative_to(package)) in _COMPUTED:
                continue
            if top == package.name or top in sys.stdlib_module_names or top in declared["vehicle"] | declared["desk"]:
                continue
            faults.append(f"{path.relative_to(package.parent)}:{line}: imports {module}, which no dependency declares")
    return faults


def declared_modules() -> dict[str, set[str]]:
    """Top-level modules of the declared dependencies, from what is installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional = project["optional-dependencies"]
    providers = metadata.packages_distributions()

    def provided(requirements: Sequence[str]) -> set[str]:
        names = {_normal(re.split(r"[^\w.-]", requirement)[0]) for requirement in requirements}
        return {module for module, found in providers.items() if names & {_normal(name) for name in found}}

    # pydantic's errors are typed by its own core, which it pins: one library in two parts.
    return {
        "vehicle": provided([*project["dependencies"], "pydantic-core"]),
        # What only the desk has is imported where it is called (tests/wheel shows that the vehicle does without).
        "desk": provided([r for name, extra in optional.items() if name != "dev" for r in extra]),
    }


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def forbidden_constructs(package: Path) -> list[str]:
    """Whatever could run what a file says; and comments that switch ruff's word on it off."""
    faults = []
    for path in sorted(package.rglob("*.py")):
        text, place = path.read_text(encoding="utf-8"), path.relative_to(package.parent)
        faults += [f"{place}:{line}: {what}" for line, what in _forbidden(ast.parse(text))]
        for line, module in imports(path):
            if module.split(".")[0] in _FORBIDDEN_MODULES:
                faults.append(f"{place}:{line}: imports {module}")
        for number, line in enumerate(text.splitlines(), 1):
            faults += [f"{place}:{number}: {what}" for what in _hidden(line)]
    return faults


def _forbidden(tree: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func)
        if isinstance(node.func, ast.Name) and node.func.id in _FORBIDDEN_CALLS:
            yield node.lineno, f"calls {name}"
        if isinstance(node.func, ast.Attribute) and tuple(name.split(".")[-2:]) in _FORBIDDEN_ATTRIBUTES:
            yield node.lineno, f"calls {name}"
        if name == "yaml.load":
            yield node.lineno, "calls yaml.load; expected a safe loader"
        for keyword in node.keywords:
            is_off = isinstance(keyword.value, ast.Constant) and not keyword.value.value
            if keyword.arg in {"shell", "allow_pickle"} and not is_off:
                yield node.lineno, f"{name} with {keyword.arg}"


def _hidden(line: str) -> Iterator[str]:
    found = re.search(r"#\s*(?:ruff:\s*)?noqa(?::\s*(?P<codes>[\w, ]+?))?(?P<reason>\s+-\s+\S.*)?$", line)
    if found is None:
        return
    codes = re.findall(r"[A-Z]+[0-9]+", found["codes"] or "")
    if not codes:
        yield "noqa without a rule hides everything"
    for code in codes:
        if code in _NEVER_HIDDEN:
            yield f"noqa hides {code}"
        elif code in _WITH_A_REASON and not found["reason"] and code in {"S603", "S607"}:
            yield f"noqa hides {code} without a reason"


def installed_closure(extras: Sequence[str] = ()) -> dict[str, metadata.Distribution]:
    """Our dependencies and theirs, by normal name, as far as they are installed here; ours with `extras`."""
    from packaging.requirements import Requirement

    found: dict[str, metadata.Distribution] = {}
    waiting = [("dsz-daemon", tuple(extras))]
    while waiting:
        name, wanted = waiting.pop()
        try:
            distribution = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue
        if name != "dsz-daemon":
            if _normal(name) in found:
                continue
            found[_normal(name)] = distribution
        for text in distribution.requires or ():
            requirement = Requirement(text)
            environments = [{"extra": extra} for extra in ("", *wanted)]
            if requirement.marker is None or any(requirement.marker.evaluate(e) for e in environments):
                waiting.append((requirement.name, tuple(requirement.extras)))
    return found


def licence(distribution: metadata.Distribution) -> str:
    """What a package says of its licence: SPDX expression, else classifiers, else the first line of the field."""
    about = distribution.metadata
    all_classifiers = about.get_all("Classifier") or []
    classifiers = [c.rpartition("::")[2].strip() for c in all_classifiers if c.startswith("License ::")]
    field = (about.get("License") or "").strip().splitlines()
    return about.get("License-Expression") or ", ".join(classifiers) or (field[0][:80] if field else "")


def unknown_licences(closure: dict[str, metadata.Distribution]) -> list[str]:
    """Packages whose licence is none of the known ones, or strong copyleft."""
    faults = []
    for name, distribution in sorted(closure.items()):
        said = licence(distribution)
        if not _LICENCES.search(said) or _STRONG.search(said):
            faults.append(f"{name}: licence {said or 'not said'!r}; expected a permissive one or the LGPL")
    return faults


def pip_check() -> list[str]:
    """What pip finds inconsistent."""
    done = subprocess.run([sys.executable, "-m", "pip", "check"], capture_output=True, text=True, check=False)
    return [] if done.returncode == 0 else [line for line in done.stdout.splitlines() if line.strip()]


def vulnerabilities(closure: dict[str, metadata.Distribution]) -> tuple[list[str], str]:
    """(known vulnerabilities, "" or why nobody could look, or at which packages)."""
    if importlib.util.find_spec("pip_audit") is None:
        return [], "pip-audit is not installed (pip install pip-audit)"
    with tempfile.TemporaryDirectory() as folder:
        pinned = Path(folder) / "requirements.txt"
        pinned.write_text("".join(f"{name}=={d.version}\n" for name, d in closure.items()), encoding="utf-8")
        command = [sys.executable, "-m", "pip_audit", "--requirement", str(pinned), "--no-deps", "--disable-pip"]
        command += ["--format", "json", "--progress-spinner", "off", "--timeout", "5"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_PATIENCE_S)
        except subprocess.TimeoutExpired:
            return [], f"pip-audit got no answer within {_PATIENCE_S:g} s"
    return judged(done.stdout, done.stderr)


def judged(answer: str, errors: str) -> tuple[list[str], str]:
    """The same from pip-audit's JSON and its standard error.

    A service that knows none of the packages (a mirror without that interface) is as good as none: pip-audit
    itself would call that success.
    """
    try:
        packages = json.loads(answer)["dependencies"]
    except (ValueError, KeyError):
        last = (errors.strip().splitlines() or ["no answer"])[-1]
        return [], f"pip-audit could not ask: {last[:200]}"
    found = [
        f"{p['name']} {p['version']}: {v['id']}, mended in {', '.join(v['fix_versions']) or 'no version yet'}"
        for p in packages
        for v in p.get("vulns", ())
    ]
    passed_over = [p["name"] for p in packages if "skip_reason" in p]
    if len(passed_over) == len(packages):
        return found, "the service knew none of the packages"
    return found, f"not known to the service: {', '.join(passed_over)}" if passed_over else ""


def main(argv: Sequence[str] | None = None) -> int:
    """Prints what was looked at and found; 1 if anything must be mended."""
    parser = argparse.ArgumentParser(description="Dependency audit.")
    parser.add_argument("--offline", action="store_true", help="don't ask for known vulnerabilities")
    arguments = parser.parse_args(argv)
    vehicle, desk = installed_closure(), installed_closure(("desk",))
    checks = {
        "pip check": pip_check(),
        f"imports of {PACKAGE.name} are declared": undeclared_imports(PACKAGE, declared_modules()),
        "nothing runs what a file says": forbidden_constructs(PACKAGE),
        f"licences of {len(vehicle)} packages on the vehicle, {len(desk)} on the desk": unknown_licences(
            desk | vehicle
        ),
    }
    if not arguments.offline:
        found, blind = vulnerabilities(vehicle)
        if found or not blind:
            checks[f"known vulnerabilities of the vehicle's {len(vehicle)} packages"] = found
        if blind:
            print(f"audit: NOT LOOKED AT: known vulnerabilities: {blind}")
    for name, faults in checks.items():
        print(f"audit: {name}: {'good' if not faults else f'{len(faults)} faults'}")
        for fault in faults:
            print(f"  {fault}")
    return 1 if any(checks.values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())
