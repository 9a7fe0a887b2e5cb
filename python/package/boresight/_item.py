"""The program that processes one item of a campaign, see `_items.command`.

It reads the item as a line of JSON, and prints the reason if the item fails. The parent process keeps the input open;
when the input closes, the parent has ended, and this process ends too.
"""

from __future__ import annotations

import _thread
import os
import sys
import threading
import time

from . import _boresight
from ._progress import Listener

# Read without buffers of the interpreter: a thread that waits in one would keep the process from ending.
_INPUT = 0
# Time to clean up after the parent has ended, seconds.
_PATIENCE_S = 20.0


def _first_line() -> str:
    line = b""
    while not line.endswith(b"\n"):
        piece = os.read(_INPUT, 1 << 16)
        if not piece:
            sys.exit(1)
        line += piece
    return line.decode()


def _end_with_parent() -> None:
    while os.read(_INPUT, 1):
        pass
    _thread.interrupt_main()
    time.sleep(_PATIENCE_S)
    os._exit(1)


def main() -> None:
    """Processes the item of the input."""
    root, out = sys.argv[1:3]
    memory_bytes, threads = (int(limit) or None for limit in sys.argv[3:5])
    item = _first_line()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        failure = _boresight.campaign_work(item, root, out, memory_bytes, Listener(None), threads)
    except KeyboardInterrupt:
        sys.exit(1)
    if failure is not None:
        print(failure, flush=True)
        sys.exit(1)
