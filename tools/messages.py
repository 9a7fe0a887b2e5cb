#!/usr/bin/env python3
"""Prints every message that a user can see, by file: the prose among the string literals of src/ and crates/, and
the help texts of the command line. For proofreading.

    python3 tools/messages.py [FILE...]
"""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
# A comment (left out), a character (left out), a raw string, a string.
TOKEN = re.compile(
    r'(?P<comment>//[^\n]*)|(?P<char>\'(?:\\.|[^\\\'])\')'
    r'|r(?P<hashes>#*)"(?P<raw>.*?)"(?P=hashes)|"(?P<text>(?:\\.|[^"\\])*)"',
    re.S,
)
HELP = re.compile(r"^\s*/// (.*)$", re.M)


def without_tests(code):
    return code.split("#[cfg(test)]\nmod tests")[0]


def literals(code):
    for token in TOKEN.finditer(code):
        text = token["raw"] if token["raw"] is not None else token["text"]
        if text is None:
            continue
        line = code.count("\n", 0, token.start()) + 1
        # A backslash at the end of a line removes the line break and the indentation of the next line.
        yield line, re.sub(r"\\\n\s*", "", text).replace('\\"', '"').replace("\\n", "\n")


def is_prose(text):
    words = re.findall(r"[A-Za-zé]{2,}", re.sub(r"\{[^}]*\}", "", text))
    return len(words) > 1 and " " in text and not text.lstrip().startswith(("<", "#["))


def main(files):
    for path in files or [path for part in ("src", "crates") for path in sorted((ROOT / part).rglob("*.rs"))]:
        path = pathlib.Path(path)
        if path.name == "tests.rs" or "tests" in path.parts:
            continue
        code = without_tests(path.read_text())
        messages = [(line, text) for line, text in literals(code) if is_prose(text)]
        if "cli" in path.parts:
            messages += [
                (code.count("\n", 0, match.start(1)) + 1, match[1]) for match in HELP.finditer(code)
            ]
        if messages:
            print(f"\n== {path.resolve().relative_to(ROOT)}")
        for line, text in sorted(messages):
            print(f"{line:5}  {text.strip()}")


main(sys.argv[1:])
