"""Tests of the module against literal values and against the program's own output."""

import ast
import contextlib
import datetime
import inspect
import io
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import unittest

import cobscope

ROOT = pathlib.Path(__file__).resolve().parents[3]
FIXTURES = ROOT / "fixtures"
SYDFEC = FIXTURES / "devices" / "sydfec.log"
NODES = {2: "rexroth-sydfec"}
MACHINE = FIXTURES / "machine" / "machine.log"
MACHINE_BUS = FIXTURES / "machine" / "machine.bus.toml"


def sydfec(**options):
    return cobscope.open(SYDFEC, node=NODES, **options)


def program(*arguments, status=0):
    done = subprocess.run([sys.executable, "-m", "cobscope", *map(str, arguments)], capture_output=True, cwd=ROOT)
    assert done.returncode == status, (arguments, done.returncode, done.stderr)
    return done.stdout


def lines(text):
    return [json.loads(line) for line in text.splitlines()]


class Values(unittest.TestCase):
    def test_values_of_a_frame(self):
        # Frame 23 is 182#08A01F0020: 8096 of 16383 is 49.417079 %, 8192 of 16383 is 157.509614 of 315 bar.
        rows = [row for row in sydfec().signals() if row["frame"] == 23]
        shown = [(row["group"], row["signal"], row["value"] and round(row["value"], 6), row["unit"], row["raw"]) for row in rows]
        self.assertEqual(shown, [
            ("node/2/tpdo1", "Status byte", 8, None, 8),
            ("node/2/tpdo1", "Angle actual value", 49.417079, "%", 8096),
            ("node/2/tpdo1", "Pressure actual value", 157.509614, "bar", 8192),
        ])
        self.assertEqual(rows[0]["time_ns"], 1_700_000_001_141_000_000)
        utc = datetime.timezone.utc
        self.assertEqual(rows[0]["time"], datetime.datetime(2023, 11, 14, 22, 13, 21, 141_000, utc))
        self.assertEqual((rows[0]["node"], rows[0]["device"], rows[0]["bus"]), (2, "rexroth-sydfec", "can0"))
        self.assertEqual(rows[0]["capture"], str(SYDFEC))

    def test_a_filter_selects_events(self):
        kinds = {row["kind"] for row in sydfec().events("kind == emcy || kind == boot-up")}
        self.assertLessEqual(kinds, {"emcy", "boot-up"})
        self.assertTrue(kinds)
        self.assertEqual(list(sydfec().signals("node == 9")), [])

    def test_frames(self):
        frames = [row for row in sydfec().frames() if row["frame"] == 23]
        self.assertEqual([(row["id"], row["data"], row["extended"], row["dlc"]) for row in frames],
                         [(0x182, bytes.fromhex("08A01F0020"), False, 5)])

    def test_a_table_can_be_read_again(self):
        table = sydfec().signals()
        self.assertEqual(list(table), list(table))
        self.assertGreater(len(list(table)), 10)

    def test_tables_in_memory_can_be_read_again(self):
        table = cobscope.open(MACHINE, bus=MACHINE_BUS).findings()
        self.assertEqual(len(list(table)), len(list(table)))

    def test_an_abandoned_iterator_ends_its_thread(self):
        before = threading.active_count()
        for _ in range(20):
            next(iter(sydfec().events()))
        self.assertEqual(threading.active_count(), before)


class Program(unittest.TestCase):
    """Results equal those of the program."""

    def test_events(self):
        expected = lines(program("decode", "-f", "jsonl", "--node", "2=rexroth-sydfec", SYDFEC))
        events = list(sydfec().events())
        self.assertEqual([event["json"] for event in events], expected)
        self.assertEqual([event["kind"] for event in events], [line["kind"] for line in expected])
        self.assertTrue(all("\n" not in event["text"] for event in events))

    def test_events_without_rules(self):
        expected = lines(program("decode", "-f", "jsonl", "--no-findings", "--bus", MACHINE_BUS, MACHINE))
        events = cobscope.open(MACHINE, bus=MACHINE_BUS).events(rules=False)
        self.assertEqual([event["json"] for event in events], expected)

    def test_findings(self):
        expected = [line for line in lines(program("check", "-f", "jsonl", "--bus", MACHINE_BUS, MACHINE, status=1))
                    if line["kind"] == "finding"]
        capture = cobscope.open(MACHINE, bus=MACHINE_BUS)
        findings = list(capture.findings())
        self.assertEqual([finding["json"] for finding in findings], [without_lines(line) for line in expected])
        self.assertEqual(findings[0]["rule"], "sdo-download-refused")
        self.assertEqual(findings[0]["text"], "write of 500 bar refused: 06090031 value too high")
        self.assertEqual((findings[0]["first_frame"], findings[0]["last_frame"]), (45, 46))
        self.assertEqual(findings[0]["time"].microsecond, 501_000)

    def test_check_equals_findings(self):
        result = cobscope.check(MACHINE, bus=MACHINE_BUS)
        self.assertTrue(result.fails)
        self.assertFalse(cobscope.check(MACHINE, bus=MACHINE_BUS, fail_on="never").fails)
        with tempfile.TemporaryDirectory() as empty:
            self.assertTrue(cobscope.check(empty).fails)
        self.assertEqual([capture["verdict"] for capture in result.captures], ["fail"])
        capture = cobscope.open(MACHINE, bus=MACHINE_BUS)
        self.assertEqual([row["fingerprint"] for row in result.findings], [row["fingerprint"] for row in capture.findings()])

    def test_stories(self):
        expected = json.loads(program("why", "-f", "json", "--bus", MACHINE_BUS, MACHINE))["stories"]
        stories = list(cobscope.open(MACHINE, bus=MACHINE_BUS).stories())
        self.assertEqual([story["title"] for story in stories], [story["title"] for story in expected])
        self.assertEqual(stories[0]["text"].splitlines()[0], expected[0]["lines"][0]["text"])

    def test_objects(self):
        expected = lines(program("objects", "-f", "json", "--bus", MACHINE_BUS, "--node", "32", MACHINE))
        rows = [row for row in cobscope.open(MACHINE, bus=MACHINE_BUS).objects() if row["node"] == 32]
        self.assertEqual([row["json"] for row in rows], expected)
        self.assertEqual((rows[0]["object"], rows[0]["value"], rows[0]["data"]), ("1000:00", 408, "98010000"))

    def test_statistics(self):
        self.assertEqual(cobscope.open(MACHINE, bus=MACHINE_BUS).statistics(),
                         json.loads(program("stats", "-f", "json", "--bus", MACHINE_BUS, MACHINE)))

    def test_explain(self):
        self.assertEqual(cobscope.explain("06090031"), program("explain", "06090031").decode())
        of_device = program("explain", "--device", "rexroth-sydfec", "5001:00").decode()
        self.assertEqual(cobscope.explain("5001:00", device="rexroth-sydfec"), of_device)

    def test_diff(self):
        good = FIXTURES / "rules" / "node-lost.log"
        expected = json.loads(program("diff", "-f", "json", SYDFEC, good, status=1))
        found = cobscope.diff(SYDFEC, good)
        found.pop("warnings")
        self.assertEqual(found, expected)
        self.assertTrue(cobscope.diff(SYDFEC, SYDFEC)["equal"])

    def test_the_program_answers(self):
        self.assertEqual(program("--version").split()[0], b"cobscope")
        program("decode", "absent.log", status=3)


def without_lines(finding):
    """Findings of a capture in memory have no line numbers."""
    for occurrence in finding["occurrences"]:
        occurrence.pop("line", None)
        occurrence.pop("file", None)
    return finding


class Errors(unittest.TestCase):
    def raised(self, kind, work):
        with self.assertRaises(kind) as caught:
            work()
        self.assertIsInstance(caught.exception, cobscope.Error)
        return caught.exception

    def test_a_missing_capture(self):
        error = self.raised(cobscope.CaptureError, lambda: cobscope.open("absent.log"))
        self.assertEqual(error.place, "absent.log")
        self.assertEqual(error.reason, "cannot be opened: No such file or directory (os error 2)")

    def test_an_unknown_profile(self):
        error = self.raised(cobscope.ProfileError, lambda: cobscope.open(SYDFEC, node={2: "rexroth-sydfek"}))
        self.assertEqual(error.place, "--node 2=rexroth-sydfek")
        self.assertIn("did you mean 'rexroth-sydfec'?", error.reason)

    def test_a_bus_file_names_the_place(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "m.toml")
            with open(path, "w", encoding="utf-8") as file:
                file.write("[node.2]\nnam = 1\n")
            error = self.raised(cobscope.ProfileError, lambda: cobscope.open(SYDFEC, bus=path))
            self.assertTrue(error.place.startswith(f"{path}:2:1"), error.place)

    def test_arguments(self):
        self.raised(cobscope.ArgumentError, lambda: cobscope.open(SYDFEC, node={300: "rexroth-sydfec"}))
        self.raised(cobscope.ArgumentError, lambda: cobscope.open(SYDFEC, protocol="morse"))
        self.raised(cobscope.ArgumentError, lambda: sydfec().events("kind =="))
        self.raised(cobscope.ArgumentError, lambda: cobscope.explain("no such thing"))
        self.raised(cobscope.ArgumentError, lambda: cobscope.open([SYDFEC, MACHINE]))
        self.raised(cobscope.ArgumentError, lambda: cobscope.open([]))
        self.raised(cobscope.ArgumentError, lambda: cobscope.check([]))
        with self.assertRaises(TypeError):
            cobscope.open(SYDFEC, nodes=NODES)

    @unittest.skipIf(sys.platform == "win32", "names are texts there")
    def test_names_of_any_bytes(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.fsencode(folder) + b"/run\xff.log"
            with open(path, "wb") as file:
                file.write(SYDFEC.read_bytes())
            self.assertEqual(len(list(cobscope.open(path).frames())), len(list(sydfec().frames())))
            self.assertEqual(cobscope.check(path).captures[0]["frames"], len(list(sydfec().frames())))

    def test_a_file_name_is_never_an_option(self):
        error = self.raised(cobscope.CaptureError, lambda: cobscope.open("--help"))
        self.assertEqual(error.place, "--help")

    def test_a_truncated_capture(self):
        # A pcap header, a whole CAN frame, and half of the next record.
        whole = bytes.fromhex("d4c3b2a1020004000000000000000000ffff0000e3000000")
        whole += bytes(8) + bytes.fromhex("1000000010000000") + bytes.fromhex("00000705010000000000000000000000") + bytes(12)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "cut.pcap")
            with open(path, "wb") as file:
                file.write(whole)
            seen = []
            with self.assertRaises(cobscope.CaptureError) as caught:
                for row in cobscope.open(path).frames():
                    seen.append(row["id"])
            self.assertEqual(seen, [0x705])
            self.assertEqual(caught.exception.place, path)
            self.raised(cobscope.CaptureError, lambda: cobscope.open(path).findings())
            capture = cobscope.open(path, incomplete=True)
            self.assertEqual(len(list(capture.frames())), 1)
            self.assertTrue(any(path in warning for warning in capture.warnings), capture.warnings)
            list(capture.findings())

    def test_problems_of_a_database_are_warnings_and_not_printed(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "odd.dbc")
            with open(path, "w", encoding="utf-8") as file:
                file.write('VERSION ""\nBU_: A\nBO_ 291 Speed: 2 A\n SG_ rpm : 12|16@1+ (1,0) [0|0] "rpm" A\n')
            printed = io.StringIO()
            with contextlib.redirect_stderr(printed):
                capture = cobscope.open(SYDFEC, dbc=path)
            self.assertTrue(any("odd.dbc:4" in warning for warning in capture.warnings), capture.warnings)

    def test_names_are_escaped(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "hostile.log")
            with open(path, "wb") as file:
                file.write(b"(1700000000.000000) c\x1b[31m 705#00\n")
            for row in cobscope.open(path).events():
                self.assertNotIn("\x1b", row["bus"] + row["text"])


class Threads(unittest.TestCase):
    def test_the_interpreter_runs_while_a_capture_is_decoded(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "long.log")
            with open(path, "w", encoding="ascii") as file:
                for number in range(150_000):
                    file.write(f"({1_700_000_000 + number / 1000:.6f}) can0 185#{number % 65536:04X}{number // 65536:04X}\n")
            capture = cobscope.open(path)
            turns, done = [0], threading.Event()

            def work():
                capture.findings()
                done.set()

            worker = threading.Thread(target=work)
            worker.start()
            while not done.is_set():
                turns[0] += 1
            worker.join()
            # With the lock held, this thread has its turn after the end only.
            self.assertGreater(turns[0], 1_000)

    def test_two_iterators_of_one_capture(self):
        capture = sydfec()
        both = list(zip(capture.events(), capture.events()))
        self.assertTrue(all(one == other for one, other in both))
        self.assertTrue(both)


class Engines(unittest.TestCase):
    """Other libraries read the Arrow streams."""

    def test_all_engines_read_the_same_values(self):
        import duckdb
        import pandas
        import polars
        import pyarrow

        capture = sydfec()
        expected = [row["value"] for row in capture.signals() if row["value"] is not None]
        total = math.fsum(expected)
        arrow = pyarrow.table(capture.signals())
        self.assertEqual(str(arrow.schema.field("time").type), "timestamp[us, tz=UTC]")
        self.assertAlmostEqual(math.fsum(arrow["value"].drop_null().to_pylist()), total)
        of_polars = polars.DataFrame(capture.signals())
        self.assertAlmostEqual(math.fsum(of_polars["value"].drop_nulls()), total)
        self.assertEqual(of_polars["signal"].cast(polars.String).to_list(), arrow["signal"].to_pylist())
        of_pandas = pandas.DataFrame.from_arrow(capture.signals())
        self.assertAlmostEqual(of_pandas["value"].sum(), total)
        signals = capture.signals()
        self.assertAlmostEqual(duckdb.sql("SELECT fsum(value) FROM signals").fetchall()[0][0], total)
        count = duckdb.sql("SELECT count(*) FROM signals WHERE signal = 'Status byte'").fetchall()[0][0]
        self.assertEqual(count, arrow["signal"].to_pylist().count("Status byte"))

    def test_every_table_has_an_arrow_stream(self):
        import polars
        import pyarrow

        capture = cobscope.open(MACHINE, bus=MACHINE_BUS)
        for name in ("events", "signals", "frames", "findings", "stories", "objects"):
            table = getattr(capture, name)()
            arrow = pyarrow.table(table)
            self.assertEqual(arrow.column_names, table.columns)
            self.assertEqual(arrow.num_rows, len(list(table)), name)
            self.assertEqual(polars.DataFrame(table).height, arrow.num_rows)
            self.assertEqual(pyarrow.schema(table), arrow.schema)

    def test_tables_equal_parquet(self):
        import pyarrow
        import pyarrow.parquet

        with tempfile.TemporaryDirectory() as folder:
            for capture, options, arguments in (
                (SYDFEC, {"node": NODES}, ("--node", "2=rexroth-sydfec")),
                (MACHINE, {"bus": MACHINE_BUS}, ("--bus", MACHINE_BUS)),
                (FIXTURES / "devices" / "pve_j1939.log", {"node": {"sa:0x80": "danfoss-pve-ci"}},
                 ("--node", "sa:0x80=danfoss-pve-ci")),
            ):
                name = os.path.join(folder, capture.stem)
                program("decode", "-f", "parquet", "-o", name, *arguments, capture)
                opened = cobscope.open(capture, **options)
                for table in ("events", "signals"):
                    expected = pyarrow.parquet.read_table(f"{name}.{table}.parquet").drop_columns("capture")
                    found = pyarrow.table(getattr(opened, table)()).drop_columns("capture")
                    self.assertEqual(found.column_names, expected.column_names)
                    self.assertEqual(found.to_pylist(), expected.to_pylist(), (capture, table))

    def test_a_truncated_capture_is_an_error_of_the_stream(self):
        import pyarrow

        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "gone.log")
            with open(path, "wb") as file:
                file.write(SYDFEC.read_bytes())
            capture = cobscope.open(path)
            os.remove(path)
            with self.assertRaisesRegex(Exception, "gone.log: cannot be opened"):
                pyarrow.table(capture.events())


class Live(unittest.TestCase):
    def test_frames_of_python_can_give_the_events_of_the_capture(self):
        import can

        decoder = cobscope.Decoder(node=NODES)
        with can.LogReader(str(SYDFEC)) as reader:
            for message in reader:
                message.channel = "can0"
                decoder(message)
        expected = list(sydfec().events())
        findings = decoder.finish()
        found = list(decoder.events())
        self.assertEqual([(row["kind"], row["text"]) for row in found], [(row["kind"], row["text"]) for row in expected])
        self.assertEqual([row["value"] for row in decoder.signals()], [row["value"] for row in sydfec().signals()])
        self.assertEqual([row["fingerprint"] for row in findings], [row["fingerprint"] for row in sydfec().findings()])
        self.assertEqual(decoder.frames, expected[-1]["last_frame"])
        with self.assertRaises(cobscope.ArgumentError) as caught:
            decoder.push(1.0, 0x80)
        self.assertEqual((caught.exception.place, caught.exception.reason), (None, "the decoder is finished"))

    def test_events_are_passed_on_however_they_arise(self):
        seen = []
        decoder = cobscope.Decoder(on_event=lambda event: seen.append((event["kind"], event["json"].get("outcome"))))
        decoder.push(10.0, 0x705, b"\0")
        self.assertEqual(seen[0], ("boot-up", None))
        decoder.push(11.0, 0x605, bytes.fromhex("4000100000000000"))
        decoder.advance(13.5)
        self.assertIn(("sdo-transfer", "timeout"), seen)
        decoder.push(14.0, 0x605, bytes.fromhex("4000100000000000"))
        before = len(seen)
        decoder.finish()
        self.assertGreater(len(seen), before)
        self.assertEqual(list(decoder.events()), [])

    def test_a_notifier_calls_with_each_event(self):
        import can

        arrived = threading.Event()
        seen = []

        def on_event(event):
            seen.append(event["kind"])
            if event["kind"] == "emcy":
                arrived.set()

        decoder = cobscope.Decoder(on_event=on_event)
        with can.Bus("cobscope-test", interface="virtual") as sender, can.Bus("cobscope-test", interface="virtual") as bus:
            notifier = can.Notifier(bus, [decoder])
            sender.send(can.Message(arbitration_id=0x705, data=[0], is_extended_id=False))
            sender.send(can.Message(arbitration_id=0x85, data=bytes.fromhex("1081010000000000"), is_extended_id=False))
            self.assertTrue(arrived.wait(30))
            notifier.stop()
        self.assertEqual(seen[0], "boot-up")

    def test_deadlines_expire_without_frames(self):
        decoder = cobscope.Decoder()
        decoder.push(10.0, 0x605, bytes.fromhex("4000100000000000"))
        decoder.advance(12.5)
        outcomes = [row["json"]["outcome"] for row in decoder.events() if row["kind"] == "sdo-transfer"]
        self.assertEqual(outcomes, ["timeout"])

    def test_wrong_frames_are_refused(self):
        decoder = cobscope.Decoder()
        for work in (
            lambda: decoder.push(1.0, 0x800),
            lambda: decoder.push(1.0, 0x20000000, extended=True),
            lambda: decoder.push(1.0, 0x100, bytes(9)),
            lambda: decoder.push(1.0, 0x100, bytes(65), fd=True),
            lambda: decoder.push(float("nan"), 0x100),
            lambda: decoder.push(1e300, 0x100),
        ):
            self.assertRaises(cobscope.ArgumentError, work)
        self.assertEqual(decoder.frames, 0)
        decoder.push(None, 0x705, b"\0")
        self.assertEqual(decoder.frames, 1)


class Interface(unittest.TestCase):
    def test_everything_public_has_a_stub_and_a_description(self):
        stub = ast.parse((pathlib.Path(cobscope.__file__).parent / "__init__.pyi").read_text(encoding="utf-8"))
        stubs = {node.name: node for node in stub.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
        for name in cobscope.__all__:
            if name == "__version__":
                continue
            thing = getattr(cobscope, name)
            self.assertTrue(inspect.getdoc(thing), name)
            self.assertIn(name, stubs)
            if not inspect.isclass(thing) or issubclass(thing, Exception):
                continue
            members = {member.name for member in stubs[name].body if isinstance(member, ast.FunctionDef)}
            members |= {member.target.id for member in stubs[name].body if isinstance(member, ast.AnnAssign)}
            public = {member for base in thing.__mro__[:-1] for member in vars(base) if not member.startswith("_")}
            self.assertLessEqual(public, members, name)
            for member in public:
                self.assertTrue(inspect.getdoc(getattr(thing, member)), f"{name}.{member}")

    def test_the_version_is_that_of_the_program(self):
        self.assertEqual(program("--version").decode().split()[1], cobscope.__version__)

    def test_the_column_names_are_documented(self):
        text = (ROOT / "docs" / "python.md").read_text(encoding="utf-8") + (ROOT / "docs" / "columns.md").read_text(encoding="utf-8")
        capture = cobscope.open(MACHINE, bus=MACHINE_BUS)
        for name in ("events", "signals", "frames", "findings", "stories", "objects"):
            for column in getattr(capture, name)().columns:
                self.assertIn(f"`{column}`", text, name)


if __name__ == "__main__":
    unittest.main()
