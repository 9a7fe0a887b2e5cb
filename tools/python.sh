#!/usr/bin/env bash
# Builds the wheel of the Python package, installs it in a new environment and tests it there. If Python, pip or
# the packages of the tests are not available, it says so and succeeds.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Reuses dependencies that were built for the main crate.
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$PWD/target}"
cargo clippy --locked --manifest-path python/Cargo.toml --all-targets -- -D warnings

without() {
    echo "$1: the Python package is not built and not tested"
    exit 0
}
python=$(command -v python3) || without "no python3"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || without "python3 is older than 3.11, which the tests need"
folder="$CARGO_TARGET_DIR/python"
rm -rf "$folder"
mkdir -p "$folder"
"$python" -m venv "$folder/venv" >/dev/null 2>&1 || without "no module venv with pip"
python="$folder/venv/bin/python"
pip=("$python" -m pip --quiet --disable-pip-version-check)
"${pip[@]}" install 'maturin>=1.7,<2' || without "maturin is not available"

"$folder/venv/bin/maturin" build --profile ci --locked --quiet --manifest-path python/Cargo.toml \
    --interpreter "$python" --out "$folder/wheels"
wheel=$(echo "$folder"/wheels/*.whl)
"${pip[@]}" install "$wheel" || without "numpy is not available"
"${pip[@]}" install "$wheel[test]" || without "the packages of the tests are not available"
echo "$(basename "$wheel"), $(($(stat -c %s "$wheel") / 1000)) kB"
BORESIGHT_WHEEL="$wheel" "$python" -m pytest -p no:cacheprovider python
