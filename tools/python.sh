#!/usr/bin/env bash
# Tests the Python package in a new environment: as a wheel in the profile `release`, or with the argument `built`
# beside the module that `cargo build --workspace --lib --bins` left, which builds nothing, without the tests
# marked `long`. With the argument `packages`, it only makes the environment of `built`, which takes it once. If Python,
# pip or the packages of the tests are not available, it prints this and succeeds.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

without() {
    echo "$1: the Python package is not tested"
    exit 0
}
target="${CARGO_TARGET_DIR:-$PWD/target}"
python=$(command -v python3) || without "no python3"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || without "python3 is older than 3.11, which the tests need"
mode=${1:-wheel}
folder="$target/python"
ready="$folder/ready"
if [[ $mode != built || ! -e $ready ]]; then
    rm -rf "$folder"
    mkdir -p "$folder"
    "$python" -m venv "$folder/venv" >/dev/null 2>&1 || without "no module venv with pip"
fi
python="$folder/venv/bin/python"
pip=("$python" -m pip --quiet --disable-pip-version-check)

# uv installs the 150 packages of the tests in a tenth of pip's time.
install() {
    "${pip[@]}" install uv && "$folder/venv/bin/uv" pip install --quiet --python "$python" "$@" ||
        "${pip[@]}" install "$@"
}

chosen=()
if [[ $mode != wheel ]]; then
    chosen=(-m "not long")
    if [[ ! -e $ready ]]; then
        packages=$("$python" - <<'PACKAGES'
import tomllib
project = tomllib.load(open("python/pyproject.toml", "rb"))["project"]
print("\n".join(project["dependencies"] + project["optional-dependencies"]["test"]))
PACKAGES
        )
        mapfile -t packages <<<"$packages"
        install "${packages[@]}" || without "the packages of the tests cannot be had"
        touch "$ready"
    fi
    [[ $mode == built ]] || exit 0
    rm "$ready"
    installed=$("$python" -c 'import sysconfig; print(sysconfig.get_path("platlib"))')/boresight
    cp -r python/package/boresight "$installed"
    cp "$target/debug/lib_boresight.so" "$installed/_boresight.abi3.so"
else
    "${pip[@]}" install 'maturin>=1.7,<2' || without "maturin cannot be had"
    CARGO_TARGET_DIR="$target" "$folder/venv/bin/maturin" build --release --locked --quiet \
        --manifest-path python/Cargo.toml --interpreter "$python" --out "$folder/wheels"
    BORESIGHT_WHEEL=$(echo "$folder"/wheels/*.whl)
    export BORESIGHT_WHEEL
    install "$BORESIGHT_WHEEL[test]" || without "the packages of the tests cannot be had"
    echo "$(basename "$BORESIGHT_WHEEL"), $(($(stat -c %s "$BORESIGHT_WHEEL") / 1000)) kB"
fi
# The tests of a file share what they simulate.
"$python" -m pytest -p no:cacheprovider --numprocesses "$(nproc)" --dist loadfile "${chosen[@]}" python
