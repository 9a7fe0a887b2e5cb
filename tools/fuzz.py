"""Runs every fuzz target for a time and counts its executions; fails if a target fails.

    python3 tools/fuzz.py [SECONDS] [TARGET ...]

needs cargo-fuzz (`cargo install cargo-fuzz`) and a C++ compiler. New inputs of a run stay in
fuzz/target/found/<target>, for the next run; a failing input is kept in fuzz/artifacts/<target>. Shrink it
with `cargo fuzz tmin -s none <target> <input>`, fix the reader, and copy it to fuzz/corpus/<target>, which
`cargo test --test clock corpora` replays. After a long run, `cargo fuzz cmin -s none <target>` removes inputs that add
nothing to a corpus.
"""
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# The largest input, bytes, and the time after which an input counts as a hang, seconds. The targets themselves
# are stricter.
LARGEST = 30_000
LONGEST_S = 20


def cargo_fuzz(*args):
    return ["cargo", "fuzz", *args]


def targets():
    listed = subprocess.run(cargo_fuzz("list"), cwd=ROOT, check=True, capture_output=True, text=True)
    return listed.stdout.split()


def run(target, seconds, folder):
    """The number of executions of a target, and whether it passed."""
    new_inputs = ROOT / "fuzz" / "target" / "found" / target
    corpus = ROOT / "fuzz" / "corpus" / target
    for place in (new_inputs, corpus):
        place.mkdir(parents=True, exist_ok=True)
    command = cargo_fuzz("run", "-s", "none", target, str(new_inputs), str(corpus)) + [
        "--", f"-max_total_time={seconds}", f"-timeout={LONGEST_S}", f"-max_len={LARGEST}",
        "-print_final_stats=1"]
    env = dict(os.environ, TMPDIR=folder)
    process = subprocess.run(command, cwd=ROOT, env=env, stderr=subprocess.PIPE, text=True, errors="replace")
    count = re.search(r"number_of_executed_units:\s*(\d+)", process.stderr)
    if process.returncode != 0:
        print("\n".join(process.stderr.splitlines()[-60:]))
    return int(count.group(1)) if count else 0, process.returncode == 0


def main():
    seconds = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    memory = Path("/dev/shm")
    folder = tempfile.mkdtemp(prefix="boresight-fuzz-", dir=memory if memory.is_dir() else None)
    total, failed = 0, []
    try:
        for target in sys.argv[2:] or targets():
            count, passed = run(target, seconds, folder)
            total += count
            failed += [] if passed else [target]
            print(f"{target:10} {count:>12,} executions{'' if passed else '  FAILED'}", flush=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print(f"{'sum':10} {total:>12,} executions")
    if failed:
        sys.exit(f"failed: {', '.join(failed)}; the inputs are in fuzz/artifacts")


if __name__ == "__main__":
    main()
