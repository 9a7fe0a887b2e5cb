"""Shared parts of the comparisons with other programs: environments, measured processes, tables, pages."""

import datetime
import os
import platform
import shlex
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "performance.md"
MIB = 1024.0 * 1024.0


def say(text):
    print(text, file=sys.stderr, flush=True)


def environment(folder, packages):
    """The Python of the virtual environment with the packages, which is created if it is missing."""
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    subprocess.run([str(python), "-m", "pip", "install", "--quiet", *packages], check=True)
    return str(python)


def build():
    subprocess.run(["cargo", "build", "--release", "--quiet"], cwd=ROOT, check=True)
    return str(ROOT / "target" / "release" / "boresight")


def measured(command, **more):
    """Wall seconds, processor seconds, peak bytes and stdout of one process; None if it failed."""
    begun = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **more)
    out = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        say(f"failed ({process.returncode}): {shlex.join(command)}")
        return None
    return {
        "wall_s": time.perf_counter() - begun,
        "cpu_s": usage.ru_utime + usage.ru_stime,
        "peak_bytes": usage.ru_maxrss * 1024,
        "out": out,
    }


def median(runs, *path):
    def value(run):
        for key in path:
            run = run[key]
        return run

    return statistics.median(value(run) for run in runs) if runs else None


def number(value, digits=3):
    if value is None:
        return "–"
    if value >= 100:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def ratio(theirs, ours):
    return f"{theirs / ours:.1f}" if theirs is not None and ours is not None else "–"


def row(*cells):
    return "| " + " | ".join(cells) + " |"


def version(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def heading_line(script, binary, peers):
    """The command, the date, the versions and the machine."""
    # Folders are given by their names only, as the page must not show paths of this machine.
    words = [Path(word).name if word.startswith("/") else word for word in sys.argv[1:]]
    command = shlex.join(["python3", script, *words])
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1024**3
    return (f"`{command}`, {datetime.date.today()}, {version(binary, '--version')} "
            f"({version('rustc', '--version')}), {peers}, Python {platform.python_version()}, "
            f"{processor()}, {os.cpu_count()} cores, {memory:.0f} GiB, load {os.getloadavg()[0]:.1f} at the end.")


def processor():
    try:
        with open("/proc/cpuinfo") as file:
            return next(line.split(":", 1)[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def write(section, marker, text):
    """Puts `text` between the markers of a section of the page; creates the page or the section if it is missing."""
    begin, end = f"<!-- {marker}: begin -->", f"<!-- {marker}: end -->"
    page = PAGE.read_text() if PAGE.exists() else "# Performance\n"
    if begin not in page:
        page = f"{page.rstrip()}\n\n## {section}\n\n{begin}\n{end}\n"
    before, rest = page.split(begin, 1)
    after = rest.split(end, 1)[1]
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(f"{before}{begin}\n\n{text.rstrip()}\n\n{end}{after}")
    say(f"wrote {PAGE}")
