#!/usr/bin/env python3
"""Reads EDS and DCF files with canopen-python.

    eds_values.py NODE_ID FILE…     prints one line of JSON per file

{"file": NAME, "error": TEXT} or {"file": NAME, "entries": {"1018:01": {…}}},
an entry with object, name (null for variables), type (number in CiA 301),
access, mappable, default, low, high and value. Values are null or text with a
prefix for their kind: i:-3, r:5.2, t:words, b:c83dbb.

Indexes below 0020, which canopen-python creates from [DummyUsage], are
omitted. A file with other text than UTF-8 is read as Windows-1252, because the
library leaves the encoding to the caller.
"""
import io
import json
import logging
import os
import sys

from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.eds import import_eds


def show(value):
    if value is None:
        return None
    if isinstance(value, (bytes, bytearray)):
        return "b:" + bytes(value).hex()
    if isinstance(value, float):
        return "r:" + repr(value)
    if isinstance(value, int):
        return "i:" + str(value)
    return "t:" + value


def entry(variable, thing):
    return {
        "object": thing.name,
        "name": None if variable is thing else variable.name,
        "type": variable.data_type,
        "access": variable.access_type,
        "mappable": variable.pdo_mappable,
        "default": show(variable.default),
        "low": show(variable.min),
        "high": show(variable.max),
        "value": show(variable.value),
    }


def entries(path, node_id):
    with open(path, "rb") as file:
        data = file.read()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
    # Universal newlines, like open().
    dictionary = import_eds(io.StringIO(text, newline=None), node_id)
    found = {}
    for index, thing in dictionary.indices.items():
        if index < 0x20:
            continue
        variables = [thing] if isinstance(thing, ODVariable) else thing.subindices.values()
        for variable in variables:
            found[f"{index:04X}:{variable.subindex:02X}"] = entry(variable, thing)
    return found


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    logging.disable()
    for path in sys.argv[2:]:
        result = {"file": os.path.basename(path)}
        try:
            result["entries"] = entries(path, int(sys.argv[1]))
        except Exception as error:  # any exception of the library is its result
            result["error"] = f"{type(error).__name__}: {error}"
        print(json.dumps(result))


if __name__ == "__main__":
    main()
