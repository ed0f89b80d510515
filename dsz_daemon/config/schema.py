"""The JSON Schema by which editors complete and check a configuration while it is typed.

`python -m dsz_daemon.config.schema` writes `config/dsz.schema.json`; a test holds it to the
settings. A YAML file refers to it in its first line: `# yaml-language-server: $schema=...`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from dsz_daemon.config.settings import Settings
from dsz_daemon.shipped import shipped


def schema_text() -> str:
    """The schema, sorted and indented so that its differences can be read."""
    schema = Settings.model_json_schema()
    _tidied(schema, schema["$defs"])
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "dsz configuration"
    return json.dumps(schema, indent=2, sort_keys=True, ensure_ascii=False) + "\n"


def _tidied(node: Any, definitions: dict[str, Any]) -> None:
    """Without titles that only repeat names; sections that have a default may be given in part.

    The second is what `load.completed` does.
    """
    if isinstance(node, dict):
        if isinstance(node.get("title"), str):
            del node["title"]
        if isinstance(node.get("default"), dict) and "$ref" in node:
            definitions[node["$ref"].rpartition("/")[2]].pop("required", None)
    if isinstance(node, dict | list):
        for child in node.values() if isinstance(node, dict) else node:
            _tidied(child, definitions)


def main(arguments: list[str]) -> int:
    """Write the schema to the file that is named, or over the one that ships."""
    path = Path(arguments[0]) if arguments else shipped("config") / "dsz.schema.json"
    path.write_text(schema_text(), encoding="utf-8")
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
