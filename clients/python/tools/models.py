"""Writes src/pinstack/models.py, the types of the JSON documents, from the OpenAPI document of the service.

python tools/models.py ../../openapi/openapi.json > src/pinstack/models.py
"""

from __future__ import annotations

import json
import keyword
import sys
from pathlib import Path
from typing import Any, Dict, List, Set

#: The documents that the client takes or returns. What they refer to follows.
ROOTS = [
    "Calibration", "CalibrationOptions", "ErrorLocation", "Info", "Metrics", "NameGrouping", "PoseReport", "Problem",
    "Profile", "ProfileInput", "ProfileSummary", "Progress", "RerunOptions", "ResumableUpload", "ScanArchiveView",
    "Scan", "ScanInput", "ScanRerun", "ScanWithViews", "Stack", "StackOptionsInput", "StackTotals",
    "Note", "Reconstruction",
]  # fmt: skip

HEAD = '''"""Types of the JSON documents of the service. Written by ``tools/models.py``; do not edit.

At run time each is a plain ``dict``: members that a newer service adds are kept.
"""

from __future__ import annotations

from typing import Any, Dict, List, Literal, Optional, TypedDict

from typing_extensions import NotRequired
'''

SIMPLE = {"string": "str", "integer": "int", "number": "float", "boolean": "bool", "null": "None"}


def name_of(reference: str) -> str:
    return reference.rsplit("/", 1)[1]


def union(names: List[str]) -> str:
    distinct = list(dict.fromkeys(names))
    if "Any" in distinct:
        return "Any"
    rest = [name for name in distinct if name != "None"]
    inner = rest[0] if len(rest) == 1 else f"Union[{', '.join(rest)}]" if rest else "None"
    return f"Optional[{inner}]" if len(rest) < len(distinct) and rest else inner


def type_of(schema: Dict[str, Any]) -> str:
    """The Python type of a schema."""
    if "$ref" in schema:
        return name_of(schema["$ref"])
    if "enum" in schema:
        return f"Literal[{', '.join(json.dumps(value) for value in schema['enum'])}]"
    for key in ("oneOf", "anyOf"):
        if key in schema:
            return union([type_of(part) for part in schema[key]])
    if len(schema.get("allOf", [])) == 1:
        return type_of(schema["allOf"][0])
    kind = schema.get("type")
    if isinstance(kind, list):
        return union([type_of({**schema, "type": one}) for one in kind])
    if kind == "array":
        return f"List[{type_of(schema.get('items', {}))}]"
    if kind == "object":
        values = schema.get("additionalProperties")
        return f"Dict[str, {type_of(values)}]" if isinstance(values, dict) else "Dict[str, Any]"
    return SIMPLE.get(str(kind), "Any")


def sentence(text: str) -> str:
    return " ".join(text.split()).replace("\\", "\\\\").replace('"""', "'''")


def members(schema: Dict[str, Any]) -> List[str]:
    lines: List[str] = []
    required = set(schema.get("required", []))
    for name, part in schema.get("properties", {}).items():
        kind = type_of(part)
        kind = kind if name in required else f"NotRequired[{kind}]"
        # a class cannot have such a member
        comment = "# " if keyword.iskeyword(name) else ""
        lines.append(f"    {comment}{name}: {kind}")
    return lines


def definition(name: str, schema: Dict[str, Any]) -> str:
    """The Python definition of a named schema."""
    parts = schema.get("allOf", [])
    bases = [name_of(part["$ref"]) for part in parts if "$ref" in part]
    inline = [part for part in parts if "$ref" not in part]
    if "properties" not in schema and not parts:
        return f"{name} = {type_of(schema)}\n"
    lines = [f"class {name}({', '.join(bases) or 'TypedDict'}):"]
    lines.append(f'    """{sentence(schema.get("description", name)).split(". ")[0].rstrip(".")}."""')
    body = [line for part in [schema, *inline] for line in members(part)]
    if body:
        lines += ["", *body]
    return "\n".join(lines) + "\n"


def references(value: Any) -> Set[str]:
    if isinstance(value, dict):
        own = {name_of(value["$ref"])} if isinstance(value.get("$ref"), str) else set()
        return own.union(*(references(part) for part in value.values()))
    if isinstance(value, list):
        return set().union(*(references(part) for part in value))
    return set()


def module(document: Dict[str, Any]) -> str:
    """The text of the module."""
    schemas = document["components"]["schemas"]
    reached: Set[str] = set()
    waiting = list(ROOTS)
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting.extend(references(schemas[name]))
    # what others are built from comes first: aliases and base classes are needed when the module is loaded
    ordered: List[str] = []

    def place(name: str) -> None:
        if name in ordered:
            return
        schema = schemas[name]
        is_class = "properties" in schema or "allOf" in schema
        before = {name_of(part["$ref"]) for part in schema.get("allOf", []) if "$ref" in part}
        for other in sorted(before if is_class else references(schema)):
            place(other)
        ordered.append(name)

    for name in sorted(reached, key=lambda name: ("properties" in schemas[name] or "allOf" in schemas[name], name)):
        place(name)
    return "\n\n".join([HEAD, *(definition(name, schemas[name]) for name in ordered)])


if __name__ == "__main__":
    sys.stdout.write(module(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))))
