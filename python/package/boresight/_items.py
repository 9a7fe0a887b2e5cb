"""Items of campaigns, each processed by a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from typing import Any, TypedDict

from . import _boresight

# The child uses the paths of this process. It starts no threads of numpy, as each would count as memory of the item.
_CODE = """\
import os, sys
os.environ |= {{"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}}
sys.path[:] = {path!r}
from boresight._item import main
main()
"""


class Failure(TypedDict):
    """Why an item failed."""

    problem: str
    remedy: str | None


def command(root: str, out: str, memory_bytes: int | None, threads: int | None) -> list[str]:
    """The program that processes an item: it reads the item as a line of JSON, and prints the reason if it fails."""
    code = _CODE.format(path=sys.path)
    return [sys.executable, "-c", code, root, out, *(str(limit or 0) for limit in (memory_bytes, threads))]


def run(item: str, root: str, out: str, memory_bytes: int | None, threads: int | None) -> Failure | None:
    """Processes an item (JSON). Its results are below `out`; if it fails, returns the reason."""
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            command(root, out, memory_bytes, threads),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            # Only this process receives the signals of the terminal.
            start_new_session=True,
        ) as child,
    ):
        assert child.stdin is not None and child.stdout is not None
        output = b""
        try:
            child.stdin.write(item.encode() + b"\n")
            # The input stays open, so that the child ends with this process.
            child.stdin.flush()
            output = child.stdout.read()
        except BrokenPipeError:
            # The child has ended; its messages give the reason.
            pass
        except BaseException:
            child.kill()
            raise
        code = child.wait()
        errors.seek(0)
        messages = errors.read().decode(errors="replace")
    if output:
        failure: Failure = json.loads(output)
        return failure
    if code == 0:
        return None
    _boresight.campaign_clean(item, out)
    return _ended(code, messages, memory_bytes)


def _ended(code: int, messages: str, memory_bytes: int | None) -> Failure:
    """Why a process ended that reported no failure."""
    lines = [line.strip() for line in messages.splitlines() if line.strip()]
    last = lines[-1] if lines else ""
    for lack in (line for line in lines if "memory allocation" in line or "MemoryError" in line):
        most = "its memory" if memory_bytes is None else f"{memory_bytes // 1_000_000} MB"
        return {
            "problem": f"out of memory: {most} are not enough ({lack})",
            "remedy": "give each item more with memory_mb, or run fewer at a time",
        }
    how = f"signal {-code}" if code < 0 else f"code {code}"
    return {
        "problem": f"its process ended: {how} {last}".rstrip(),
        "remedy": "run the campaign again; if this drive fails again, report it as a bug in boresight",
    }


def title(item: dict[str, Any]) -> str:
    """An item in words."""
    return " ".join(item[key] for key in ("kind", "plot", "date") if item.get(key))
