"""The audit holds here, and finds what is planted."""

from __future__ import annotations

import json
from email.message import Message
from importlib import metadata
from pathlib import Path

import audit
import pytest

DECLARED = {"vehicle": {"numpy", "can"}, "desk": {"plotly"}}


def package(tmp_path: Path, text: str) -> Path:
    folder = tmp_path / "planted"
    folder.mkdir()
    (folder / "module.py").write_text(text, encoding="utf-8")
    return folder


def test_what_can_be_looked_at_without_a_network_is_good_here(capsys: pytest.CaptureFixture[str]) -> None:
    assert audit.main(["--offline"]) == 0, capsys.readouterr().out


@pytest.mark.parametrize(
    "text",
    [
        "import pickle\n",
        "from pickle import loads\n",
        "def f():\n    import marshal\n",
        "import importlib\nimportlib.import_module('shelve')\n",
        "eval('1')\n",
        "exec('1')\n",
        "__import__('os')\n",
        "import yaml\nyaml.load(x, Loader=yaml.Loader)\n",
        "import yaml\nyaml.unsafe_load(x)\n",
        "import subprocess\nsubprocess.run('ls', shell=True)\n",
        "import subprocess\nsubprocess.run('ls', shell=anything)\n",
        "import os\nos.system('ls')\n",
        "import numpy as np\nnp.load('x', allow_pickle=True)\n",
        "x = 1  # noqa\n",
        "import subprocess\nsubprocess.run(x, shell=False)  # noqa: S602 - a reason\n",
        "run(x)  # noqa: S603\n",
        "eval(x)  # noqa: S307 - a reason\n",
    ],
)
def test_whatever_could_run_what_a_file_says_is_found(tmp_path: Path, text: str) -> None:
    assert audit.forbidden_constructs(package(tmp_path, text))


@pytest.mark.parametrize(
    "text",
    [
        "import json\njson.loads('1')\n",
        "import yaml\nyaml.compose(x, Loader=yaml.SafeLoader)\n",
        "import subprocess\nsubprocess.run(['ls'], shell=False)  # noqa: S603 - our own program\n",
        "import re\nre.compile('x')\n",
        "class A:\n    def eval(self): ...\nA().eval()\n",
        "f(x)  # noqa: N801 - reads as a verb\n",
    ],
)
def test_the_usual_is_no_fault(tmp_path: Path, text: str) -> None:
    assert audit.forbidden_constructs(package(tmp_path, text)) == []


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("import requests\n", "requests"),
        ("def f():\n    from scipy.linalg import expm\n", "scipy.linalg"),
        ("import importlib\nimportlib.import_module('pandas')\n", "pandas"),
        ("import importlib\nimportlib.import_module(name)\n", "?"),
    ],
)
def test_an_import_that_nobody_declared_is_found(tmp_path: Path, text: str, named: str) -> None:
    (fault,) = audit.undeclared_imports(package(tmp_path, text), DECLARED)
    assert f"imports {named}," in fault


def test_declared_and_standard_imports_are_good(tmp_path: Path) -> None:
    text = "import os.path, can\nfrom numpy import linalg\nimport plotly\nfrom planted import module\nfrom . import x\n"
    assert audit.undeclared_imports(package(tmp_path, text), DECLARED) == []


class _Distribution(metadata.Distribution):
    def __init__(self, **fields: str) -> None:
        self._fields = fields

    @property
    def metadata(self) -> Message:  # type: ignore[override]
        message = Message()
        for name, value in self._fields.items():
            message[name.replace("_", "-")] = value
        return message

    def read_text(self, filename: str) -> None:
        return None

    def locate_file(self, path: object) -> Path:
        return Path(str(path))


@pytest.mark.parametrize(
    ("fields", "is_known"),
    [
        ({"License_Expression": "MIT"}, True),
        ({"License_Expression": "LGPL-3.0-only"}, True),
        ({"Classifier": "License :: OSI Approved :: GNU Lesser General Public License v3 (LGPLv3)"}, True),
        ({"License": "BSD 3-Clause\nCopyright"}, True),
        ({"License_Expression": "GPL-3.0-or-later"}, False),
        ({"License_Expression": "AGPL-3.0-only"}, False),
        ({"Classifier": "License :: OSI Approved :: GNU General Public License v2 (GPLv2)"}, False),
        ({"License": "Proprietary"}, False),
        ({}, False),
    ],
)
def test_licences(fields: dict[str, str], is_known: bool) -> None:
    assert (audit.unknown_licences({"x": _Distribution(**fields)}) == []) is is_known


def test_a_known_vulnerability_is_a_fault() -> None:
    answer = {"dependencies": [{"name": "x", "version": "1", "vulns": [{"id": "CVE-1", "fix_versions": ["2"]}]}]}
    assert audit.judged(json.dumps(answer), "") == (["x 1: CVE-1, mended in 2"], "")


def test_a_network_that_swallows_what_is_sent_is_said_and_no_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pip_audit").mkdir()
    (tmp_path / "pip_audit" / "__init__.py").touch()
    (tmp_path / "pip_audit" / "__main__.py").write_text("import time\ntime.sleep(60)\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(audit, "_PATIENCE_S", 0.5)
    assert audit.vulnerabilities({}) == ([], "pip-audit got no answer within 0.5 s")


@pytest.mark.parametrize(
    ("answer", "errors", "words"),
    [
        ("", "requests.exceptions.ConnectionError: no route", "could not ask: requests.exceptions.ConnectionError"),
        ("", "", "no answer"),
        (json.dumps({"dependencies": [{"name": "x", "skip_reason": "not found"}]}), "", "knew none"),
        (
            json.dumps(
                {"dependencies": [{"name": "x", "skip_reason": "?"}, {"name": "y", "version": "1", "vulns": []}]}
            ),
            "",
            "not known to the service: x",
        ),
    ],
)
def test_not_having_looked_is_said(answer: str, errors: str, words: str) -> None:
    found, blind = audit.judged(answer, errors)
    assert found == []
    assert words in blind
