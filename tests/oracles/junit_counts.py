"""Compares the counts in JUnit XML with its test cases."""

import sys
import xml.etree.ElementTree as ET

root = ET.parse(sys.argv[1]).getroot()
assert root.tag == "testsuites"
suites = root.findall("testsuite")
assert len(suites) > 50
total = 0
for suite in suites:
    cases = suite.findall("testcase")
    total += len(cases)
    assert int(suite.get("tests")) == len(cases)
    assert int(suite.get("failures")) == len([case for case in cases if case.find("failure") is not None])
    assert int(suite.get("errors")) == len([case for case in cases if case.find("error") is not None])
    assert int(suite.get("skipped")) == len([case for case in cases if case.find("skipped") is not None])
    assert len({case.get("name") for case in cases}) == len(cases)
assert int(root.get("tests")) == total
assert int(root.get("failures")) > 0 and int(root.get("errors")) > 0
