"""Runs the notebook of docs/ and compares its outputs; COBSCOPE_BLESS=1 writes them."""

import ast
import contextlib
import io
import json
import os
import pathlib
import unittest

NOTEBOOK = pathlib.Path(__file__).resolve().parents[3] / "docs" / "python.ipynb"


def run(source, names):
    """Runs a cell as Jupyter does: the value of an expression at the end is shown."""
    body = ast.parse(source).body
    shown = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    output, value = io.StringIO(), None
    with contextlib.redirect_stdout(output):
        exec(compile(ast.Module(body, []), "cell", "exec"), names)
        if shown is not None:
            value = eval(compile(ast.Expression(shown.value), "cell", "eval"), names)
    return output.getvalue(), None if value is None else repr(value)


def outputs(printed, shown, count):
    result = []
    if printed:
        result.append({"name": "stdout", "output_type": "stream", "text": printed.splitlines(keepends=True)})
    if shown is not None:
        data = {"text/plain": [shown]}
        result.append({"data": data, "execution_count": count, "metadata": {}, "output_type": "execute_result"})
    return result


class Notebook(unittest.TestCase):
    def test_the_outputs_are_current(self):
        text = NOTEBOOK.read_text(encoding="utf-8")
        notebook = json.loads(text)
        names, count = {}, 0
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(NOTEBOOK.parent)
        for cell in notebook["cells"]:
            if cell["cell_type"] != "code":
                continue
            count += 1
            printed, shown = run("".join(cell["source"]), names)
            cell["execution_count"] = count
            cell["outputs"] = outputs(printed, shown, count)
        self.assertGreater(count, 5)
        now = json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
        if os.environ.get("COBSCOPE_BLESS"):
            NOTEBOOK.write_text(now, encoding="utf-8")
        else:
            self.assertEqual(json.loads(text)["cells"], notebook["cells"])


if __name__ == "__main__":
    unittest.main()
